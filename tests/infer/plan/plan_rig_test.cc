#include "infer/plan/plan_rig.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "core/config/config.h"
#include "infer/plan/plan_report.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/core/base/tally.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::plan_rig_test {
namespace {

using namespace testing_infer;

volalign::Rig Parse(const std::string& yaml) {
  return ReadRig(ConfigSource::FromString(yaml, "rig"));
}

/// Of the paper's stack: S1 sees it whole, S2 a part of it from near, S3 nothing.
constexpr char kRig[] = R"(
sensors:
  - {name: S1, sensor: azure_kinect_nfov_binned, rho_cm: 200, phi_deg: 30, height_cm: 110}
  - {name: S2, sensor: azure_kinect_nfov_binned, rho_cm: 90, phi_deg: 120, height_cm: 40, look_at_cm: [0, 60, 0]}
  - {name: S3, sensor: azure_kinect_nfov_binned, rho_cm: 200, phi_deg: 210, height_cm: 110, look_at_cm: [-400, 0, -200]}
)";

TEST(PlanRig, SaysWhatEachSensorSees) {
  const RigPlan plan = PlanRig(Parse(kRig), 1);
  ASSERT_EQ(plan.sensors.size(), 3u);
  const PlannedSensor &whole = plan.sensors[0], &part = plan.sensors[1], &away = plan.sensors[2];
  EXPECT_EQ(whole.placed, 1);
  EXPECT_DOUBLE_EQ(whole.in_view, 1);
  EXPECT_GE(whole.sides.size(), 8u);
  EXPECT_TRUE(whole.sides_fix_pose);
  EXPECT_LT(part.in_view, 0.7);
  EXPECT_GT(part.in_view, 0);
  EXPECT_EQ(away.placed, 0);
  EXPECT_EQ(away.status, SensorStatus::kFailed);
  EXPECT_TRUE(away.sides.empty());
  EXPECT_EQ(away.in_view, 0);
  // The pixels of a side, counted by the tests' own view.
  const SyntheticView view = Render(plan.structure, whole.intrinsics, whole.structure_from_sensor);
  const int label = LabelOf(plan.structure, whole.sides[0].first);
  const auto pixels = std::count(view.labels.begin(), view.labels.end(), label);
  EXPECT_NEAR(whole.sides[0].second, static_cast<double>(pixels), 0.15 * pixels);

  const std::string text = FormatPlan(plan);
  EXPECT_TRUE(Has(text, "S3: it sees no side of the stack", "S2: only "));
  ASSERT_EQ(plan.pairs.size(), 1u) << "of those that are placed";
  RigPlan pairs = plan;
  pairs.pairs = {{"S1", "S2", 0.3, 0.004, 0.005, Matrix6d::Identity(), 0.006, 0.1},
                 {"S1", "S3", 0.4, 0.009, 0.002, Matrix6d::Identity(), 0.003, 0.1}};
  pairs.pairs.push_back({"S2", "S3"});
  EXPECT_TRUE(Has(FormatPlan(pairs),
                  "of 3 pairs of sensors 2 overlap: expect their points to be at most "
                  "5.0 mm RMS apart. The uncertainty of their places relative to each "
                  "other will be 6.0 mm (one standard deviation) or less\n"));
  const std::string picture = PlanPicture(plan);
  for (const char* name : {">S1<", ">S2<", ">S3<", ">not placed<", "1 m"})
    EXPECT_TRUE(Has(picture, name));
}

TEST(PlanRig, ExpectsErrorsAsLargeAsThoseItMakes) {
  volalign::Rig rig = Parse(R"(
sensors:
  - {name: S1, sensor: azure_kinect_nfov_binned, rho_cm: 200, phi_deg: 20, height_cm: 110}
  - {name: S2, sensor: realsense_d415, rho_cm: 200, phi_deg: 110, height_cm: 110}
  - {name: S3, sensor: azure_kinect_nfov_binned, rho_cm: 200, phi_deg: 200, height_cm: 90}
  - {name: S4, sensor: realsense_d415, rho_cm: 200, phi_deg: 290, height_cm: 90}
)");
  const RigPlan plan = PlanRig(rig, 2);
  for (const PlannedSensor& sensor : plan.sensors) {
    EXPECT_EQ(sensor.placed, 2);
    EXPECT_GT(sensor.expected_m, 0.002) << sensor.name;
    EXPECT_LT(sensor.expected_m, 0.02) << sensor.name;
    EXPECT_GT(sensor.expected_deg, 0.03);
    EXPECT_LE(sensor.weakest_m, sensor.expected_m);
    EXPECT_GE(sensor.weakest_m, sensor.expected_m / std::sqrt(3.0) - 1e-12);
  }
  // A stereo camera's errors grow with the square of the distance.
  for (RigSensor& sensor : rig.sensors) sensor.rho_cm = 330;
  const RigPlan far = PlanRig(rig, 1);
  EXPECT_GT(far.sensors[1].expected_m, 1.3 * plan.sensors[1].expected_m);
}

/// What a sensor of the kind sees of the paper's stack, with the depths that are true.
struct Planned {
  SensorFrame frame;
  Structure structure = PaperStructure();
  SyntheticView view;

  Planned(const char* kind, const Intrinsics& intrinsics, const Pose& pose = RingPose(40)) {
    frame.sensor = kind;
    frame.intrinsics = intrinsics;
    frame.ground_truth = pose;
    view = Render(structure, intrinsics, pose);
  }
  PlannedFrame Measure(std::uint64_t seed) const {
    return MeasurePlanned(frame, structure, seed, 0);
  }
};

