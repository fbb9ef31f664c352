// One sensor of a ring saw something else than the others: through another lens than it says, or
// another stack. It is named, and the others are as accurate as without it.

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "infer/calib/calibrate.h"
#include "tests/infer/calib/calibrate_rig.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::calibrate_disagrees_test {
namespace {

using namespace testing_infer;

constexpr std::size_t kSensors = 6, kOdd = 2;

/// A ring in a room, with errors; the odd sensor sees `odd`, the others the stack as described.
Rig Ring(const Structure& odd) {
  const Structure described = PaperStructure();
  Rig rig{described, {}, {}};
  for (std::size_t i = 0; i < kSensors; ++i) {
    rig.structure = i == kOdd ? odd : described;
    rig.Add(RingPose(60.0 * static_cast<double>(i) + 10, 2.0, 0.4), {true, 3.5});
    AddNoise(&rig.frames[i].depth, 0.0015, i);
    AddSmoothError(&rig.frames[i].depth, 0.0015, 8, i);
  }
  rig.structure = described;
  return rig;
}

Rig WithoutTheOddOne(Rig rig) {
  rig.frames.erase(rig.frames.begin() + kOdd);
  rig.labels.erase(rig.labels.begin() + kOdd);
  return rig;
}

/// Lenses are not estimated: an estimate would mend the intrinsics.
CalibrationResult CalibrateAsGiven(const Rig& rig) {
  CalibrateOptions options;
  options.refine.estimate = "boxes,size,depth_gain,depth_offset";
  return CalibrateRig(rig, options);
}

void ExpectOddOneNamed(const Rig& rig, const std::vector<SensorCode>& codes) {
  const CalibrationResult result = CalibrateAsGiven(rig);
  const CalibrationResult others = CalibrateAsGiven(WithoutTheOddOne(rig));
  for (std::size_t i = 0; i < kSensors; ++i) {
    const FrameResult& sensor = result.sensors[i];
    if (i == kOdd) {
      EXPECT_EQ(sensor.status, SensorStatus::kWeak);
      EXPECT_EQ(std::count(codes.begin(), codes.end(), sensor.code), 1)
          << ToString(sensor.code) << ": " << sensor.reason;
      ASSERT_TRUE(sensor.together.has_value());
      EXPECT_GT(ComparePoses(*sensor.together, *sensor.structure_from_sensor).translation_m, 1e-4);
      EXPECT_FALSE(sensor.disagrees_with.empty());
      EXPECT_EQ(std::count(sensor.disagrees_with.begin(), sensor.disagrees_with.end(), sensor.name),
                0);
      EXPECT_GT(sensor.disagreement, 17);
    } else {
      EXPECT_EQ(sensor.status, SensorStatus::kOk) << sensor.name << ": " << sensor.reason;
      EXPECT_FALSE(sensor.together.has_value());
      const FrameResult& without = others.sensors[i < kOdd ? i : i - 1];
      EXPECT_LT(sensor.error->translation_m, without.error->translation_m + 1e-3) << sensor.name;
    }
  }
}

TEST(Disagrees, NoneOfARingThatSawOneStack) {
  for (const FrameResult& sensor : CalibrateRig(Ring(PaperStructure())).sensors) {
    EXPECT_EQ(sensor.status, SensorStatus::kOk) << sensor.reason;
    EXPECT_FALSE(sensor.together.has_value());
  }
}

TEST(Disagrees, OneWithAnotherFocalLength) {
  Rig rig = Ring(PaperStructure());
  rig.frames[kOdd].intrinsics.fx *= 1.06;
  rig.frames[kOdd].intrinsics.fy *= 1.06;
  // Where its own view gives the focal length away, that is what it is named for.
  ExpectOddOneNamed(rig, {SensorCode::kDisagrees, SensorCode::kIntrinsicsSuspect});
}

TEST(Disagrees, OneThatSawABoxElsewhere) {
  const Structure described = PaperStructure();
  std::vector<Pose> offsets(described.boxes().size(), Pose::Identity());
  offsets[2].translation() = Eigen::Vector3d(0.025, 0, 0.02);
  ExpectOddOneNamed(Ring(described.Displaced(offsets, 1)), {SensorCode::kDisagrees});
}

}  // namespace
}  // namespace volalign::calibrate_disagrees_test
