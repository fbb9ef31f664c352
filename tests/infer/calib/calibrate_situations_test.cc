// Situations that rendered rooms do not have: nothing behind the structure, exact boxes, sensors
// that see too little of it, no floor in view, mirrored frames. Each of them from several places.

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "infer/calib/calibrate.h"
#include "infer/initial/symmetries.h"
#include "infer/report/report.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/calib/calibrate_rig.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::calibrate_situations_test {
namespace {

using namespace testing_infer;

void ExpectPlaced(const FrameResult& sensor, double metres, double degrees) {
  ASSERT_TRUE(sensor.error.has_value())
      << sensor.name << ": " << ToString(sensor.code) << ", " << sensor.reason;
  EXPECT_TRUE(Within(*sensor.error, metres, degrees)) << sensor.name;
}

// Straight before the four sides that face along +z, so low that no top is seen: nothing but their
// silhouettes fixes the place along them.
TEST(NothingBehind, FourParallelSidesFixAPose) {
  for (int k = 0; k < 6; ++k) {
    Rig rig{PaperStructure(), {}, {}};
    Pose pose = RingPose(90, 2.0 + 0.1 * k, -0.6, 90 + 2 * k, {-0.1, -0.1, 0});
    pose.translation().x() = -0.1;
    rig.Add("S", pose, {false, 0});
    LabelImage& labels = rig.labels[0];
    for (int label = 1; label < rig.structure.num_classes(); ++label) {
      const bool seen = std::count(labels.begin(), labels.end(), label) > 0;
      const bool parallel = rig.structure.SideOfLabel(label).normal.z() > 0.9;
      ASSERT_TRUE(!seen || parallel) << label;
    }
    const int most = k % 3 * 2;  // px missing round each edge, 0 to 4
    LeaveGaps(&rig.frames[0].depth, &labels, most > 0 ? 1 : 0, most, static_cast<unsigned>(k));
    AddNoise(&rig.frames[0].depth, 0.002, static_cast<unsigned>(k));
    const FrameResult sensor = CalibrateRig(rig).sensors[0];
    EXPECT_EQ(sensor.status, SensorStatus::kOk) << k << ": " << sensor.reason;
    ExpectPlaced(sensor, 0.012, 0.5);
    const Eigen::Vector3d off = sensor.structure_from_sensor->translation() - pose.translation();
    EXPECT_LT((off.cwiseAbs() - 3 * sensor.sigma_position_m()).maxCoeff(), 0) << k;
  }
}

/// Geometry would find what the labels leave open.
CalibrateOptions ByLabels() {
  CalibrateOptions options;
  options.initial.method = PoseMethod::kNetwork;
  return options;
}

/// m, mean error of the positions of six sensors round boxes that stand as described.
double ErrorWithExactBoxes(std::uint64_t seed, const std::string& estimate) {
  Rig rig{PaperStructure(), {}, {}};
  for (unsigned i = 0; i < 6; ++i) {
    rig.Add(RingPose(60.0 * i + 17 * static_cast<double>(seed), 2.0, 0.3), {true, 3.5});
    AddNoise(&rig.frames[i].depth, 0.001, seed + i);
    AddSmoothError(&rig.frames[i].depth, 0.001, 6, seed + i);
  }
  CalibrateOptions options;
  options.refine.estimate = estimate;
  double sum = 0;
  for (const FrameResult& sensor : CalibrateRig(rig, options).sensors)
    sum += sensor.error ? sensor.error->translation_m : 1;
  return sum / 6;
}

TEST(ExactBoxes, CostNothingWhereMoreIsEstimated) {
  for (const std::uint64_t seed : {3, 30}) {
    const double nominal = ErrorWithExactBoxes(seed, "none");
    const double estimated = ErrorWithExactBoxes(seed, "auto");
    EXPECT_LT(estimated, 0.0015) << seed;
    EXPECT_LT(estimated, nominal + 0.0005) << seed << ": " << nominal;
  }
}

/// Three sensors, and one whose network marks so few sides that they fix no pose.
Rig WithLostSensor(int k, const Scene& scene) {
  Rig rig{PaperStructure(), {}, {}};
  for (int i = 0; i < 3; ++i) rig.Add(RingPose(25.0 + 110 * i + 10 * k), scene);
  rig.Add("S3", RingPose(90, 2.0, 0.3, 90, Eigen::Vector3d(k % 2 ? 0.6 : -1.1, 0, 0)), scene);
  Restrict(rig.structure, &rig.labels[3], [&](const Side& side) {
    if (k == 2) return side.name == "mid_top/right";
    return side.name == "mid_bottom/right" || side.name == "mid_top/right" ||
           side.name == "bottom/right";
  });
  for (std::size_t i = 0; i < 4; ++i) AddNoise(&rig.frames[i].depth, 0.002, i);
  return rig;
}

TEST(Neighbours, PlaceASensorThatSeesTooFewSides) {
  for (int k = 0; k < 3; ++k) {
    const CalibrationResult result = CalibrateRig(WithLostSensor(k, {true, 3.5}), ByLabels());
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_EQ(result.sensors[i].status, SensorStatus::kOk) << result.sensors[i].reason;
      ExpectPlaced(result.sensors[i], 0.006, 0.1);
    }
    const FrameResult& lost = result.sensors[3];
    EXPECT_EQ(lost.status, SensorStatus::kWeak);
    EXPECT_EQ(lost.code, SensorCode::kByNeighbours) << ToString(lost.code) << lost.reason;
    EXPECT_TRUE(Has(lost.reason, "S0, S1, S2"));
    EXPECT_FALSE(lost.hint.empty());
    ExpectPlaced(lost, 0.008, 0.2);
    EXPECT_LT(lost.sigma_position_m().maxCoeff(), 0.03);
  }
}