TEST(PlannedFrame, ErrorsHaveTheStatedSize) {
  const Planned made("realsense_d415", Kinect());
  const SyntheticView& view = made.view;
  const DepthErrorModel& errors = ErrorsOf(made.frame.sensor);
  Tally off;
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    const PlannedFrame planned = made.Measure(seed);
    for (std::size_t i = 0; i < view.depth.size(); ++i) {
      if (!(planned.labels[i] > 0)) continue;
      EXPECT_EQ(planned.labels[i], view.labels[i]);
      const double z = view.depth[i];
      off += (planned.frame.depth[i] - z) / std::hypot(errors.White(z), errors.Smooth(z));
    }
  }
  ASSERT_GT(off.count, 10000);
  EXPECT_NEAR(off.Rms(), 1, 0.25);
}

// What lies behind an edge is lost beside it, not the stack; and nothing is measured of the sky.
TEST(PlannedFrame, GapsAreBehindTheStack) {
  const Planned made("azure_kinect_nfov_binned", Kinect(), RingPose(40, 2, 0.3, 0));
  const SyntheticView& view = made.view;
  const Intrinsics& k = made.frame.intrinsics;
  const PlannedFrame planned = made.Measure(1);
  const auto labelled = [](const LabelImage& labels) {
    return std::count_if(labels.begin(), labels.end(),
                         [](std::uint8_t label) { return label > 0; });
  };
  EXPECT_GT(labelled(planned.labels), 0.97 * static_cast<double>(labelled(view.labels)));
  int sky = 0, lost = 0;
  for (const auto [u, v] : Pixels(view.depth)) {
    const Eigen::Vector3d ray((u - k.cx) / k.fx, (v - k.cy) / k.fy, 1);
    if (view.labels(u, v) > 0) continue;
    if ((made.frame.ground_truth->linear() * ray).y() > 0) {
      if (view.depth(u, v) > 0) continue;  // the underside of a box
      ++sky;
      EXPECT_EQ(planned.frame.depth(u, v), 0) << u << " " << v;
    } else {
      lost += planned.frame.depth(u, v) == 0;
    }
  }
  EXPECT_GT(sky, 1000);
  EXPECT_GT(lost, 300);
}

/// Mean square of how much the errors of pixels differ that lie an angle of so many pixels of a
/// picture of 320 apart.
double MeanSquareStep(int width, int lag_of_320) {
  const Planned made("azure_kinect_nfov_binned", Kinect().Resized(width, width * 9 / 10));
  const DepthImage& truth = made.view.depth;
  const int lag = lag_of_320 * width / 320;
  Tally steps;
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    const PlannedFrame planned = made.Measure(seed);
    for (const auto [u, row] : Pixels(truth.width() - lag, truth.height())) {
      const int v = row;
      if (!(planned.labels(u, v) > 0 && planned.labels(u + lag, v) > 0)) continue;
      const auto error = [&](int at) { return planned.frame.depth(at, v) - truth(at, v); };
      steps += error(u + lag) - error(u);
    }
  }
  EXPECT_GT(steps.count, 10000);
  return steps.squares / steps.count;
}

// Of a picture with twice the pixels, errors are alike over twice as many.
TEST(PlannedFrame, ErrorsAreAlikeOverTheSameAngle) {
  const double ratio = MeanSquareStep(640, 12) / MeanSquareStep(320, 12);
  EXPECT_GT(ratio, 0.7);
  EXPECT_LT(ratio, 1.4);
}

// A picture ends half a pixel beyond the middle of its last one, on each side.
TEST(PlanRig, CountsToThePicturesBorders) {
  const RigPlan plan = PlanRig(Parse(R"(
sensors:
  - {name: S1, sensor: realsense_d415, rho_cm: 70, phi_deg: 10, height_cm: 110}
  - {name: S2, sensor: realsense_d415, rho_cm: 75, phi_deg: 100, height_cm: 100, roll_deg: 0}
  - {name: S3, sensor: realsense_d415, rho_cm: 80, phi_deg: 190, height_cm: 90}
  - {name: S4, sensor: realsense_d415, rho_cm: 85, phi_deg: 280, height_cm: 80, roll_deg: 0}
)"),
                               1);
  for (const PlannedSensor& sensor : plan.sensors) {
    const Intrinsics& k = sensor.intrinsics;
    ASSERT_TRUE(k.distortion.empty());
    const Eigen::Vector3d eye = sensor.structure_from_sensor.translation();
    int seen = 0, inside = 0;
    for (const Eigen::Vector3d& point : SampleExposedSurface(plan.structure, 0.04)) {
      if (CastRay(plan.structure, eye, point - eye).t < 1 - 1e-6) continue;
      ++seen;
      const Eigen::Vector3d p = sensor.structure_from_sensor.inverse() * point;
      const double u = k.fx * p.x() / p.z() + k.cx, v = k.fy * p.y() / p.z() + k.cy;
      inside += p.z() > 0 && std::lround(u) >= 0 && std::lround(u) < k.width &&
                std::lround(v) >= 0 && std::lround(v) < k.height;
    }
    EXPECT_LT(inside, seen);
    EXPECT_DOUBLE_EQ(sensor.in_view, static_cast<double>(inside) / seen) << sensor.name;
  }
}

}  // namespace
}  // namespace volalign::plan_rig_test
