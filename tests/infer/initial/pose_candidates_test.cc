#include "infer/initial/pose_candidates.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "infer/initial/same_pose.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::pose_candidates_test {
namespace {

using testing_infer::LabelOf;
using testing_infer::PaperStructure;
using testing_infer::RingPose;

/// A side as a sensor at `pose` that saw all of it would have it.
SidePatch WholeSide(const Structure& structure, const std::string& name, const Pose& pose) {
  SidePatch patch;
  patch.label = LabelOf(structure, name);
  const Side& side = structure.SideOfLabel(patch.label);
  patch.centroid = pose.inverse() * structure.Keypoint(patch.label, KeypointKind::kExposed);
  patch.normal = pose.linear().transpose() * side.normal;
  patch.area = 4 * side.half_u * side.half_v;
  patch.normal_sigma = 0.01;
  return patch;
}

class PoseCandidates : public ::testing::Test {
 protected:
  void Add(const std::string& name) { patches.push_back(WholeSide(structure, name, truth)); }
  std::vector<Eigen::Vector3d> Keypoints() const { return SideKeypoints(patches, structure); }
  void ExpectTruth(const Pose& pose) const {
    const PoseError error = ComparePoses(pose, truth);
    EXPECT_FALSE(!(error.translation_m < 1e-9)) << error.translation_m;
    EXPECT_FALSE(!(error.rotation_deg < 1e-6)) << error.rotation_deg;
  }

  Structure structure = PaperStructure();
  Pose truth = RingPose(35);
  std::vector<SidePatch> patches;
};

TEST_F(PoseCandidates, TwoSidesOfDifferentDirectionsFixThePose) {
  Add("top/front");
  Add("mid_top/right");
  const auto pose = SolvePose(patches, PatchSet().set(0).set(1), Keypoints(), structure);
  ASSERT_TRUE(pose.has_value());
  ExpectTruth(*pose);
}

// Four centres in a plane alone would leave a mirror image; three in a line a turn about it.
TEST_F(PoseCandidates, NormalsFixWhatParallelSidesLeaveFree) {
  for (const char* name : {"mid_bottom/front", "mid_top/front", "top/front"}) Add(name);
  const auto pose = SolvePose(patches, PatchSet().set(0).set(1).set(2), Keypoints(), structure);
  ASSERT_TRUE(pose.has_value());
  ExpectTruth(*pose);
}

TEST_F(PoseCandidates, SidesAboveEachOtherFixNoTurn) {
  structure = Structure::FromBoxes("tower", {Box::FromMinMax("low", {0, 0, 0}, {0.4, 0.4, 0.4}),
                                             Box::FromMinMax("high", {0, 0.8, 0}, {0.4, 1, 0.4})});
  Add("low/up");
  Add("high/up");
  EXPECT_FALSE(SolvePose(patches, PatchSet().set(0).set(1), Keypoints(), structure).has_value());
}

TEST_F(PoseCandidates, APatchAgreesByPlaceAndDirection) {
  for (int copy = 0; copy < 5; ++copy) Add("top/front");
  const Eigen::Vector3d axis = patches[0].normal.unitOrthogonal();
  patches[0].centroid += 0.1 * axis;   // nearest of those that agree
  patches[1].centroid += 0.15 * axis;  // farther than that
  patches[2].centroid += 0.25 * axis;  // too far
  patches[3].normal = Eigen::AngleAxisd(35 * M_PI / 180, axis) * patches[3].normal;  // turned
  patches[4].centroid -= 0.19 * axis;
  Add("mid_top/right");
  patches[5].normal = Eigen::AngleAxisd(35 * M_PI / 180, axis) * patches[5].normal;
  patches[5].normal_sigma = 0.2;  // a sliver, whose normal says little
  const PatchSet agreeing =
      AgreeingPatches(patches, Keypoints(), structure, kMostKeypointError, truth);
  EXPECT_EQ(agreeing, PatchSet().set(0).set(5));
}

TEST_F(PoseCandidates, TheCandidateThatMostPatchesAgreeWithComesFirst) {
  for (const char* name : {"top/front", "mid_top/right", "mid_bottom/front", "bottom/up"})
    Add(name);
  // Two true sides with each other's labels.
  patches.push_back(WholeSide(structure, "bottom/front", truth));
  patches.push_back(WholeSide(structure, "top/right", truth));
  std::swap(patches[4].label, patches[5].label);
  patches = LargestPatches(patches);
  for (std::size_t i = 1; i < patches.size(); ++i) EXPECT_GE(patches[i - 1].area, patches[i].area);
  const std::vector<Pose> poses = FindCandidates(patches, structure, nullptr);
  ASSERT_FALSE(poses.empty());
  ExpectTruth(poses.front());
  EXPECT_LE(poses.size(), 8u);
  // Near a pose that is far from it, it is none.
  const Pose elsewhere = RingPose(125);
  for (const Pose& pose : FindCandidates(patches, structure, &elsewhere))
    EXPECT_TRUE(SamePose(structure, pose, elsewhere));
  const std::vector<Pose> near = FindCandidates(patches, structure, &truth);
  ASSERT_FALSE(near.empty());
  ExpectTruth(near.front());
}

TEST_F(PoseCandidates, OneSideOrNoneGivesNoCandidate) {
  EXPECT_TRUE(FindCandidates(patches, structure, nullptr).empty());
  Add("top/front");
  EXPECT_TRUE(FindCandidates(patches, structure, nullptr).empty());
}

}  // namespace
}  // namespace volalign::pose_candidates_test
