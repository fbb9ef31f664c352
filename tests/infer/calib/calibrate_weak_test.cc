// Every reason for which Calibrate calls a placed sensor weak, each brought about by a capture that
// a user could have, beside two sensors that are as they should be. What the reason names is
// compared with a count of the test's own.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <string>

#include "core/geometry/pose.h"
#include "core/geometry/visibility.h"
#include "infer/calib/calibrate.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/infer/calib/calibrate_rig.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::calibrate_weak_test {
namespace {

using namespace testing_infer;

constexpr std::size_t kSpoilt = 1;  // of ThreeSensors

/// The number that follows `before` in the sentence; NaN where there is none.
double NumberAfter(const std::string& sentence, const std::string& before) {
  const std::size_t at = sentence.find(before);
  const std::size_t digits =
      at == std::string::npos ? at : sentence.find_first_of("0123456789", at + before.size());
  return digits == std::string::npos ? std::nan("") : std::stod(sentence.substr(digits));
}

void ExpectWeak(const FrameResult& sensor, SensorCode code) {
  EXPECT_EQ(sensor.status, SensorStatus::kWeak) << ToString(sensor.code) << ": " << sensor.reason;
  EXPECT_EQ(sensor.code, code) << ToString(sensor.code) << ": " << sensor.reason;
  EXPECT_TRUE(sensor.structure_from_sensor.has_value());
  EXPECT_FALSE(sensor.hint.empty());
}

void ExpectOk(const FrameResult& sensor) {
  EXPECT_EQ(sensor.status, SensorStatus::kOk) << sensor.name << ": " << sensor.reason;
  EXPECT_EQ(sensor.code, SensorCode::kNone) << sensor.name;
  EXPECT_TRUE(sensor.reason.empty()) << sensor.name << ": " << sensor.reason;
}

void ExpectOthersOk(const CalibrationResult& result) {
  for (std::size_t i = 0; i < result.sensors.size(); ++i) {
    if (i != kSpoilt) ExpectOk(result.sensors[i]);
  }
}

/// Points of the pixels, in the structure frame, as the truth has them.
Eigen::Vector3d TruePoint(const SensorFrame& frame, int u, int v) {
  const Eigen::Vector2d ray = RayThroughLens(frame.intrinsics, static_cast<double>(u), v);
  return *frame.ground_truth * Eigen::Vector3d(frame.depth(u, v) * ray.homogeneous());
}

int CountLabelled(const LabelImage& labels) {
  return static_cast<int>(
      std::count_if(labels.begin(), labels.end(), [](std::uint8_t label) { return label > 0; }));
}

TEST(Weak, ARigAsItShouldBeIsNot) {
  const CalibrationResult result = CalibrateRig(ThreeSensors());
  for (const FrameResult& sensor : result.sensors) ExpectOk(sensor);
}

// The default's steps suffice for the same capture; after one, the poses are still on their way.
TEST(Weak, Unsettled) {
  CalibrateOptions options;
  options.refine.inner_iterations = 1;
  const CalibrationResult result = CalibrateRig(ThreeSensors(), options);
  EXPECT_FALSE(result.solve.settled);
  for (const FrameResult& sensor : result.sensors) ExpectWeak(sensor, SensorCode::kUnsettled);
  const CalibrationResult settled = CalibrateRig(ThreeSensors());
  EXPECT_TRUE(settled.solve.settled);
  EXPECT_TRUE(settled.solve.converged);
  EXPECT_LT(settled.solve.moved_m, 0.002);
}

// The network takes a cupboard for a side of the structure.
TEST(Weak, FewInliers) {
  Rig rig = ThreeSensors();
  SensorFrame& frame = rig.frames[kSpoilt];
  LabelImage& labels = rig.labels[kSpoilt];
  const auto cupboard = static_cast<std::uint8_t>(LabelOf(rig.structure, "bottom/front"));
  const int structure = CountLabelled(labels);
  int more = static_cast<int>(0.3 / 0.7 * structure);
  for (const auto [u, v] : Pixels(labels)) {
    if (more == 0) break;
    if (labels(u, v) > 0 || !(frame.depth(u, v) > 0)) continue;
    if (TruePoint(frame, u, v).y() < rig.structure.FloorHeight() + 0.1) continue;
    labels(u, v) = cupboard;
    --more;
  }
  ASSERT_EQ(more, 0);
  const CalibrationResult result = CalibrateRig(rig);
  const FrameResult& sensor = result.sensors[kSpoilt];
  ExpectWeak(sensor, SensorCode::kFewInliers);
  const double share = 100.0 * structure / CountLabelled(labels);
  EXPECT_NEAR(NumberAfter(sensor.reason, ""), share, 1) << sensor.reason;
  EXPECT_NEAR(100 * sensor.inlier_share, share, 1);
  EXPECT_LT(sensor.error->translation_m, 3e-3);
  ExpectOthersOk(result);
}

// A board stands 9 cm in front of half a side and passes for it.
TEST(Weak, LargeResidual) {
  Rig rig = ThreeSensors();
  SensorFrame& frame = rig.frames[kSpoilt];
  const LabelImage& labels = rig.labels[kSpoilt];
  const int side = LabelOf(rig.structure, "mid_top/right");
  int first = frame.depth.height(), last = 0;  // rows of the side
  for (const auto [u, v] : Pixels(labels)) {
    if (labels(u, v) != side) continue;
    first = std::min(first, v);
    last = v;
  }
  double squares = 0;
  int near = 0;
  for (const auto [u, v] : Pixels(labels)) {
    if (labels(u, v) == 0) continue;
    if (labels(u, v) == side && 2 * v < first + last) frame.depth(u, v) -= 0.125f;
    const double distance = DistanceToSurface(rig.structure, TruePoint(frame, u, v)).distance;
    if (distance >= 0.1) continue;
    squares += distance * distance;
    ++near;
  }
  const CalibrationResult result = CalibrateRig(rig);
  const FrameResult& sensor = result.sensors[kSpoilt];
  ExpectWeak(sensor, SensorCode::kLargeResidual);
  const double rms_mm = 1000 * std::sqrt(squares / near);
  EXPECT_GT(rms_mm, 22);
  // The boxes' estimated size and the pose take up a little of it.
  EXPECT_NEAR(NumberAfter(sensor.reason, "points are"), rms_mm, 1.5) << sensor.reason;
  EXPECT_NEAR(1000 * sensor.rms_to_structure_m, rms_mm, 1.5);
  EXPECT_LT(sensor.error->translation_m, 5e-3);
  ExpectOthersOk(result);
}

// The network knows two of the four boxes only.
TEST(Weak, LabelsDisagree) {
  Rig rig = ThreeSensors();
  LabelImage& labels = rig.labels[kSpoilt];
  const int all = CountLabelled(labels);
  Restrict(rig.structure, &labels, [](const Side& side) { return side.box < 2; });
  const double share = 100.0 * CountLabelled(labels) / all;
  ASSERT_LT(share, 45);
  const CalibrationResult result = CalibrateRig(rig);
  const FrameResult& sensor = result.sensors[kSpoilt];
  ExpectWeak(sensor, SensorCode::kLabelsDisagree);
  EXPECT_NEAR(NumberAfter(sensor.reason, "overlap by"), share, 1.5) << sensor.reason;
  EXPECT_NEAR(100 * sensor.label_iou, share, 1.5);
  EXPECT_LT(sensor.error->translation_m, 3e-3);
  ExpectOthersOk(result);
}

/// Of the sensor's position in any direction, m; by numerical derivatives.
double LargestSigmaOfPosition(const FrameResult& sensor) {
  constexpr double kStep = 1e-6;
  const Pose& pose = *sensor.structure_from_sensor;
  Eigen::Matrix<double, 3, 6> moved;
  for (int i = 0; i < 6; ++i) {
    const Vector6d step = kStep * Vector6d::Unit(i);
    moved.col(i) = (PerturbLeft(step, pose).translation() - pose.translation()) / kStep;
  }
  const Eigen::Matrix3d covariance = moved * sensor.covariance * moved.transpose();
  return std::sqrt(covariance.operatorNorm());
}

// From 4 m, through a gap that leaves the upper 29 cm of the structure.
TEST(Weak, Uncertain) {
  for (const bool gap : {true, false}) {
    Rig rig{PaperStructure(), {}, {}};
    rig.Add("S", RingPose(45, gap ? 4 : 3.8, 0.9), {true, 6});
    SensorFrame& frame = rig.frames[0];
    for (const auto [u, v] : Pixels(frame.depth)) {
      if (!gap || TruePoint(frame, u, v).y() > 0.52) continue;
      frame.depth(u, v) = 0;
      rig.labels[0](u, v) = 0;
    }
    AddNoise(&frame.depth, 0.004, 3);
    const FrameResult sensor = CalibrateRig(rig).sensors[0];
    if (!gap) {
      ExpectOk(sensor);
      EXPECT_LT(sensor.error->translation_m, 0.05);
      continue;
    }
    ExpectWeak(sensor, SensorCode::kUncertain);
    const double sigma_mm = 1000 * LargestSigmaOfPosition(sensor);
    const double sigma_deg =
        std::sqrt(sensor.covariance.bottomRightCorner<3, 3>().operatorNorm()) * 180 / M_PI;
    EXPECT_NEAR(NumberAfter(sensor.reason, "uncertain:"), sigma_mm, 0.06) << sensor.reason;
    EXPECT_NEAR(NumberAfter(sensor.reason, "mm and"), sigma_deg, 0.006) << sensor.reason;
    EXPECT_GT(sensor.error->translation_m, 0.015) << "it is right to be unsure";
    EXPECT_LT(sensor.error->translation_m, 3e-3 * sigma_mm);
  }
}

TEST(Weak, TypicalIntrinsics) {
  Rig rig = ThreeSensors();
  rig.frames[1].typical_intrinsics = true;
  const CalibrationResult result = CalibrateRig(rig);
  ExpectOk(result.sensors[0]);
  ExpectWeak(result.sensors[1], SensorCode::kTypicalIntrinsics);
}

// The same file under two names.
TEST(Weak, DuplicateDepth) {
  Rig rig = ThreeSensors();
  rig.frames[1].depth = rig.frames[0].depth;
  rig.labels[1] = rig.labels[0];
  const CalibrationResult result = CalibrateRig(rig);
  ExpectWeak(result.sensors[0], SensorCode::kDuplicateDepth);
  EXPECT_TRUE(Has(result.sensors[0].reason, "S1"));
  EXPECT_LT(result.sensors[0].error->translation_m, 3e-3);
  EXPECT_EQ(result.sensors[1].status, SensorStatus::kFailed);
  EXPECT_EQ(result.sensors[1].code, SensorCode::kDuplicateDepth);
  EXPECT_TRUE(Has(result.sensors[1].reason, "S0"));
  ExpectOk(result.sensors[2]);
}

// Two shots of one sensor, and of one that was moved by 5 cm between them.
TEST(Weak, SamePose) {
  for (const double moved : {0.0, 0.05}) {
    Rig rig = ThreeSensors();
    rig.frames.resize(1);
    rig.labels.resize(1);
    Pose pose = *rig.frames[0].ground_truth;
    pose.translation().y() += moved;
    rig.Add("S1", pose, {true, 3.5});
    rig.Add("S2", RingPose(245), {true, 3.5});
    AddNoise(&rig.frames[1].depth, 0.001, 1);
    const CalibrationResult result = CalibrateRig(rig);
    ExpectOk(result.sensors[2]);
    const PoseError gap = ComparePoses(*result.sensors[0].structure_from_sensor,
                                       *result.sensors[1].structure_from_sensor);
    EXPECT_NEAR(gap.translation_m, moved, 5e-3);
    for (const int i : {0, 1}) {
      const FrameResult& sensor = result.sensors[static_cast<std::size_t>(i)];
      if (moved > 0) {
        ExpectOk(sensor);
        continue;
      }
      ExpectWeak(sensor, SensorCode::kSamePose);
      const std::string other = i == 0 ? "S1 stands, within" : "S0 stands, within";
      EXPECT_NEAR(NumberAfter(sensor.reason, other), 1000 * gap.translation_m, 0.06)
          << sensor.reason;
      EXPECT_NEAR(NumberAfter(sensor.reason, "mm and"), gap.rotation_deg, 0.006) << sensor.reason;
    }
  }
}

// Nothing but the structure returns light, and nobody says which way up the sensor is mounted: the
// paper's structure is the same upside down.
TEST(Weak, Ambiguous) {
  struct Case {
    bool floor, mounting_known;
  };
  for (const Case& c : {Case{false, false}, Case{true, false}, Case{false, true}}) {
    Rig rig{PaperStructure(), {}, {}};
    rig.Add("S", RingPose(40), {c.floor, 0});
    if (!c.mounting_known) rig.frames[0].quarter_turns = kAutoTurns;
    const FrameResult sensor = CalibrateRig(rig).sensors[0];
    if (c.floor || c.mounting_known) {
      ExpectOk(sensor);
      EXPECT_LT(sensor.error->translation_m, 3e-3);
      continue;
    }
    ExpectWeak(sensor, SensorCode::kAmbiguous);
    EXPECT_TRUE(Has(sensor.reason, "upside down"));
    EXPECT_TRUE(Has(sensor.hint, "quarter_turns"));
  }
}

// The intrinsics of another sensor, with a focal length that is 7 % longer.
TEST(Weak, IntrinsicsSuspect) {
  Rig rig = ThreeSensors();
  for (std::size_t i = 0; i < rig.frames.size(); ++i) AddNoise(&rig.frames[i].depth, 0.003, i);
  const Intrinsics right = rig.frames[kSpoilt].intrinsics;
  rig.frames[kSpoilt].intrinsics.fx *= 1.07;
  rig.frames[kSpoilt].intrinsics.fy *= 1.07;
  CalibrationResult result = CalibrateRig(rig);
  ExpectWeak(result.sensors[kSpoilt], SensorCode::kIntrinsicsSuspect);
  EXPECT_NEAR(NumberAfter(result.sensors[kSpoilt].reason, "fx ="), right.fx, 0.01 * right.fx)
      << result.sensors[kSpoilt].reason;
  ExpectOthersOk(result);

  rig.frames[kSpoilt].intrinsics = right;
  result = CalibrateRig(rig);
  ExpectOk(result.sensors[kSpoilt]);
  EXPECT_LT(result.sensors[kSpoilt].error->translation_m, 5e-3);
}

}  // namespace
}  // namespace volalign::calibrate_weak_test
