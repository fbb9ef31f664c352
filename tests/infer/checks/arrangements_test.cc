#include "infer/checks/arrangements.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <set>
#include <string>
#include <vector>

#include "tests/infer/view/synthetic.h"

namespace volalign::arrangements_test {
namespace {

using namespace testing_infer;

TEST(Arrangements, ATurnOrExchangeThatChangesNothingIsInNoList) {
  const Structure structure = PaperStructure();
  const std::vector<Arrangement> list = Arrangements(structure);
  ASSERT_FALSE(list.empty());
  EXPECT_TRUE(list.front().code == SensorCode::kNone);
  std::set<std::string> sentences;
  for (const Arrangement& arrangement : list) {
    sentences.insert(arrangement.sentence);
    EXPECT_NEAR(arrangement.structure.FloorHeight(), structure.FloorHeight(), 1e-9)
        << arrangement.sentence;
  }
  // Exchanging the two boxes that overhang along z is the mirror image.
  EXPECT_EQ(sentences.count("boxes mid_bottom and top are swapped"), 0u);
  EXPECT_EQ(sentences.count("the stack or the frames are mirrored"), 1u);

  // Cubes in one column: a quarter turn, an exchange or a mirror image is the same column.
  std::vector<Box> cubes;
  cubes.reserve(3);
  for (int i = 0; i < 3; ++i) {
    cubes.push_back(Box::FromMinMax("c" + std::to_string(i), Eigen::Vector3d(0, 0.4 * i, 0),
                                    Eigen::Vector3d(0.4, 0.4 * i + 0.4, 0.4)));
  }
  for (const Arrangement& arrangement : Arrangements(Structure::FromBoxes("column", cubes)))
    EXPECT_TRUE(arrangement.code == SensorCode::kNone ||
                arrangement.code == SensorCode::kAssemblyMissing)
        << arrangement.sentence;
}

/// Corners of all boxes, from their middle.
std::vector<Eigen::Vector3d> Corners(const Structure& structure) {
  std::vector<Eigen::Vector3d> corners;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Box& box : structure.boxes()) {
    for (int k = 0; k < 8; ++k) {
      const Eigen::Vector3d half =
          Eigen::Vector3d(k & 1 ? 0.5 : -0.5, k & 2 ? 0.5 : -0.5, k & 4 ? 0.5 : -0.5)
              .cwiseProduct(box.size);
      corners.push_back(box.structure_from_box * half);
      sum += corners.back();
    }
  }
  for (Eigen::Vector3d& corner : corners) corner -= sum / static_cast<double>(corners.size());
  return corners;
}

TEST(Arrangements, AMirroredStackIsTheReflectionOfEveryCorner) {
  std::vector<Box> boxes = {
      Box::FromMinMax("low", Eigen::Vector3d(-0.3, 0, -0.2), Eigen::Vector3d(0.3, 0.4, 0.2)),
      Box::FromMinMax("high", Eigen::Vector3d(-0.4, 0.4, -0.1), Eigen::Vector3d(0.1, 0.8, 0.25))};
  boxes[1].structure_from_box.linear() =
      Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitY()).toRotationMatrix();
  const Structure structure = Structure::FromBoxes("askew", boxes);
  const std::vector<Arrangement> list = Arrangements(structure);
  const auto mirrored = std::find_if(list.begin(), list.end(), [](const Arrangement& arrangement) {
    return arrangement.code == SensorCode::kAssemblyMirrored;
  });
  ASSERT_NE(mirrored, list.end());
  const std::vector<Eigen::Vector3d> corners = Corners(mirrored->structure);
  for (const Eigen::Vector3d& corner : Corners(structure)) {
    const Eigen::Vector3d reflected(corner.x(), corner.y(), -corner.z());
    EXPECT_TRUE(std::any_of(corners.begin(), corners.end(), [&](const Eigen::Vector3d& other) {
      return (other - reflected).norm() < 1e-9;
    })) << reflected.transpose();
  }
}

TEST(Displaced, IsABoxWithWhatStandsOnItElsewhereAboveTheFloor) {
  const Structure structure = PaperStructure();
  const std::vector<Box>& boxes = structure.boxes();
  const auto height = [](const Structure& of, std::size_t box) {
    return of.boxes()[box].structure_from_box.translation().y();
  };
  const Arrangement upper = Displaced(structure, {2, 3}, {0, -0.2, 0});
  EXPECT_EQ(upper.code, SensorCode::kAssemblyHeight);
  EXPECT_EQ(upper.sentence,
            "box " + boxes[2].name + ", with what stands on it, stands 20 cm lower than described");
  ASSERT_EQ(upper.structure.boxes().size(), boxes.size());
  for (std::size_t i = 0; i < boxes.size(); ++i)
    EXPECT_NEAR(height(upper.structure, i), height(structure, i) - (i < 2 ? 0 : 0.2), 1e-12);
  // On another box, which the floor is under.
  const Arrangement all = Displaced(structure, {0, 1, 2, 3}, {0, 0.3, 0});
  EXPECT_EQ(all.sentence, "box " + boxes[0].name + " stands higher than described");
  ASSERT_EQ(all.structure.boxes().size(), boxes.size() + 1);
  EXPECT_NEAR(all.structure.FloorHeight(), structure.FloorHeight(), 1e-12);
  EXPECT_NEAR(height(all.structure, 3), height(structure, 3) + 0.3, 1e-12);
}

}  // namespace
}  // namespace volalign::arrangements_test
