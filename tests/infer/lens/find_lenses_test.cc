#include "infer/lens/find_lenses.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "tests/infer/view/synthetic.h"

namespace volalign::find_lenses_test {
namespace {

using testing_infer::AddNoise;
using testing_infer::AddSmoothError;
using testing_infer::Kinect;
using testing_infer::KinectWithLens;
using testing_infer::PaperStructure;
using testing_infer::RayThroughLens;
using testing_infer::Rig;
using testing_infer::RingPose;

/// Three sensors in a room, each with its own errors. The frames give the lens's pinhole alone.
std::vector<SensorFrame> FramesThrough(const Intrinsics& lens, std::uint64_t seed = 1) {
  Rig rig{PaperStructure(), {}, {}};
  for (int i = 0; i < 3; ++i)
    rig.Add("S" + std::to_string(i), RingPose(25.0 + 110 * i, 2, 0.4, 90), {true, 3.2}, lens);
  for (std::size_t i = 0; i < 3; ++i) {
    SensorFrame& frame = rig.frames[i];
    AddNoise(&frame.depth, 0.001, 10 * seed + i);
    AddSmoothError(&frame.depth, 0.003, 40, 10 * seed + i);
    frame.intrinsics.distortion.clear();
  }
  return rig.frames;
}

/// Checks that the views are through the lenses that are found.
LensSet Find(std::vector<SensorFrame> frames, const std::string& kind, bool per_sensor = false) {
  for (SensorFrame& frame : frames) frame.sensor = kind;
  const CaptureSet capture({{"", std::move(frames)}}, {});
  FoundLenses found = FindLenses(capture, AssumeLenses(capture, per_sensor), 2);
  for (const FrameId id : found.views.Ids()) {
    const SensorView view = MakeSensorView(capture[id], found.lenses.Effective(id));
    EXPECT_EQ(found.views[id].rays.rays, view.rays.rays);
  }
  return std::move(found.lenses);
}

/// Radius, on the plane z = 1, that a lens shows where the true one shows `radius`.
double RadiusShown(const Intrinsics& found, const Intrinsics& truth, double radius) {
  const double r2 = radius * radius;
  const auto& d = truth.distortion;
  const double factor =
      (1 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]))) / (1 + r2 * (d[5] + r2 * (d[6] + r2 * d[7])));
  return RayThroughLens(found, found.cx + truth.fx * radius * factor, found.cy).norm();
}

TEST(FindLenses, WallsTellTheLensOfAnUnknownKind) {
  const Intrinsics truth = KinectWithLens();
  const LensSet lenses = Find(FramesThrough(truth), "some_kind");
  ASSERT_EQ(lenses.lenses.size(), 1u);
  for (const double radius : {0.2, 0.4, 0.6}) {
    // The pinhole is off by 1, 5 and 10 %. Planes leave the scale of all rays open.
    const double scale = RadiusShown(lenses.Effective({}), truth, 0.3) / 0.3;
    EXPECT_NEAR(RadiusShown(lenses.Effective({}), truth, radius) / scale, radius, 0.012 * radius);
  }
  EXPECT_EQ(lenses.lenses[0].change[0], 0) << "planes tell nothing about the focal length";
}

TEST(FindLenses, APinholeStaysOne) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const LensSet lenses = Find(FramesThrough(Kinect(), seed), "", true);
    ASSERT_EQ(lenses.lenses.size(), 3u);
    for (const SensorLens& lens : lenses.lenses) EXPECT_TRUE(lens.change.isZero()) << lens.change;
  }
}

TEST(FindLenses, AKnownKindIsAtItsCurve) {
  const Intrinsics truth = KinectWithLens();
  const LensSet lenses = Find(FramesThrough(truth), "azure_kinect_nfov_binned");
  for (const double radius : {0.2, 0.4, 0.6})
    EXPECT_NEAR(RadiusShown(lenses.Effective({}), truth, radius), radius, 0.004 * radius);
}

TEST(FindLenses, KnownLensesStay) {
  const std::vector<SensorFrame> frames = FramesThrough(KinectWithLens());
  const CaptureSet capture({{"", frames}}, {});
  const LensSet lenses = FindLenses(capture, GivenLenses(capture), 1).lenses;
  for (std::size_t i = 0; i < frames.size(); ++i)
    EXPECT_TRUE(lenses.Effective({0, i}) == frames[i].intrinsics);
  // The planes say what they say all the same.
  EXPECT_GT(lenses.lenses[0].evidence.information(1, 1), 0);
}

}  // namespace
}  // namespace volalign::find_lenses_test
