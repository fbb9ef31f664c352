#include "infer/initial/visibility_correction.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "core/geometry/visibility.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::visibility_correction_test {
namespace {

using namespace testing_infer;

/// Brute force: the mean of a grid of points on the side, 4 mm apart, of those to which a ray from
/// the sensor is free and that lie in the picture.
Eigen::Vector3d CentroidOfWhatIsSeen(const Structure& structure, const Side& side,
                                     const Intrinsics& k, const Pose& pose) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  int count = 0;
  const int steps_u = static_cast<int>(side.half_u / 0.002);
  const int steps_v = static_cast<int>(side.half_v / 0.002);
  for (int i = 0; i < steps_u; ++i) {
    for (int j = 0; j < steps_v; ++j) {
      const Eigen::Vector3d p = side.centre +
                                (2 * (i + 0.5) / steps_u - 1) * side.half_u * side.axis_u +
                                (2 * (j + 0.5) / steps_v - 1) * side.half_v * side.axis_v;
      const Eigen::Vector3d q = pose.inverse() * p;
      const double u = k.fx * q.x() / q.z() + k.cx, v = k.fy * q.y() / q.z() + k.cy;
      if (u < -0.5 || v < -0.5 || u > k.width - 0.5 || v > k.height - 0.5) continue;
      const RayHit hit = CastRay(structure, pose.translation(), p - pose.translation());
      if (hit.side < 0 || hit.t < 1 - 1e-6) continue;
      sum += p;
      ++count;
    }
  }
  return sum / count;
}

TEST(VisibleKeypoints, AreCentroidsOfWhatIsSeen) {
  const Structure structure = PaperStructure();
  int far_from_centre = 0;
  for (const double phi : {15.0, 130.0, 250.0}) {
    const Pose pose = RingPose(phi, 1.6);
    const auto rendered = Render(structure, Kinect(), pose);
    const SensorView view = MakeSensorView(rendered.depth, Kinect());
    const std::vector<SidePatch> patches =
        CollectPatches(view, Certain(rendered.labels), structure);
    const std::vector<Eigen::Vector3d> keypoints = VisibleKeypoints(view, patches, structure, pose);
    ASSERT_EQ(keypoints.size(), patches.size());
    for (std::size_t i = 0; i < patches.size(); ++i) {
      const Side& side = structure.SideOfLabel(patches[i].label);
      const Eigen::Vector3d towards = (pose.translation() - side.centre).normalized();
      // Of a sliver, or at over 75 deg, a pixel more or less makes a centimetre.
      if (patches[i].area < 0.02 || side.normal.dot(towards) < 0.26) continue;
      const Eigen::Vector3d expected = CentroidOfWhatIsSeen(structure, side, Kinect(), pose);
      EXPECT_LT((keypoints[i] - expected).norm(), 0.005) << phi << " " << side.name;
      far_from_centre += (expected - side.centre).norm() > 0.03 ? 1 : 0;
    }
  }
  EXPECT_GE(far_from_centre, 5);
}

TEST(VisibleKeypoints, StayThoseOfTheSideWhereThePoseShowsNothingOfIt) {
  const Structure structure = PaperStructure();
  const Pose pose = RingPose(20);
  const auto rendered = Render(structure, Kinect(), pose);
  const SensorView view = MakeSensorView(rendered.depth, Kinect());
  const std::vector<SidePatch> patches = CollectPatches(view, Certain(rendered.labels), structure);
  // From the other side of the structure.
  const Pose other = RingPose(200);
  const LabelImage seen = Render(structure, Kinect(), other).labels;
  const std::vector<Eigen::Vector3d> keypoints = VisibleKeypoints(view, patches, structure, other);
  int hidden = 0;
  for (std::size_t i = 0; i < patches.size(); ++i) {
    if (std::find(seen.begin(), seen.end(), patches[i].label) != seen.end()) continue;
    ++hidden;
    EXPECT_EQ(keypoints[i], structure.SideOfLabel(patches[i].label).exposed_centroid);
  }
  EXPECT_GT(hidden, 0);
}

TEST(CorrectForVisibility, BringsAPoseFromKeypointsOfWholeSidesNearer) {
  const Structure structure = PaperStructure();
  for (const double phi : {15.0, 130.0, 250.0}) {
    const Pose truth = RingPose(phi);
    const auto rendered = Render(structure, Kinect(), truth);
    const SensorView view = MakeSensorView(rendered.depth, Kinect());
    const std::vector<SidePatch> patches =
        LargestPatches(CollectPatches(view, Certain(rendered.labels), structure));
    const std::vector<Pose> candidates = FindCandidates(patches, structure, nullptr);
    ASSERT_FALSE(candidates.empty()) << phi;
    const auto corrected =
        CorrectForVisibility(view, patches, structure, kMostKeypointError, candidates[0]);
    ASSERT_TRUE(corrected.has_value()) << phi;
    EXPECT_LT(ComparePoses(*corrected, truth).translation_m,
              0.7 * ComparePoses(candidates[0], truth).translation_m)
        << phi;
  }
  const auto none = CorrectForVisibility(MakeSensorView(DepthImage(320, 288), Kinect()), {},
                                         structure, 0.2, RingPose(20));
  EXPECT_FALSE(none.has_value());
}

}  // namespace
}  // namespace volalign::visibility_correction_test
