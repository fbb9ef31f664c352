#include "infer/initial/pose_sources.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <vector>

#include "infer/initial/agreement.h"
#include "infer/initial/rig_choice.h"
#include "infer/initial/same_pose.h"
#include "tests/infer/initial/geometry_frames.h"

namespace volalign::pose_sources_test {
namespace {

using testing_infer::Certain;
using testing_infer::RingPose;

Pose Moved(const Pose& pose, double x, double yaw) {
  Pose motion = Pose::Identity();
  motion.linear() = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitY()).toRotationMatrix();
  motion.translation().x() = x;
  return motion * pose;
}

/// A view of a box that looks the same after half a turn, its labels, and poses of it.
class Proposals : public testing::Test {
 protected:
  /// Of both sources, where labels have led the network to a pose.
  std::vector<PoseCandidate> Competitors(const Pose& network, const LabelImage& labels) const {
    const SegmentationResult segmentation = Certain(labels);
    InitialPose initial;
    initial.found = true;
    initial.structure_from_sensor = network;
    return FindCompetitors(view_, box_, FindAliases(box_), {{&segmentation, &initial}}, true,
                           InitialPoseOptions());
  }
  PoseChoice Combined(const Pose& network, const LabelImage& labels) const {
    return ChooseTogether({{&view_, Competitors(network, labels), {}, 0}}, box_).front();
  }
  LabelImage LabelsAt(const Pose& pose, const DepthErrorModel& errors) const {
    return LabelsFromPose(view_, box_, pose, SurfaceTolerance::AtRoughPose(errors)).labels;
  }

  bool IsChosen(const PoseChoice& choice, const Pose& pose) const {
    return choice.found && SamePose(box_, choice.best.structure_from_sensor, pose);
  }

  const Structure box_ = Structure::FromBoxes(
      "box", {Box::FromMinMax("box", {-0.35, -0.8, -0.25}, {0.35, 0.2, 0.25})});
  const Pose truth_ = RingPose(40, 2.0, 0.6);
  const Pose half_turn_ = Moved(truth_, 0, M_PI);
  const Pose elsewhere_ = Moved(truth_, 0.3, 0);
  const SensorView view_ = testing_infer::See(box_, truth_);
  const LabelImage labels_ = LabelsAt(truth_, view_.errors);
};

TEST_F(Proposals, OfBothThatAgreeAreTheNetworks) {
  for (const Pose& pose : {truth_, half_turn_}) {
    const PoseChoice choice = Combined(pose, LabelsAt(pose, view_.errors));
    EXPECT_TRUE(IsChosen(choice, pose)) << "labels tell from which end";
    EXPECT_EQ(choice.best.source, PoseSource::kNetwork);
    EXPECT_FALSE(choice.ambiguous);
  }
}

TEST_F(Proposals, OfGeometryStandInForAPoseThatLabelsDoNotSpeakFor) {
  const PoseChoice choice = Combined(elsewhere_, labels_);
  EXPECT_TRUE(IsChosen(choice, truth_));
  EXPECT_EQ(choice.best.source, PoseSource::kGeometry);
}

// As a network labels what is beyond the distances that it was trained for.
TEST_F(Proposals, OfGeometryStandInWhereLabelsSayNothing) {
  LabelImage few = LabelsAt(elsewhere_, view_.errors);
  for (int v = 0; v < few.height(); ++v) {
    for (int u = 0; u < few.width(); ++u) {
      if (u / 4 % 3 > 0) few(u, v) = 0;
    }
  }
  const PoseChoice choice = Combined(elsewhere_, few);
  EXPECT_TRUE(IsChosen(choice, truth_) || IsChosen(choice, half_turn_));
  EXPECT_EQ(choice.best.source, PoseSource::kGeometry);
  EXPECT_TRUE(choice.ambiguous);
}

}  // namespace
}  // namespace volalign::pose_sources_test
