#include "infer/initial/initial_pose.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/visibility.h"
#include "tests/core/base/long_tests.h"
#include "tests/infer/view/lens.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::initial_pose_test {
namespace {

using testing_infer::AddNoise;
using testing_infer::Certain;
using testing_infer::Kinect;
using testing_infer::LabelOf;
using testing_infer::PaperStructure;
using testing_infer::RayThroughStrongLens;
using testing_infer::Render;
using testing_infer::RingPose;
using testing_infer::StrongLens;

struct Outcome {
  bool found = false;
  PoseError error;
};

Outcome Estimate(const Structure& structure, const Pose& truth, const DepthImage& depth,
                 const LabelImage& labels, const InitialPoseOptions& options = {}) {
  const SensorView view = MakeSensorView(depth, Kinect());
  const InitialPose pose = EstimateInitialPose(view, Certain(labels), structure, options);
  return {pose.found, ComparePoses(pose.structure_from_sensor, truth)};
}

TEST(InitialPose, PerfectLabelsGiveThePoseAllRound) {
  const Structure structure = PaperStructure();
  for (int phi = 0; phi < 360; phi += 30) {
    for (std::uint64_t i = 0; i < Rounds(1, 3); ++i) {
      const double roll =
          90.0 * static_cast<double>((static_cast<std::uint64_t>(phi) / 30 + i) % 3);
      const Pose truth = RingPose(phi, 1.9, 0.4, roll, Eigen::Vector3d(-0.1, 0.05, 0));
      const auto rendered = Render(structure, Kinect(), truth);
      const Outcome outcome = Estimate(structure, truth, rendered.depth, rendered.labels);
      ASSERT_TRUE(outcome.found) << phi;
      EXPECT_FALSE(!(outcome.error.translation_m < 0.008))  // up to 6.3 mm
          << phi << ": " << outcome.error.translation_m;
      EXPECT_FALSE(!(outcome.error.rotation_deg < 0.1))
          << phi << ": " << outcome.error.rotation_deg;
    }
  }
}

/// What a sensor with a lens sees, each ray by bisection and cast on its own.
testing_infer::SyntheticView RenderThroughLens(const Structure& structure, const Intrinsics& lens,
                                               const Pose& pose) {
  testing_infer::SyntheticView view{DepthImage(lens.width, lens.height),
                                    LabelImage(lens.width, lens.height)};
  for (int v = 0; v < lens.height; ++v) {
    for (int u = 0; u < lens.width; ++u) {
      const Eigen::Vector2d ray = RayThroughStrongLens(lens, u, v);
      const RayHit hit = CastRay(structure, pose.translation(),
                                 pose.linear() * Eigen::Vector3d(ray.x(), ray.y(), 1));
      if (hit.side < 0) continue;
      view.depth(u, v) = static_cast<float>(hit.t);  // the ray has z = 1
      view.labels(u, v) = structure.sides()[static_cast<std::size_t>(hit.side)].label;
    }
  }
  return view;
}

TEST(InitialPose, AStrongLensIsUndone) {
  const Structure structure = PaperStructure();
  const Intrinsics lens = StrongLens();
  for (const double phi : {20.0, 200.0}) {
    const Pose truth = RingPose(phi, 1.9);
    const auto rendered = RenderThroughLens(structure, lens, truth);
    const InitialPose pose = EstimateInitialPose(MakeSensorView(rendered.depth, lens),
                                                 Certain(rendered.labels), structure, {});
    ASSERT_TRUE(pose.found) << phi;
    const PoseError error = ComparePoses(pose.structure_from_sensor, truth);
    EXPECT_FALSE(!(error.translation_m < 0.002)) << phi << ": " << error.translation_m;
    EXPECT_FALSE(!(error.rotation_deg < 0.1)) << phi << ": " << error.rotation_deg;

    Intrinsics pinhole = lens;
    pinhole.distortion.clear();
    const InitialPose bent = EstimateInitialPose(MakeSensorView(rendered.depth, pinhole),
                                                 Certain(rendered.labels), structure, {});
    EXPECT_GT(ComparePoses(bent.structure_from_sensor, truth).translation_m, 0.01) << phi;
  }
}

TEST(InitialPose, WithstandsWrongLabels) {
  const Structure structure = PaperStructure();
  for (int phi = 0; phi < 360; phi += 40) {
    const Pose truth = RingPose(phi);
    auto rendered = Render(structure, Kinect(), truth, {true, 3.5});
    AddNoise(&rendered.depth, 0.005, static_cast<std::uint64_t>(phi));
    // A tenth of all pixels gets any label, and one true side gets a wrong one.
    RandomStream random(5, static_cast<std::uint64_t>(phi), "labels");
    const int victim = LabelOf(structure, phi < 180 ? "mid_top/right" : "mid_bottom/left");
    const int wrong = LabelOf(structure, "bottom/up");
    for (std::uint8_t& label : rendered.labels) {
      if (label == victim) label = static_cast<std::uint8_t>(wrong);
      if (random.Chance(0.1))
        label = static_cast<std::uint8_t>(random.Below(structure.num_classes()));
    }
    const Outcome outcome = Estimate(structure, truth, rendered.depth, rendered.labels);
    ASSERT_TRUE(outcome.found) << phi;
    EXPECT_FALSE(!(outcome.error.translation_m < 0.02))
        << phi << ": " << outcome.error.translation_m;
    EXPECT_FALSE(!(outcome.error.rotation_deg < 0.5)) << phi << ": " << outcome.error.rotation_deg;
  }
}

TEST(InitialPose, FourParallelSidesAndASliver) {
  // What KA03 shows: head on, all sides of one direction and a strip of one other.
  const Structure structure = PaperStructure();
  const Pose truth = RingPose(90, 2.0, 0.35);
  auto rendered = Render(structure, Kinect(), truth);
  for (std::uint8_t& label : rendered.labels) {
    if (label == 0) continue;
    const std::string& name = structure.SideOfLabel(label).name;
    if (name.find("/right") == std::string::npos && name != "bottom/up") label = 0;
  }
  const Outcome outcome = Estimate(structure, truth, rendered.depth, rendered.labels);
  ASSERT_TRUE(outcome.found);
  EXPECT_FALSE(!(outcome.error.translation_m < 0.01)) << outcome.error.translation_m;
  EXPECT_FALSE(!(outcome.error.rotation_deg < 0.5)) << outcome.error.rotation_deg;
}

TEST(InitialPose, NothingLabelledFindsNothing) {
  const Structure structure = PaperStructure();
  const auto rendered = Render(structure, Kinect(), RingPose(20));
  const SensorView view = MakeSensorView(rendered.depth, Kinect());
  const InitialPose pose = EstimateInitialPose(
      view, Certain(LabelImage(rendered.depth.width(), rendered.depth.height())), structure, {});
  EXPECT_FALSE(pose.found);
  EXPECT_TRUE(pose.patches.empty());
}

}  // namespace
}  // namespace volalign::initial_pose_test
