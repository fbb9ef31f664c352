#include "infer/refine/observations.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "infer/view/alike.h"
#include "tests/infer/refine/points_and_observations.h"

namespace volalign::refine_internal::observations_test {
namespace {

using testing_infer::PaperStructure;

/// Points of one image block on the top box's front, seen head on from 1.5 m: `off` in front of it.
struct Block {
  Structure structure = PaperStructure();
  int label = testing_infer::LabelOf(structure, "top/front");
  Pose pose = Pose::Identity();
  SensorPoints points;

  Block() {
    const Side& side = structure.SideOfLabel(label);
    pose.linear().col(2) = -side.normal;
    pose.linear().col(1) = side.axis_u;
    pose.linear().col(0) = pose.linear().col(1).cross(pose.linear().col(2));
    pose.translation() = side.centre + 1.5 * side.normal;
  }
  void Add(double x, double off, int block) {
    SidePoint point;
    point.p = {x, 0, 1.5 - off};
    point.normal = -Eigen::Vector3d::UnitZ();
    point.label = label;
    point.block = block;
    points.side_points.push_back(point);
  }
  FrameObservations Gather() const {
    FrameObservations observed;
    GatherObservations(structure, NominalState(structure, {pose}), 0, points, {0.06, 0.02, 0.9},
                       &observed);
    return observed;
  }
};

TEST(GatherObservations, TakesTheMeanOfABlockWithoutWhatLiesApart) {
  Block block;
  for (int i = 0; i < 4; ++i) block.Add(0.002 * i, i % 2 ? 0.001 : -0.001, 7);
  block.Add(0.05, 0.05, 7);  // of the same block, but 5 cm in front of the others
  block.Add(0.05, 0.07, 7);  // beyond the gate
  block.Add(0, 0, 8);        // too few of a block
  block.Add(0.001, 0, 8);
  const FrameObservations observed = block.Gather();
  ASSERT_EQ(observed.faces.size(), 1u);
  const FaceObservation& face = observed.faces[0];
  EXPECT_EQ(face.label, block.label);
  EXPECT_TRUE(face.p.isApprox(Eigen::Vector3d(0.003, 0, 1.5), 1e-9)) << face.p.transpose();
  // About the upper median of -1, -1, 1, 1 and 50 mm, which is 1 mm: squares 4 + 4 mm^2, of four
  // points that are worth two.
  EXPECT_NEAR(face.variance, 2 * 8e-6 / 16, 1e-12);
  EXPECT_NEAR(face.multipath, 0, 1e-9) << "nothing rises in front of the top box";
  const Side& side = block.structure.SideOfLabel(block.label);
  EXPECT_EQ(face.bulge, side.BulgeAt(block.pose * face.p));
  FrameErrorVector by_errors =
      FrameErrorsAt(observed.noise.depth, face.p, block.pose.linear().transpose() * side.normal);
  by_errors[kBounced] = BouncedShare(block.structure, side, block.pose * face.p,
                                     block.pose.translation(), observed.noise.depth.bounce_reach_m);
  EXPECT_TRUE(face.by_errors.isApprox(by_errors, 1e-9)) << face.by_errors.transpose();
}

TEST(GatherObservations, WhatMayBeMeasuredAsideIsLeftOutWhereTheOthersAreEnough) {
  Block block;
  for (int i = 0; i < 8; ++i) block.Add(0.002 * i, 0, 7);
  for (std::size_t i = 3; i < 8; ++i) block.points.side_points[i].aside_rad = 0.003;
  const FrameObservations enough = block.Gather();
  ASSERT_EQ(enough.faces.size(), 1u);
  EXPECT_EQ(enough.faces[0].aside_rad, 0);
  EXPECT_NEAR(enough.faces[0].p.x(), 0.002, 1e-9);
  block.points.side_points[2].aside_rad = 0.003;
  const FrameObservations all = block.Gather();
  ASSERT_EQ(all.faces.size(), 1u);
  EXPECT_NEAR(all.faces[0].aside_rad, 0.003 * 6 / 8, 1e-9);
  EXPECT_NEAR(all.faces[0].p.x(), 0.007, 1e-9);
}

TEST(GatherObservations, APixelThatFramesDisagreeAboutSaysLess) {
  Block block;
  for (int i = 0; i < 4; ++i) block.Add(0.002 * i, i % 2 ? 0.001 : -0.001, 7);
  // One part in ten of the weight of the others, which it takes from the two in front.
  for (const int i : {1, 3}) block.points.side_points[static_cast<std::size_t>(i)].sigma = 0.003;
  const FrameObservations observed = block.Gather();
  ASSERT_EQ(observed.faces.size(), 1u);
  const FaceObservation& face = observed.faces[0];
  EXPECT_NEAR(face.p.z(), 1.5 + 0.001 * (2 - 0.2) / 2.2, 1e-9);
  // About the upper median, 1 mm: those behind it are 2 mm off.
  EXPECT_NEAR(face.variance, 2 * (2 * 4e-6) / (2.2 * 2.2), 1e-12);
}

TEST(WidenOutliers, CountsWhatExceedsTheLimit) {
  // The limit is 3.5 mm where everything else agrees to less than a millimetre.
  const Structure structure = PaperStructure();
  const BuildModel model(structure);
  const Pose pose = testing_infer::RingPose(35);
  const FrameObservations exact = testing_infer::Observe(structure, pose, 14);
  const auto widened = [&](double off) {
    FrameObservations observed = exact;
    FaceObservation& odd = observed.faces[20];
    odd.p += off * pose.linear().transpose() * structure.SideOfLabel(odd.label).normal;
    WidenOutliers(model, testing_infer::ParameterPoint(model, pose).Parameters(), Priors(),
                  &observed);
    return observed.faces[20].variance - exact.faces[20].variance;
  };
  EXPECT_EQ(widened(0.0034), 0);
  EXPECT_NEAR(widened(0.005), 4 * (0.005 * 0.005 - 0.0035 * 0.0035), 6e-6);
  EXPECT_NEAR(widened(0.01), 4 * (0.01 * 0.01 - 0.0035 * 0.0035), 3e-5);
}

TEST(WidenOutliers, LeavesWhatAgreesAsItIs) {
  const Structure structure = PaperStructure();
  const BuildModel model(structure);
  const Pose pose = testing_infer::RingPose(35);
  FrameObservations observed = testing_infer::Observe(structure, pose, 14);
  ASSERT_GT(observed.faces.size(), 60u);
  FaceObservation& odd = observed.faces[20];
  const Eigen::Vector3d normal =
      pose.linear().transpose() * structure.SideOfLabel(odd.label).normal;
  odd.p += 0.05 * normal;
  const FrameObservations before = observed;
  Priors priors;
  priors.offset = 0.007;
  WidenOutliers(model, testing_infer::ParameterPoint(model, pose).Parameters(), priors, &observed);
  for (std::size_t k = 0; k < observed.faces.size(); ++k) {
    const double widened = observed.faces[k].variance - before.faces[k].variance;
    // 5 cm, less the little that the fit follows, against a limit of 3.5 mm: 4 (size^2 - limit^2).
    if (k == 20) {
      EXPECT_NEAR(std::sqrt(widened / 4), 0.05, 0.003);
    } else {
      EXPECT_EQ(widened, 0) << k;
    }
  }
}

}  // namespace
}  // namespace volalign::refine_internal::observations_test
