#include "infer/calib/calibrate.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "core/base/random.h"
#include "tests/core/base/long_tests.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/calib/calibrate_rig.h"
#include "tests/infer/initial/geometry_frames.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::calibrate_test {
namespace {

using namespace testing_infer;

TEST(Calibrate, NoiseFreeRingOfEightIsExact) {
  const Rig rig = RingOfEight();
  const CalibrationResult result = CalibrateRig(rig);
  ASSERT_EQ(result.sensors.size(), 8u);
  EXPECT_EQ(result.verdict(), SensorStatus::kOk);
  EXPECT_EQ(result.placed(), 8);
  for (const FrameResult& sensor : result.sensors) {
    ASSERT_TRUE(sensor.error.has_value());
    // Silhouettes end with a pixel, of 8 mm here, and a head-on view has little else sideways.
    EXPECT_TRUE(Within(*sensor.error, 1.5e-3, 0.05)) << sensor.name;
    EXPECT_LT(sensor.rms_to_structure_m, 1e-3);
    EXPECT_GT(sensor.inlier_share, 0.999);
    EXPECT_GT(sensor.label_iou, 0.98);
    EXPECT_GE(sensor.sides.size(), 5u);
    EXPECT_EQ(sensor.code, SensorCode::kNone);
    EXPECT_GT(sensor.sigma_position_m().minCoeff(), 0);
  }
  ASSERT_TRUE(result.metrics.has_value());
  // A sample of a 5 mm grid is at most 3.6 mm away, 2 mm in the mean square.
  EXPECT_LT(result.metrics->d1, 2.5e-3);
  EXPECT_GE(result.metrics->d2, result.metrics->d1);
  EXPECT_GE(result.pairs.size(), 8u);
}

TEST(Calibrate, NoiseAndWrongLabelsCostMillimetres) {
  Rig rig = RingOfEight({true, 3.5});
  for (std::size_t i = 0; i < rig.frames.size(); ++i) {
    AddNoise(&rig.frames[i].depth, 0.005, i);
    RandomStream random(7, i, "labels");
    for (std::uint8_t& label : rig.labels[i]) {
      if (random.Chance(0.1)) label = static_cast<std::uint8_t>(random.Below(21));
    }
  }
  for (const FrameResult& sensor : CalibrateRig(rig).sensors) {
    ASSERT_TRUE(sensor.error.has_value()) << sensor.name << " " << sensor.reason;
    EXPECT_TRUE(Within(*sensor.error, 0.01, 0.2)) << sensor.name;
  }
}

TEST(Calibrate, ASensorThatCannotBePlacedLeavesTheOthersAlone) {
  Rig rig = RingOfEight();
  rig.frames.resize(5);
  rig.labels.resize(5);
  // S1: no depth. S2: the three sides with collinear centres. S3: sees nothing of the structure.
  std::fill(rig.frames[1].depth.begin(), rig.frames[1].depth.end(), 0.0f);
  rig.frames[2].depth = rig.frames[0].depth;
  rig.labels[2] = rig.labels[0];
  rig.frames[2].depth(0, 0) = 3.3f;
  Restrict(rig.structure, &rig.labels[2], [](const Side& side) {
    return side.name == "mid_bottom/front" || side.name == "mid_top/front" ||
           side.name == "top/front";
  });
  const auto away = Render(rig.structure, Kinect(), RingPose(0, 2.0, 0.4, 90, {5, 0, 0}));
  rig.frames[3].depth = away.depth;
  rig.labels[3] = away.labels;
  CalibrateOptions options;
  options.refine.max_overlap_points = 0;  // by which S2 would be placed
  const CalibrationResult result = CalibrateRig(rig, options);
  EXPECT_EQ(result.placed(), 2);
  EXPECT_EQ(result.verdict(), SensorStatus::kFailed);
  const std::vector<SensorCode> codes = {SensorCode::kNone, SensorCode::kNoDepth,
                                         SensorCode::kDegenerateSides, SensorCode::kNoStructure,
                                         SensorCode::kNone};
  for (std::size_t i = 0; i < 5; ++i) {
    const FrameResult& sensor = result.sensors[i];
    EXPECT_EQ(sensor.code, codes[i]) << sensor.name << ": " << sensor.reason;
    const bool placed = codes[i] == SensorCode::kNone;
    EXPECT_EQ(sensor.status, placed ? SensorStatus::kOk : SensorStatus::kFailed) << sensor.reason;
    EXPECT_EQ(sensor.structure_from_sensor.has_value(), placed);
    if (placed) {
      EXPECT_LT(sensor.error->translation_m, 1.5e-3);
    } else {
      EXPECT_FALSE(sensor.reason.empty());
      EXPECT_FALSE(sensor.hint.empty());
    }
  }
}

// Rooms with boxes like the structure's, and a network that takes their faces for sides of the
// structure.
TEST(Calibrate, ARoomWithoutTheStructureFailsForEverySeed) {
  const Structure structure = PaperStructure();
  std::vector<SensorFrame> frames;
  StoredSegmenter segmenter;
  for (std::uint64_t seed = 0; seed < Rounds(6, 50); ++seed) {
    RandomStream random(seed, 0, "fake_room");
    std::vector<Box> boxes;
    const int count = 3 + random.Below(6);
    for (int i = 0; i < count; ++i) {
      const Eigen::Vector3d size{random.Uniform(0.25, 0.8), random.Uniform(0.3, 1.5),
                                 random.Uniform(0.25, 0.8)};
      const double x = random.Uniform(-2, 1), z = random.Uniform(-1.8, 1.8);
      boxes.push_back(Standing("clutter" + std::to_string(i), size, {x, structure.FloorHeight(), z},
                               random.Uniform(0, 86)));
    }
    Rig room{Structure::FromBoxes("clutter", boxes), {}, {}};
    room.Add("room" + std::to_string(seed), RingPose(random.Uniform(0, 360), 2.5, 0.4), {true, 4});
    // Each visible face gets one side's label, with the right orientation more often than not.
    std::vector<std::uint8_t> given(static_cast<std::size_t>(room.structure.num_classes()), 0);
    for (int label = 1; label < room.structure.num_classes(); ++label) {
      if (random.Chance(0.2)) continue;
      const Face face = room.structure.SideOfLabel(label).face();
      int guess = 0;
      for (int i = 0; i < 6 && (i == 0 || structure.SideOfLabel(guess).face() != face); ++i)
        guess = 1 + random.Below(structure.num_classes() - 1);
      given[static_cast<std::size_t>(label)] = static_cast<std::uint8_t>(guess);
    }
    for (std::uint8_t& label : room.labels[0])
      label = random.Chance(0.05) ? std::uint8_t{0} : given[label];
    segmenter.Store(room.frames[0].depth, Certain(room.labels[0]));
    frames.push_back(room.frames[0]);
  }
  const CalibrationResult result = Calibrate(frames, structure, segmenter);
  for (const FrameResult& sensor : result.sensors) {
    EXPECT_EQ(sensor.status, SensorStatus::kFailed)
        << sensor.name << ": explained " << sensor.explained_share << ", label IoU "
        << sensor.label_iou << ", inliers " << sensor.inlier_share;
    EXPECT_TRUE(sensor.code == SensorCode::kNoStructure ||
                sensor.code == SensorCode::kInconsistent ||
                sensor.code == SensorCode::kDegenerateSides)
        << ToString(sensor.code);
  }
}

// The default's steps suffice for the same capture; after one, the poses are still on their way.
TEST(Calibrate, OneStepIsTooFewToSettle) {
  CalibrateOptions options;
  options.refine.inner_iterations = 1;
  const CalibrationResult result = CalibrateRig(ThreeSensors(), options);
  EXPECT_FALSE(result.solve.settled);
  for (const FrameResult& sensor : result.sensors) {
    EXPECT_EQ(sensor.status, SensorStatus::kWeak) << sensor.reason;
    EXPECT_EQ(sensor.code, SensorCode::kUnsettled) << sensor.reason;
  }
  const CalibrationResult settled = CalibrateRig(ThreeSensors());
  EXPECT_TRUE(settled.solve.settled);
  EXPECT_TRUE(settled.solve.converged);
  EXPECT_LT(settled.solve.moved_m, 0.002);
  EXPECT_EQ(settled.verdict(), SensorStatus::kOk);
}

}  // namespace
}  // namespace volalign::calibrate_test
