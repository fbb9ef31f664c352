#include "infer/refine/build_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/infer/view/synthetic.h"

namespace volalign::refine_internal::build_model_test {
namespace {

TEST(BuildModel, MovesTurnsAndGrowsOnTheSameFloor) {
  const Structure structure = testing_infer::PaperStructure();
  const BuildModel model(structure);
  std::vector<double> boxes(3 * structure.boxes().size(), 0);
  EXPECT_EQ(boxes.size(), 3 * structure.boxes().size());
  const double size = 0.02;
  boxes[static_cast<std::size_t>(BuildModel::X(1))] = 0.003;
  boxes[static_cast<std::size_t>(BuildModel::Z(1))] = -0.004;
  boxes[static_cast<std::size_t>(BuildModel::Yaw(1))] = M_PI / 2;
  const Structure built = model.Built({&size, boxes.data()});
  EXPECT_NEAR(built.FloorHeight(), structure.FloorHeight(), 1e-9);
  for (std::size_t b = 0; b < structure.boxes().size(); ++b) {
    const Box &before = structure.boxes()[b], &after = built.boxes()[b];
    EXPECT_TRUE(after.size.isApprox(1.02 * before.size, 1e-12));
    Eigen::Vector3d expected = before.structure_from_box.translation();
    expected.y() += 0.02 * (expected.y() - structure.FloorHeight());
    if (b == 1) expected += Eigen::Vector3d(0.003, 0, -0.004);
    EXPECT_TRUE(after.structure_from_box.translation().isApprox(expected, 1e-9)) << b;
    // A quarter turn about the vertical takes +x to -z.
    const Eigen::Vector3d x = after.structure_from_box.linear().col(0),
                          was = before.structure_from_box.linear().col(0);
    const Eigen::Vector3d turned = b == 1 ? Eigen::Vector3d(was.z(), was.y(), -was.x()) : was;
    EXPECT_TRUE(x.isApprox(turned, 1e-9)) << b;
  }
}

}  // namespace
}  // namespace volalign::refine_internal::build_model_test
