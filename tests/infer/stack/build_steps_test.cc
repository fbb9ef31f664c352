#include "infer/stack/build_steps.h"

#include <gtest/gtest.h>

#include <utility>

namespace volalign::build_steps_test {
namespace {

void ExpectOverhang(const Overhang& overhang, double front, double back, double right,
                    double left) {
  EXPECT_NEAR(overhang.front, front, 1e-9);
  EXPECT_NEAR(overhang.back, back, 1e-9);
  EXPECT_NEAR(overhang.right, right, 1e-9);
  EXPECT_NEAR(overhang.left, left, 1e-9);
}

// By hand, from the numbers of configs/structure.yaml.
TEST(BuildSteps, OfThePapersStack) {
  const std::vector<BuildStep> steps = BuildSteps(ReadStructure("configs/structure.yaml"));
  ASSERT_EQ(steps.size(), 4u);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(steps[i].box, static_cast<int>(i));
    EXPECT_NEAR(steps[i].height, 0.405, 1e-9);
    EXPECT_NEAR(steps[i].yaw_deg, 0, 1e-9);
    EXPECT_EQ(steps[i].on_floor, i == 0);
  }
  EXPECT_NEAR(steps[1].front_to_back, 0.330, 1e-9);
  EXPECT_NEAR(steps[1].left_to_right, 0.555, 1e-9);
  EXPECT_TRUE(steps[0].on.empty());
  EXPECT_EQ(steps[3].on, std::vector<int>{2});
  ExpectOverhang(steps[1].overhang, -0.225, 0, 0, 0.225);
  ExpectOverhang(steps[2].overhang, 0, 0.225, 0, -0.225);
  ExpectOverhang(steps[3].overhang, 0, -0.225, 0.225, 0);
}

// Two feet and a bridge, written from the top downwards; the bridge lies on the right foot for 250
// x 300 mm, on the left one for 250 x 250 mm.
TEST(BuildSteps, ABoxOnTwoComesAfterThem) {
  const Structure structure =
      Structure::FromBoxes("table", {Box::FromMinMax("bridge", {0, 0.3, -0.45}, {0.25, 0.5, 0.5}),
                                     Box::FromMinMax("left", {0, 0, -0.5}, {0.3, 0.3, -0.2}),
                                     Box::FromMinMax("right", {-0.05, 0, 0.2}, {0.25, 0.3, 0.6})});
  const std::vector<BuildStep> steps = BuildSteps(structure);
  ASSERT_EQ(steps.size(), 3u);
  EXPECT_EQ(steps[0].box, 1);
  EXPECT_EQ(steps[1].box, 2);
  EXPECT_EQ(steps[2].box, 0);
  EXPECT_EQ(steps[2].on, (std::vector<int>{2, 1}));
  ExpectOverhang(steps[2].overhang, 0, -0.05, -0.1, 0.65);
  ExpectOverhang(steps[1].overhang, -0.05, 0.05, 0.8, -0.7);  // over the first box on the floor
}

TEST(BuildSteps, ATurnedBoxHasItsOwnEdges) {
  Box turned = Box::FromMinMax("turned", {-0.1, 0.2, -0.3}, {0.1, 0.3, 0.3});
  turned.structure_from_box.linear() = RotationExp(M_PI / 6 * Eigen::Vector3d::UnitY());
  const std::vector<BuildStep> steps = BuildSteps(Structure::FromBoxes(
      "two", {Box::FromMinMax("base", {-0.5, 0, -0.5}, {0.5, 0.2, 0.5}), std::move(turned)}));
  EXPECT_NEAR(steps[1].yaw_deg, 30, 1e-9);
  EXPECT_NEAR(steps[1].front_to_back, 0.2, 1e-9);
  EXPECT_NEAR(steps[1].left_to_right, 0.6, 1e-9);
  // Half of what its corners span: 0.1 cos 30 + 0.3 sin 30 along x, 0.1 sin 30 + 0.3 cos 30 along
  // z.
  const double x = 0.1 * std::sqrt(0.75) + 0.15 - 0.5, z = 0.05 + 0.3 * std::sqrt(0.75) - 0.5;
  ExpectOverhang(steps[1].overhang, x, x, z, z);
}

TEST(BuildSteps, ABoxInTheAirStandsOnNothing) {
  const std::vector<BuildStep> steps = BuildSteps(
      Structure::FromBoxes("two", {Box::FromMinMax("base", {0, 0, 0}, {0.5, 0.2, 0.5}),
                                   Box::FromMinMax("air", {0, 0.25, 0}, {0.5, 0.4, 0.5})}));
  EXPECT_TRUE(steps[1].on.empty());
  EXPECT_FALSE(steps[1].on_floor);
}

}  // namespace
}  // namespace volalign::build_steps_test
