#include "infer/calib/calibrate.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
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

// Several captures of the same sensors, the stack standing in another place in each.

Pose Placement(double x, double z, double yaw_deg) {
  return MakePose({0, yaw_deg * M_PI / 180, 0}, {x, 0, z});
}

/// The same sensors about the stack in several places.
struct Studio {
  std::vector<Pose> sensors;     // in the structure where it stands first
  std::vector<Pose> placements;  // first_from_placement
  std::uint64_t seed = 0;
  double error = 0.003;  // m, of smooth depth errors, drawn anew in each capture
  /// Whether a sensor's picture shows the stack in a capture.
  std::function<bool(std::size_t sensor, std::size_t capture)> sees = [](std::size_t, std::size_t) {
    return true;
  };

  std::vector<Rig> Rigs() const {
    std::vector<Rig> rigs;
    for (std::size_t s = 0; s < placements.size(); ++s) {
      Rig rig{PaperStructure(), {}, {}};
      for (std::size_t i = 0; i < sensors.size(); ++i) {
        Pose pose = placements[s].inverse() * sensors[i];
        if (!sees(i, s)) pose.linear() = pose.linear() * RotationExp(Eigen::Vector3d(2, 0, 0));
        rig.Add(pose, {true, 4, placements[s]});
        AddNoise(&rig.frames[i].depth, 0.001, seed + 100 * s + i);
        AddSmoothError(&rig.frames[i].depth, error, 25, seed + 100 * s + i);
      }
      rigs.push_back(std::move(rig));
    }
    return rigs;
  }
};

Studio FiveSensors() {
  Studio studio;
  for (int i = 0; i < 5; ++i) studio.sensors.push_back(RingPose(20.0 + 72 * i, 2.2, 0.4));
  studio.placements = {Placement(0, 0, 0), Placement(0.5, -0.3, 70), Placement(-0.4, 0.4, 200)};
  return studio;
}

CalibrationResult CalibrateCaptures(const std::vector<Rig>& rigs,
                                    const CalibrateOptions& options = {}) {
  StoredSegmenter segmenter;
  std::vector<Capture> captures;
  for (const Rig& rig : rigs) {
    for (std::size_t i = 0; i < rig.frames.size(); ++i)
      segmenter.Store(rig.frames[i].depth, Certain(rig.labels[i]));
    captures.push_back({"capture " + std::to_string(captures.size()), rig.frames});
  }
  return Calibrate(captures, rigs.front().structure, segmenter, options);
}

double MeanError(const CalibrationResult& result) {
  double sum = 0;
  for (const FrameResult& sensor : result.sensors) {
    EXPECT_TRUE(sensor.error) << sensor.name << ": " << sensor.reason;
    sum += sensor.error ? sensor.error->translation_m : 1;
  }
  return sum / static_cast<double>(result.sensors.size());
}

TEST(CalibrateCaptures, SeveralPlacementsAreOneProblem) {
  Studio studio = FiveSensors();
  studio.seed = 1000;
  const std::vector<Rig> rigs = studio.Rigs();
  const CalibrationResult one = CalibrateCaptures({rigs[0]}), all = CalibrateCaptures(rigs);
  EXPECT_TRUE(one.captures.empty());
  ASSERT_EQ(all.captures.size(), 3u);
  ASSERT_EQ(all.sensors.size(), 5u);
  EXPECT_LT(MeanError(all), 0.75 * MeanError(one)) << "errors are drawn anew in each capture";
  for (std::size_t s = 0; s < 3; ++s) {
    EXPECT_TRUE(Within(ComparePoses(all.captures[s].first_from_placement, studio.placements[s]),
                       s == 0 ? 1e-12 : 0.003, s == 0 ? 1e-9 : 0.1))
        << s;
    for (const FrameResult& frame : all.captures[s].sensors) {
      ASSERT_TRUE(frame.structure_from_sensor);
      const Pose in_first = all.captures[s].first_from_placement * *frame.structure_from_sensor;
      for (const FrameResult& sensor : all.sensors) {
        if (sensor.name != frame.name) continue;
        EXPECT_LT(ComparePoses(in_first, *sensor.structure_from_sensor).translation_m, 0.0005)
            << frame.name << " stands in one place in all captures";
      }
    }
  }
}

TEST(CalibrateCaptures, ASensorIsPlacedThroughAnotherCapture) {
  // S0 sees the stack in the second capture alone, S1 in no capture that another sensor joins to
  // the first.
  Studio studio = FiveSensors();
  studio.sees = [](std::size_t sensor, std::size_t capture) {
    if (sensor == 0) return capture == 1;
    return (sensor == 1) == (capture == 2);
  };
  const CalibrationResult result = CalibrateCaptures(studio.Rigs());
  const FrameResult &through = result.sensors[0], &apart = result.sensors[1];
  EXPECT_EQ(through.status, SensorStatus::kOk) << through.reason;
  EXPECT_LT(through.error->translation_m, 0.006);
  EXPECT_EQ(apart.status, SensorStatus::kFailed);
  EXPECT_EQ(apart.code, SensorCode::kUnconnected) << apart.reason;
  for (std::size_t i = 2; i < 5; ++i)
    EXPECT_EQ(result.sensors[i].status, SensorStatus::kOk) << result.sensors[i].reason;
}

TEST(CalibrateCaptures, ASensorThatWasMovedBetweenCapturesIsNamed) {
  Studio studio = FiveSensors();
  std::vector<Rig> rigs = studio.Rigs();
  // S2 stands three centimetres away in the last capture.
  studio.sensors[2] = RingPose(20.0 + 72 * 2, 2.2 + 0.03, 0.4);
  rigs[2] = studio.Rigs()[2];
  const CalibrationResult result = CalibrateCaptures(rigs);
  for (std::size_t i = 0; i < 5; ++i) {
    const FrameResult& sensor = result.sensors[i];
    EXPECT_EQ(sensor.status, i == 2 ? SensorStatus::kWeak : SensorStatus::kOk)
        << i << ": " << sensor.reason;
    EXPECT_EQ(sensor.code, i == 2 ? SensorCode::kDisagrees : SensorCode::kNone) << sensor.reason;
    EXPECT_LT(sensor.error->translation_m, 0.006) << i << ": where it stood first";
  }
}

}  // namespace
}  // namespace volalign::calibrate_test