// What it shares with them has to fix the pose: a part of one plane does not.
TEST(Neighbours, DoNotPlaceASensorThatCouldSlide) {
  Rig rig = WithLostSensor(2, {true, 3.5});
  SensorFrame& frame = rig.frames[3];
  const auto label = LabelOf(rig.structure, "mid_top/right");
  const Side& side = rig.structure.SideOfLabel(label);
  const SensorView view = MakeSensorView(frame.depth, frame.intrinsics);
  int left = 0;
  for (const auto [u, v] : Pixels(view)) {
    const Eigen::Vector3d p = *frame.ground_truth * view.Point(u, v) - side.centre;
    const bool inside = rig.labels[3](u, v) == label &&
                        Eigen::Vector2d(side.axis_u.dot(p), side.axis_v.dot(p)).norm() < 0.15;
    left += inside ? 1 : 0;
    if (inside) continue;
    frame.depth(u, v) = 0;
    rig.labels[3](u, v) = 0;
  }
  ASSERT_GT(left, 1000);
  const CalibrationResult result = CalibrateRig(rig);
  EXPECT_EQ(result.sensors[3].status, SensorStatus::kFailed);
  EXPECT_FALSE(result.sensors[3].structure_from_sensor.has_value());
  EXPECT_EQ(result.placed(), 3);
}

/// Labels that a network gives that takes the structure for one that stands upside down.
LabelImage UpsideDownLabels(const Rig& rig, std::size_t i) {
  const Pose motion = FindSymmetries(rig.structure).front().motion;
  LabelImage labels = CastView(rig.structure, ComputeRays(rig.frames[i].intrinsics),
                               motion * *rig.frames[i].ground_truth)
                          .labels;
  for (std::size_t k = 0; k < labels.size(); ++k) {
    if (rig.labels[i][k] == 0) labels[k] = 0;
  }
  return labels;
}

// S0 and S1 stand upright, and the others lie on their side. The network takes S1 and S4 for upside
// down: S0 and S1 contradict each other, and nothing joins either to the others.
TEST(OneUpForTheRig, WhatMayContradictTheOthersIsNotPlaced) {
  Rig rig{PaperStructure(), {}, {}};
  for (int i = 0; i < 6; ++i) {
    rig.Add(RingPose(20 + 60.0 * i, 1.9 + 0.1 * (i % 3), 0.2 + 0.1 * (i % 4), i < 2 ? 0 : 90),
            {false, 0});
    rig.frames.back().quarter_turns = kAutoTurns;
  }
  for (const std::size_t i : {1, 4}) rig.labels[i] = UpsideDownLabels(rig, i);
  const CalibrationResult result = CalibrateRig(rig);
  for (std::size_t i = 0; i < result.sensors.size(); ++i) {
    const FrameResult& sensor = result.sensors[i];
    EXPECT_EQ(sensor.code, SensorCode::kAmbiguous) << sensor.name;
    if (i < 2) {
      EXPECT_EQ(sensor.status, SensorStatus::kFailed) << sensor.name;
      EXPECT_TRUE(Has(sensor.reason, "Nothing shows which is right"));
      EXPECT_TRUE(Has(sensor.hint, "quarter_turns"));
    } else {
      ExpectPlaced(sensor, 0.015, 0.2);
    }
  }
}

TEST(MirroredFrames, AllOfThemMayAlsoBeTheStack) {
  Rig rig = ThreeSensors();
  for (std::size_t i = 0; i < 3; ++i) {
    AddNoise(&rig.frames[i].depth, 0.002, i);
    FlipFrame(rig.structure, &rig.frames[i], &rig.labels[i]);
  }
  const CalibrationResult result = CalibrateRig(rig);
  for (const FrameResult& sensor : result.sensors) {
    EXPECT_EQ(sensor.code, SensorCode::kAssemblyMirrored) << sensor.reason;
    EXPECT_TRUE(Has(sensor.hint, "if only the stack is mirrored", "in the pictures"));
  }
  const std::string report = FormatReport(result);
  const std::string sentence = ": this explains";
  EXPECT_TRUE(Has(report, sentence, "S0, S1, S2 failed"));
  EXPECT_EQ(report.find(sentence), report.rfind(sentence)) << "said once for all\n" << report;
}

}  // namespace
}  // namespace volalign::calibrate_situations_test
