// Several captures of the same sensors, the stack standing in another place in each.

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "infer/calib/calibrate.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::calibrate_placements_test {
namespace {

using namespace testing_infer;

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
}  // namespace volalign::calibrate_placements_test
