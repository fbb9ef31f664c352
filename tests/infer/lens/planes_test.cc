#include "infer/lens/planes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "tests/infer/view/synthetic.h"

namespace volalign::planes_test {
namespace {

using testing_infer::Kinect;
using testing_infer::KinectWithLens;
using testing_infer::PaperStructure;
using testing_infer::Render;
using testing_infer::RingPose;

/// The walls at |x| = |z| = kWall and the floor, of which a point in the structure's frame is on
/// one, or -1.
constexpr double kWall = 3.2;
int SurfaceOf(const Eigen::Vector3d& p, double floor, double tolerance) {
  int found = -1;
  int count = 0;
  const double distances[] = {kWall - p.x(), kWall + p.x(), kWall - p.z(), kWall + p.z(),
                              p.y() - floor};
  for (int i = 0; i < 5; ++i) {
    if (std::abs(distances[i]) < tolerance) {
      found = i;
      ++count;
    }
  }
  return count == 1 ? found : -1;
}

TEST(FindLargePlanes, EachIsOneSurfaceOfTheRoom) {
  const Pose pose = RingPose(30);
  const auto seen = Render(PaperStructure(), Kinect(), pose, {true, kWall});
  const std::vector<LargePlane> planes = FindLargePlanes(MakeSensorView(seen.depth, Kinect()));
  ASSERT_GE(planes.size(), 2u);
  for (const LargePlane& plane : planes) {
    const double floor = PaperStructure().FloorHeight();
    std::map<int, int> patches;
    for (const PlanePatch& patch : plane.patches) {
      EXPECT_LT(patch.variance, 1e-5);
      // Patches that reach round a corner are a little off.
      ++patches[SurfaceOf(pose * patch.p, floor, 0.002)];
    }
    const int off = patches[-1];
    patches.erase(-1);
    EXPECT_EQ(patches.size(), 1u) << "surfaces";
    EXPECT_LE(off, 0.05 * static_cast<double>(plane.patches.size()));
  }
}

TEST(FindLargePlanes, ABentWallIsOneSurfaceStill) {
  const Pose pose = RingPose(30);
  const auto seen = Render(PaperStructure(), KinectWithLens(), pose, {true, kWall});
  Intrinsics pinhole = KinectWithLens();
  pinhole.distortion.clear();
  const auto patches = [&](const Intrinsics& intrinsics) {
    std::size_t count = 0;
    for (const LargePlane& plane : FindLargePlanes(MakeSensorView(seen.depth, intrinsics)))
      count = std::max(count, plane.patches.size());
    return count;
  };
  EXPECT_GE(patches(pinhole), 0.8 * static_cast<double>(patches(KinectWithLens())));
}

TEST(FindLargePlanes, SmallOnesAreLeftOut) {
  const auto seen = Render(PaperStructure(), Kinect(), RingPose(30), {false, 0});
  EXPECT_TRUE(FindLargePlanes(MakeSensorView(seen.depth, Kinect())).empty())
      << "the stack's sides are no walls";
}

// A wall that fills a picture, as much of it through a lens as without one. One block of five is
// held out.
TEST(FindLargePlanes, AreMeasuredOnThePlaneAtOneMetre) {
  for (const Intrinsics& intrinsics : {Kinect(), KinectWithLens()}) {
    const SensorView view =
        MakeSensorView(DepthImage(intrinsics.width, intrinsics.height, 2.0f), intrinsics);
    double all = 0;
    for (std::size_t i = 0; i < view.ray_areas.size(); ++i) all += view.ray_areas[i];
    const std::vector<LargePlane> planes = FindLargePlanes(view, 0.7 * all);
    ASSERT_EQ(planes.size(), 1u);
    EXPECT_NEAR(planes[0].picture_area / all, 0.8, 0.03);
    EXPECT_TRUE(FindLargePlanes(view, 0.9 * all).empty());
  }
}

}  // namespace
}  // namespace volalign::planes_test
