// Poses that are known beforehand: what they add, and what a wrong one does.

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "infer/calib/calibrate.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/calib/calibrate_rig.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::calibrate_priors_test {
namespace {

using namespace testing_infer;

/// A world that is turned and shifted against the structure.
Pose StructureFromWorld() {
  return PerturbLeft((Vector6d() << 1.2, -0.4, 2.5, 0.3, 0.8, -0.2).finished(), Pose::Identity());
}

/// A movement of a sensor by a vector, m, and a turn about one, deg, in its own place.
Pose Moved(const Pose& pose, const Eigen::Vector3d& by, const Eigen::Vector3d& turned_deg) {
  Pose moved = pose;
  moved.translation() += by;
  moved.linear() = RotationExp(turned_deg * kDegree) * pose.linear();
  return moved;
}

/// Gives every sensor a prior that is 2 cm and 1 deg off, each in another direction.
void GivePriors(PriorWorld world, std::vector<SensorFrame>* frames, double scale = 1) {
  for (std::size_t i = 0; i < frames->size(); ++i) {
    const Eigen::Vector3d way =
        (Eigen::Vector3d(1, 0.3, -1) * (i % 2 == 0 ? 1 : -1) + Eigen::Vector3d(0, i % 3, 1))
            .normalized();
    PosePrior prior{Pose::Identity(), world, 0.05, 3};
    prior.world_from_sensor = Moved(*(*frames)[i].ground_truth, 0.02 * way, way);
    if (world != PriorWorld::kStructure)
      prior.world_from_sensor = StructureFromWorld().inverse() * prior.world_from_sensor;
    prior.world_from_sensor.translation() *= scale;
    (*frames)[i].prior = prior;
  }
}

/// Eight sensors round the paper's structure, with noise.
Rig Ring() {
  Rig rig{PaperStructure(), {}, {}};
  for (int i = 0; i < 8; ++i) {
    rig.Add(RingPose(10 + 45 * i, 1.9 + 0.05 * i), {true, 3});
    AddNoise(&rig.frames.back().depth, 0.003, static_cast<std::uint64_t>(i));
  }
  return rig;
}

void ExpectSamePoses(const CalibrationResult& a, const CalibrationResult& b, double most_m) {
  ASSERT_EQ(a.sensors.size(), b.sensors.size());
  for (std::size_t i = 0; i < a.sensors.size(); ++i) {
    ASSERT_TRUE(a.sensors[i].structure_from_sensor && b.sensors[i].structure_from_sensor);
    EXPECT_TRUE(Within(
        ComparePoses(*a.sensors[i].structure_from_sensor, *b.sensors[i].structure_from_sensor),
        most_m, 0.1))
        << i;
  }
}

std::vector<RigFinding> PriorFindings(const CalibrationResult& result) {
  std::vector<RigFinding> findings;
  for (const RigFinding& finding : result.findings) {
    if (finding.code == RigCode::kPriorOff) findings.push_back(finding);
  }
  return findings;
}

// Without priors it is ambiguous: calibrate_geometry_test.
TEST(CalibratePriors, MakeASymmetricStackUnambiguous) {
  Rig rig = RowInARoom(100);
  const std::vector<SensorFrame> bare = rig.frames;
  for (const bool of_one : {false, true}) {
    SCOPED_TRACE(of_one ? "of one sensor" : "of all");
    rig.frames = bare;
    GivePriors(PriorWorld::kStructure, &rig.frames);
    if (of_one) rig.frames[1].prior.reset();
    const CalibrationResult result = CalibrateByShape(rig.frames, rig.structure);
    EXPECT_TRUE(PriorFindings(result).empty());
    for (const FrameResult& sensor : result.sensors) {
      ASSERT_TRUE(sensor.error.has_value()) << sensor.name << sensor.reason;
      EXPECT_TRUE(Within(*sensor.error, 0.03, 0.6)) << sensor.name;
      EXPECT_NE(sensor.code, SensorCode::kAmbiguous) << sensor.reason;
      EXPECT_EQ(sensor.prior.has_value(), sensor.name == "S0" || !of_one);
    }
  }
  // In a world of their own they say where the sensors stand to each other, not how the stack lies.
  rig.frames = bare;
  GivePriors(PriorWorld::kMetric, &rig.frames);
  for (const FrameResult& sensor : CalibrateByShape(rig.frames, rig.structure).sensors)
    EXPECT_EQ(sensor.code, SensorCode::kAmbiguous) << sensor.name;
}

// Frames know poses to millimetres, priors to centimetres.
TEST(CalibratePriors, RightOnesChangeLittleInAnyWorld) {
  Rig rig = Ring();
  const CalibrationResult without = CalibrateRig(rig);
  const std::vector<SensorFrame> bare = rig.frames;
  struct Case {
    PriorWorld world;
    double scale;
  };
  for (const Case& each : {Case{PriorWorld::kStructure, 1}, Case{PriorWorld::kMetric, 1},
                           Case{PriorWorld::kScaleFree, 137}, Case{PriorWorld::kScaleFree, 0.2}}) {
    SCOPED_TRACE(static_cast<int>(each.world));
    rig.frames = bare;
    GivePriors(each.world, &rig.frames, each.scale);
    const CalibrationResult result = CalibrateRig(rig);
    EXPECT_TRUE(PriorFindings(result).empty()) << PriorFindings(result).front().reason;
    ExpectSamePoses(result, without, 0.002);
    for (const FrameResult& sensor : result.sensors) {
      ASSERT_TRUE(sensor.prior.has_value());
      EXPECT_TRUE(sensor.prior_used);
      EXPECT_TRUE(Within(ComparePoses(*sensor.prior, *sensor.structure_from_sensor), 0.04, 2))
          << sensor.name;
    }
  }
  rig.frames = bare;
  GivePriors(PriorWorld::kMetric, &rig.frames, 100);
  const CalibrationResult in_centimetres = CalibrateRig(rig);
  EXPECT_FALSE(PriorFindings(in_centimetres).empty());
  ExpectSamePoses(in_centimetres, without, 0.002);
}

// A prior that is better than the frames decides, and the covariance says so; in a world of its own
// it decides only how the sensors stand to each other.
TEST(CalibratePriors, ExactOnesDecide) {
  Rig rig{PaperStructure(), {}, {}};
  for (int i = 0; i < 3; ++i) {
    rig.Add(RingPose(20 + 60 * i), {true, 3});
    AddNoise(&rig.frames.back().depth, 0.006, static_cast<std::uint64_t>(i));
  }
  const CalibrationResult without = CalibrateRig(rig);
  for (const PriorWorld world : {PriorWorld::kStructure, PriorWorld::kMetric}) {
    const bool in_structure = world == PriorWorld::kStructure;
    for (SensorFrame& frame : rig.frames) {
      PosePrior prior;
      prior.world = world;
      prior.world_from_sensor =
          (in_structure ? Pose::Identity() : StructureFromWorld().inverse()) * *frame.ground_truth;
      prior.sigma_m = 0.0005;
      prior.sigma_deg = 0.01;
      frame.prior = prior;
    }
    const CalibrationResult result = CalibrateRig(rig);
    EXPECT_TRUE(PriorFindings(result).empty());
    for (std::size_t i = 0; i < 3; ++i) {
      const FrameResult& sensor = result.sensors[i];
      ASSERT_TRUE(sensor.error.has_value());
      const double sigma = sensor.sigma_position_m().maxCoeff();
      const double before = without.sensors[i].sigma_position_m().maxCoeff();
      if (in_structure) {
        EXPECT_TRUE(Within(*sensor.error, 0.001, 0.02)) << i;
        EXPECT_LT(sigma, 0.0006) << i;
      } else {
        EXPECT_GT(sigma, before / 3) << i;
      }
    }
    ASSERT_FALSE(result.pairs.empty());
    EXPECT_LT(result.pairs.front().sigma_m, 0.002);
  }
}

TEST(CalibratePriors, OneOfEightIsWrong) {
  Rig rig = Ring();
  const CalibrationResult without = CalibrateRig(rig);
  const std::vector<SensorFrame> bare = rig.frames;
  for (const PriorWorld world : {PriorWorld::kStructure, PriorWorld::kMetric}) {
    SCOPED_TRACE(static_cast<int>(world));
    rig.frames = bare;
    GivePriors(world, &rig.frames);
    Pose& wrong = rig.frames[3].prior->world_from_sensor;
    wrong = Moved(wrong, {0.4, 0, -0.3}, {0, 0, 0});  // ten standard deviations
    const CalibrationResult result = CalibrateRig(rig);
    const std::vector<RigFinding> findings = PriorFindings(result);
    ASSERT_EQ(findings.size(), 1u);
    EXPECT_EQ(findings[0].about, std::vector<std::string>{"S3"});
    EXPECT_TRUE(Has(findings[0].reason, "0.48 m"));
    EXPECT_FALSE(result.sensors[3].prior_used);
    EXPECT_TRUE(result.sensors[2].prior_used);
    EXPECT_EQ(result.verdict(), SensorStatus::kWeak);
    ExpectSamePoses(result, without, 0.002);
  }
}

TEST(CalibratePriors, AllAreWrongByACommonMotion) {
  Rig rig = Ring();
  const CalibrationResult without = CalibrateRig(rig);
  GivePriors(PriorWorld::kMetric, &rig.frames);
  for (SensorFrame& frame : rig.frames) frame.prior->world = PriorWorld::kStructure;
  const CalibrationResult result = CalibrateRig(rig);
  const std::vector<RigFinding> findings = PriorFindings(result);
  ASSERT_EQ(findings.size(), 1u);
  EXPECT_TRUE(findings[0].about.empty());
  EXPECT_TRUE(Has(findings[0].hint, "world_from_sensor"));
  ExpectSamePoses(result, without, 0.002);
}

// Two faces of one box leave the height open.
TEST(CalibratePriors, PlaceASensorThatSeesTwoFaces) {
  Rig rig{PaperStructure(), {}, {}};
  for (int i = 0; i < 3; ++i) rig.Add(RingPose(100 + 50 * i), {true, 3});
  rig.Add(RingPose(45), {true, 3});
  LabelImage& labels = rig.labels[3];
  const std::vector<int> seen = LabelsOf(rig.structure, {"mid_bottom/front", "mid_bottom/right"});
  for (std::uint8_t& label : labels) {
    if (std::find(seen.begin(), seen.end(), static_cast<int>(label)) == seen.end()) label = 0;
  }
  // What it does not show is not measured.
  for (std::size_t i = 0; i < labels.size(); ++i) {
    if (labels.data()[i] == 0) rig.frames[3].depth.data()[i] = 0;
  }
  CalibrateOptions options;
  options.refine.max_overlap_points = 0;
  const CalibrationResult without = CalibrateRig(rig, options);
  ASSERT_EQ(without.sensors[3].status, SensorStatus::kFailed);
  for (const PriorWorld world : {PriorWorld::kStructure, PriorWorld::kMetric}) {
    GivePriors(world, &rig.frames);
    const CalibrationResult result = CalibrateRig(rig, options);
    ASSERT_TRUE(result.sensors[3].error.has_value()) << result.sensors[3].reason;
    EXPECT_EQ(result.sensors[3].initial_source, PoseSource::kPrior);
    EXPECT_TRUE(Within(*result.sensors[3].error, 0.06, 1));
    EXPECT_LT(result.sensors[3].error->translation_m,
              4 * result.sensors[3].sigma_position_m().norm());
  }
}

}  // namespace
}  // namespace volalign::calibrate_priors_test
