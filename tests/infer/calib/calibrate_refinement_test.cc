// What Calibrate reports of the joint refinement: sensors that keep their initial poses, sensors
// that their neighbours' overlap holds alone, and figures of the pose that is reported.

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "core/geometry/visibility.h"
#include "infer/calib/calibrate.h"
#include "tests/infer/calib/calibrate_rig.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::calibrate_refinement_test {
namespace {

using testing_infer::AddSmoothError;
using testing_infer::CalibrateRig;
using testing_infer::Rig;
using testing_infer::RingOfEight;

/// A ring in a room whose sensors are off by a centimetre in patches, as a badly tuned stereo
/// sensor is. That is beyond what the noise model expects, so that of some the refined pose
/// explains the held-out points no better than the one from keypoints.
Rig WarpedRing(std::uint64_t seed) {
  Rig rig = RingOfEight({true, 3.5});
  for (std::size_t i = 0; i < rig.frames.size(); ++i)
    AddSmoothError(&rig.frames[i].depth, 0.012, 30, 10 * seed + i);
  return rig;
}

/// The first warped ring from the seed 5 on (those before have none) of which some sensors keep
/// their initial poses and others do not.
class KeptInitial : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    for (std::uint64_t seed = 5; seed <= 16; ++seed) {
      rig_ = WarpedRing(seed);
      result_ = CalibrateRig(rig_);
      if (result_.placed() != 8) continue;
      const auto kept = std::count_if(result_.sensors.begin(), result_.sensors.end(),
                                      [](const auto& s) { return !s.refinement_accepted; });
      found_ = kept > 0 && kept < 6;
      if (found_) return;
    }
  }
  void SetUp() override { ASSERT_TRUE(found_) << "none was refused: choose other errors"; }

  static inline bool found_ = false;
  static inline Rig rig_;
  static inline CalibrationResult result_;
};

TEST_F(KeptInitial, IsReportedAsItIs) {
  for (std::size_t i = 0; i < result_.sensors.size(); ++i) {
    const FrameResult& sensor = result_.sensors[i];
    if (sensor.refinement_accepted) {
      EXPECT_GT((sensor.structure_from_sensor->matrix() - sensor.initial.matrix()).norm(), 1e-6);
      continue;
    }
    EXPECT_EQ(
        (sensor.structure_from_sensor->matrix() - sensor.initial.matrix()).cwiseAbs().maxCoeff(), 0)
        << sensor.name;
    EXPECT_EQ(sensor.error->translation_m, sensor.initial_error->translation_m) << sensor.name;
    EXPECT_EQ(sensor.depth_offset_m, 0) << "its depths are taken as measured";
    EXPECT_EQ(sensor.depth_gain, 1) << "its depths are taken as measured";
    // The truth, in the units of the stated covariance of [translation; rotation vector]: 99.9 % of
    // six normal variables lie within 4.7.
    const Pose difference = *rig_.frames[i].ground_truth * sensor.structure_from_sensor->inverse();
    Vector6d delta;
    delta << difference.translation(), RotationLog(difference.linear());
    const double distance = std::sqrt(delta.dot(sensor.covariance.ldlt().solve(delta)));
    EXPECT_FALSE(!(distance < 4.7))
        << sensor.name << ": " << distance << "\n"
        << sensor.covariance.diagonal().cwiseSqrt().transpose() << " for " << delta.transpose();
  }
}

TEST_F(KeptInitial, LeavesTheOthersAsIfItWasNotThere) {
  Rig rest{rig_.structure, {}, {}};
  for (std::size_t i = 0; i < rig_.frames.size(); ++i) {
    if (!result_.sensors[i].refinement_accepted) continue;
    rest.frames.push_back(rig_.frames[i]);
    rest.labels.push_back(rig_.labels[i]);
  }
  const CalibrationResult others = CalibrateRig(rest);
  std::size_t j = 0;
  for (const FrameResult& sensor : result_.sensors) {
    if (!sensor.refinement_accepted) continue;
    const FrameResult& alone = others.sensors[j++];
    ASSERT_EQ(alone.name, sensor.name);
    ASSERT_TRUE(alone.structure_from_sensor.has_value()) << alone.reason;
    const PoseError gap = ComparePoses(*sensor.structure_from_sensor, *alone.structure_from_sensor);
    // Its neighbours' depth offsets, the boxes and what is estimated at all had been chosen with
    // it: up to 1.8 mm and 0.05 deg.
    EXPECT_LT(gap.translation_m, 5e-3) << sensor.name;
    EXPECT_LT(gap.rotation_deg, 0.15) << sensor.name;
  }
}

