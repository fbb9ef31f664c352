#include "infer/initial/pose_sources.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <vector>

#include "infer/initial/agreement.h"
#include "tests/infer/initial/geometry_frames.h"

namespace volalign::pose_sources_test {
namespace {

using testing_infer::Certain;
using testing_infer::RingPose;

PoseCandidate From(PoseSource source, const Pose& pose) {
  PoseCandidate evidence;
  evidence.structure_from_sensor = pose;
  evidence.source = source;
  evidence.network_score = evidence.label_score = 0.6;
  evidence.shape_iou = 1;
  return evidence;
}

Pose Moved(const Pose& pose, double x, double yaw) {
  Pose motion = Pose::Identity();
  motion.linear() = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitY()).toRotationMatrix();
  motion.translation().x() = x;
  return motion * pose;
}

/// A view of a box that looks the same after half a turn, its labels, and poses of it.
class Proposals : public testing::Test {
 protected:
  PoseChoice Combined(const std::vector<Pose>& network, const std::vector<Pose>& geometry,
                      const LabelImage& labels) const {
    const SegmentationResult segmentation = Certain(labels);
    const InitialPose initial;
    std::vector<PoseCandidate> of_network, of_geometry;
    for (const Pose& pose : network) of_network.push_back(From(PoseSource::kNetwork, pose));
    for (const Pose& pose : geometry) of_geometry.push_back(From(PoseSource::kGeometry, pose));
    return Decide(CombineProposals(view_, box_, {{&segmentation, &initial}}, of_network,
                                   of_geometry, InitialPoseOptions(), PoseChoiceOptions()),
                  box_, PoseChoiceOptions());
  }

  bool IsChosen(const PoseChoice& choice, const Pose& pose) const {
    return choice.found &&
           ComparePoses(choice.best.structure_from_sensor, pose).translation_m < 1e-9;
  }

  const Structure box_ = Structure::FromBoxes(
      "box", {Box::FromMinMax("box", {-0.35, -0.8, -0.25}, {0.35, 0.2, 0.25})});
  const Pose truth_ = RingPose(40, 2.0, 0.6);
  const Pose half_turn_ = Moved(truth_, 0, M_PI);
  const Pose elsewhere_ = Moved(truth_, 0.3, 0);
  const SensorView view_ = testing_infer::See(box_, truth_);
  const LabelImage labels_ =
      LabelsFromPose(view_, box_, truth_, SurfaceTolerance::AtRoughPose(view_.errors)).labels;
};

TEST_F(Proposals, OfBothThatAgreeAreTheNetworks) {
  const PoseChoice choice = Combined({truth_}, {truth_}, labels_);
  EXPECT_TRUE(IsChosen(choice, truth_));
  EXPECT_EQ(choice.best.source, PoseSource::kNetwork);
  EXPECT_FALSE(choice.ambiguous);
}

TEST_F(Proposals, OfGeometryStandInForAPoseWithoutTheShape) {
  const PoseChoice choice = Combined({elsewhere_}, {truth_}, labels_);
  EXPECT_TRUE(IsChosen(choice, truth_));
  EXPECT_EQ(choice.best.source, PoseSource::kGeometry);
}

TEST_F(Proposals, OfGeometryStandInWhereLabelsSayNothing) {
  LabelImage few =
      LabelsFromPose(view_, box_, elsewhere_, SurfaceTolerance::AtRoughPose(view_.errors)).labels;
  for (int v = 0; v < few.height(); ++v) {
    for (int u = 0; u < few.width(); ++u) {
      if (u % 12 > 0) few(u, v) = 0;
    }
  }
  EXPECT_TRUE(IsChosen(Combined({elsewhere_}, {truth_}, few), truth_));
}

// As of a mirrored frame: many labels, which contradict what geometry has found.
TEST_F(Proposals, OfTheNetworkStandWhereLabelsContradictGeometry) {
  DepthErrorModel rough;
  rough.offset_m = 0.1;
  const LabelImage labels =
      LabelsFromPose(view_, box_, elsewhere_, SurfaceTolerance::AtRoughPose(rough)).labels;
  EXPECT_TRUE(IsChosen(Combined({elsewhere_}, {truth_}, labels), elsewhere_));
}

TEST_F(Proposals, ThatTheNetworkCannotTellApartGeometryDoesNotTellEither) {
  EXPECT_TRUE(Combined({elsewhere_, truth_}, {truth_}, labels_).ambiguous);
}

TEST_F(Proposals, OfANetworkThatIsSureAreAmbiguousWhereGeometryHasAnother) {
  const PoseChoice choice = Combined({half_turn_}, {truth_}, labels_);
  EXPECT_TRUE(IsChosen(choice, half_turn_));
  EXPECT_TRUE(choice.ambiguous);
}

}  // namespace
}  // namespace volalign::pose_sources_test
