#include "infer/checks/arrangements.h"

#include <gtest/gtest.h>

#include <set>
#include <string>
#include <vector>

#include "tests/infer/synthetic.h"

namespace volalign {
namespace {

using testing_infer::PaperStructure;

TEST(Arrangements, ATurnOrExchangeThatChangesNothingIsInNoList) {
  const Structure structure = PaperStructure();
  const std::vector<Arrangement> list = Arrangements(structure);
  ASSERT_FALSE(list.empty());
  EXPECT_TRUE(list.front().code == SensorCode::kNone);
  std::set<std::string> sentences;
  for (const Arrangement& arrangement : list) {
    sentences.insert(arrangement.sentence);
    EXPECT_EQ(arrangement.structure.SideNames(), structure.SideNames());
    EXPECT_NEAR(arrangement.structure.FloorHeight(), structure.FloorHeight(), 1e-9)
        << arrangement.sentence;
  }
  // Exchanging the two boxes that overhang along z is the mirror image.
  EXPECT_EQ(sentences.count("boxes mid_bottom and top are swapped"), 0u);
  EXPECT_EQ(sentences.count("the stack or the frames are mirrored"), 1u);

  // Cubes in one column: a quarter turn, an exchange or a mirror image is the same column.
  std::vector<Box> cubes;
  for (int i = 0; i < 3; ++i) {
    cubes.push_back(Box::FromMinMax("c" + std::to_string(i), Eigen::Vector3d(0, 0.4 * i, 0),
                                    Eigen::Vector3d(0.4, 0.4 * i + 0.4, 0.4)));
  }
  for (const Arrangement& arrangement : Arrangements(Structure::FromBoxes("column", cubes)))
    EXPECT_TRUE(arrangement.code == SensorCode::kNone ||
                arrangement.code == SensorCode::kAssemblyMissing)
        << arrangement.sentence;
}

}  // namespace
}  // namespace volalign