/// Figures as formats.md has them, counted here: of the reported pose and the boxes as found, with
/// corrected depths.
TEST_F(KeptInitial, FiguresAreOfTheReportedPose) {
  for (std::size_t i = 0; i < result_.sensors.size(); ++i) {
    const FrameResult& sensor = result_.sensors[i];
    const Pose& pose = *sensor.structure_from_sensor;
    const DepthImage& depth = rig_.frames[i].depth;
    const ExpectedView expected = CastView(result_.built, sensor.view.rays, pose);
    int visible = 0, explained = 0, same = 0, either = 0, near = 0, inliers = 0, points = 0;
    double squares = 0;
    for (int v = 0; v < depth.height(); ++v) {
      for (int u = 0; u < depth.width(); ++u) {
        if (!(depth(u, v) > 0)) continue;
        const double z = depth(u, v) * sensor.depth_gain + sensor.depth_offset_m;
        const Eigen::Vector2d ray = testing_infer::RayThroughLens(sensor.intrinsics, u, v);
        const double distance =
            DistanceToSurface(result_.built, pose * Eigen::Vector3d(z * ray.homogeneous()))
                .distance;
        const double tolerance = std::hypot(0.015, 3 * ErrorsOf("").Sigma(z));
        const int label = rig_.labels[i](u, v), shown = expected.labels(u, v);
        // An overhang's lower face is none of the sides that distances are measured to.
        const bool on = expected.depth(u, v) > 0 &&
                        (distance <= tolerance || std::abs(z - expected.depth(u, v)) <= tolerance);
        visible += expected.depth(u, v) > 0;
        explained += on;
        either += label > 0 || shown > 0;
        same += on && label > 0 && label == shown;
        if (label == 0) continue;
        ++points;
        inliers += distance <= tolerance;
        if (distance >= 0.1) continue;
        squares += distance * distance;
        ++near;
      }
    }
    EXPECT_EQ(sensor.points, points) << sensor.name;
    EXPECT_NEAR(sensor.rms_to_structure_m, std::sqrt(squares / near), 1e-5) << sensor.name;
    EXPECT_NEAR(sensor.inlier_share, static_cast<double>(inliers) / points, 1e-3) << sensor.name;
    EXPECT_NEAR(sensor.explained_share, static_cast<double>(explained) / visible, 4e-3)
        << sensor.name;
    EXPECT_NEAR(sensor.label_iou, static_cast<double>(same) / either, 4e-3) << sensor.name;
  }
}

/// Half of the labels, those of every second stripe of the picture, and none near a side's end.
LabelImage InStripes(const LabelImage& labels) {
  LabelImage some = labels;
  for (int v = 0; v < labels.height(); ++v) {
    for (int u = 0; u < labels.width(); ++u) {
      bool inside = u / 12 % 2 == 0;
      for (const int d : {-4, 4}) {
        inside = inside && labels.Contains(u + d, v) && labels(u + d, v) == labels(u, v) &&
                 labels.Contains(u, v + d) && labels(u, v + d) == labels(u, v);
      }
      if (!inside) some(u, v) = 0;
    }
  }
  return some;
}

// The points are labelled by the solution itself until it stays, whatever it began with.
TEST(LabelsToBeginWith, HardlyMatter) {
  Rig rig{testing_infer::PaperStructure(), {}, {}};
  for (int i = 0; i < 4; ++i) {
    rig.Add("S" + std::to_string(i), testing_infer::RingPose(20 + 90.0 * i, 2.0, 0.4), {true, 3.0});
    AddSmoothError(&rig.frames.back().depth, 0.004, 40, static_cast<std::uint64_t>(i));
  }
  const CalibrationResult all = CalibrateRig(rig);
  for (LabelImage& labels : rig.labels) labels = InStripes(labels);
  const CalibrationResult some = CalibrateRig(rig);
  double apart_at_first = 0;
  for (std::size_t i = 0; i < rig.frames.size(); ++i) {
    const FrameResult &a = all.sensors[i], &b = some.sensors[i];
    ASSERT_TRUE(a.structure_from_sensor && b.structure_from_sensor) << a.reason << b.reason;
    const PoseError apart = ComparePoses(*a.structure_from_sensor, *b.structure_from_sensor);
    EXPECT_LT(apart.translation_m, 1e-3) << a.name;
    apart_at_first = std::max(apart_at_first, ComparePoses(a.initial, b.initial).translation_m);
  }
  EXPECT_GT(apart_at_first, 0.005) << "nothing to settle";
}

}  // namespace
}  // namespace volalign::calibrate_refinement_test
