#include "infer/pose/aliases.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "core/metrics.h"
#include "core/random.h"
#include "core/visibility.h"
#include "infer/calibrate.h"
#include "tests/infer/synthetic.h"

namespace volalign {
namespace {

using testing_infer::Certain;
using testing_infer::PaperStructure;
using testing_infer::Rig;
using testing_infer::RingPose;
using testing_infer::Scene;
using testing_infer::StoredSegmenter;

bool Inside(const Structure& structure, const Eigen::Vector3d& p, double slack) {
  return std::any_of(structure.boxes().begin(), structure.boxes().end(), [&](const Box& box) {
    const Eigen::Vector3d q = box.structure_from_box.inverse() * p;
    return ((q.cwiseAbs() - box.size / 2).array() < slack).all();
  });
}

// Independent of corners: the volume of the moved boxes, by random points.
TEST(FindAliases, CountsTheBoxesThatComeToLieOnBoxes) {
  const Structure structure = PaperStructure();
  const std::vector<StructureAlias> aliases = FindAliases(structure);
  ASSERT_GE(aliases.size(), 4u);
  RandomStream random(1, 0, "points");
  for (const StructureAlias& alias : aliases) {
    int covered = 0;
    for (const Box& box : structure.boxes()) {
      bool all = true;
      for (int k = 0; k < 200; ++k) {
        const Eigen::Vector3d p(random.Uniform(-0.5, 0.5), random.Uniform(-0.5, 0.5),
                                random.Uniform(-0.5, 0.5));
        all = all && Inside(structure,
                            alias.motion * (box.structure_from_box *
                                            Eigen::Vector3d(p.cwiseProduct(box.size))),
                            0.02);
      }
      covered += all ? 1 : 0;
    }
    EXPECT_EQ(covered, alias.boxes);
    for (int label = 1; label < structure.num_classes(); ++label) {
      const int after = alias.label_after[static_cast<std::size_t>(label)];
      if (after == 0) continue;
      const Side& side = structure.SideOfLabel(label);
      const Eigen::Vector3d p =
          alias.motion * Eigen::Vector3d(side.centre + 0.1 * side.half_u * side.axis_u);
      EXPECT_LT((structure.SideOfLabel(after).ClosestPoint(p) - p).norm(), 0.02);
    }
  }
  // facts/structure.yaml by hand: half a turn about a horizontal diagonal keeps all four boxes, and
  // a step of the spiral three, a box height higher or lower.
  EXPECT_EQ(aliases[0].boxes, 4);
  EXPECT_FALSE(aliases[0].keeps_up());
  int up = 0, down = 0;
  for (const StructureAlias& alias : aliases) {
    if (alias.boxes != 3 || !alias.keeps_up()) continue;
    EXPECT_NEAR(std::abs(alias.motion.translation().y()), 0.405, 1e-6);
    EXPECT_NEAR(alias.motion.linear().trace(), 1, 1e-9);  // a quarter turn
    ++(alias.motion.translation().y() > 0 ? up : down);
  }
  EXPECT_EQ(up, 1);
  EXPECT_EQ(down, 1);
}

TEST(FindAliases, BoxesOfDifferentSizesHaveNone) {
  const Structure structure =
      Structure::FromBoxes("odd", {Box::FromMinMax("low", {-0.4, -0.8, -0.2}, {0.3, -0.3, 0.15}),
                                   Box::FromMinMax("middle", {-0.1, -0.3, -0.2}, {0.3, 0.1, 0.4}),
                                   Box::FromMinMax("high", {-0.3, 0.1, -0.1}, {0.3, 0.45, 0.15})});
  // Each box by itself is the same after half a turn about its own axes.
  for (const StructureAlias& alias : FindAliases(structure)) EXPECT_LT(alias.boxes, 2);
}

/// A wide picture that cuts the stack off at the top and the bottom.
Intrinsics Wide() {
  Intrinsics intrinsics;
  intrinsics.width = 320;
  intrinsics.height = 180;
  intrinsics.fx = intrinsics.fy = 230;
  intrinsics.cx = 159.5;
  intrinsics.cy = 89.5;
  return intrinsics;
}

Pose WidePose(double phi_deg) {
  return RingPose(phi_deg, 1.65, 0, 0, Eigen::Vector3d(-0.05, -0.1, 0));
}

/// Labels that a network gives that takes the structure for the alias: those of the structure as
/// seen from the moved pose, where the depths are the same.
LabelImage LabelsAs(const Rig& rig, const Pose& motion) {
  const SensorFrame& frame = rig.frames.back();
  LabelImage labels =
      CastView(rig.structure, ComputeRays(frame.intrinsics), motion * *frame.ground_truth).labels;
  for (std::size_t i = 0; i < labels.size(); ++i) {
    if (rig.labels.back()[i] == 0) labels[i] = 0;
  }
  return labels;
}

SensorResult CalibrateAs(const Rig& rig, const LabelImage& labels) {
  StoredSegmenter segmenter;
  segmenter.Store(rig.frames.back().depth, Certain(labels));
  CalibrateOptions options;
  options.refine.outer_iterations = 2;
  return Calibrate(rig.frames, rig.structure, segmenter, options).sensors.front();
}

Rig WideRig(double phi_deg, int turns, const Scene& scene = {true, 3.0}) {
  Rig rig{PaperStructure(), {}, {}};
  rig.Add("S", WidePose(phi_deg), scene, Wide());
  rig.frames.back().quarter_turns = turns;
  return rig;
}

/// Without a floor, before walls of which only a band about the stack's middle is measured, so that
/// the frame is much the same upside down.
Rig BetweenWalls(int turns) {
  Rig rig = WideRig(20, turns, {false, 3.0});
  SensorFrame& frame = rig.frames.back();
  const SensorView view = MakeSensorView(frame.depth, frame.intrinsics);
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      const Eigen::Vector3d p = *frame.ground_truth * view.Point(u, v);
      if (rig.labels.back()(u, v) == 0 && std::abs(p.y()) > 0.5) frame.depth(u, v) = 0;
    }
  }
  return rig;
}

// Rendered ground truth: the pose that the frame was cast from.
TEST(ChoosePose, TheFloorRightsWhatTheNetworkTookForAnAlias) {
  for (const double phi : {20.0, 250.0}) {
    const Rig rig = WideRig(phi, kAutoTurns);
    const std::vector<StructureAlias> aliases = FindAliases(rig.structure);
    for (std::size_t a = 0; a < aliases.size() && aliases[a].boxes >= 3; ++a) {
      const SensorResult sensor = CalibrateAs(rig, LabelsAs(rig, aliases[a].motion));
      ASSERT_TRUE(sensor.structure_from_sensor.has_value())
          << phi << " " << a << ": " << ToString(sensor.code) << ", " << sensor.reason;
      EXPECT_LT(sensor.error->translation_m, 0.02) << phi << " " << a;
      EXPECT_LT(sensor.error->rotation_deg, 1) << phi << " " << a;
      EXPECT_NE(sensor.code, SensorCode::kAmbiguous) << phi << " " << a;
      EXPECT_GT(sensor.label_iou, 0.6) << phi << " " << a;
    }
  }
}

TEST(ChoosePose, AMixtureOfBoxesIsReconciled) {
  const Rig rig = WideRig(20, kAutoTurns);
  const std::vector<StructureAlias> aliases = FindAliases(rig.structure);
  LabelImage labels = LabelsAs(rig, aliases[0].motion);
  for (std::size_t a = 0; a < aliases.size(); ++a) {
    if (aliases[a].boxes != 3 || !aliases[a].keeps_up()) continue;
    const LabelImage others = LabelsAs(rig, aliases[a].motion);
    for (int v = 0; v < labels.height() / 2; ++v) {
      for (int u = 0; u < labels.width(); ++u) labels(u, v) = others(u, v);
    }
    const SensorResult sensor = CalibrateAs(rig, labels);
    ASSERT_TRUE(sensor.structure_from_sensor.has_value()) << ToString(sensor.code) << ", " << sensor.reason;
    EXPECT_EQ(sensor.status, SensorStatus::kOk) << ToString(sensor.code);
    EXPECT_LT(sensor.error->translation_m, 0.02);
    EXPECT_GT(sensor.label_iou, 0.8);
  }
}

// No floor: the frame is the same, to 5 mm, from both poses, and no answer is `ok`.
TEST(ChoosePose, WithoutAFloorUpAndDownStayOpen) {
  for (const bool over : {false, true}) {
    const Rig rig = BetweenWalls(kAutoTurns);
    const Pose motion = over ? FindAliases(rig.structure).front().motion : Pose::Identity();
    const SensorResult sensor = CalibrateAs(rig, LabelsAs(rig, motion));
    ASSERT_TRUE(sensor.structure_from_sensor.has_value()) << ToString(sensor.code) << ", " << sensor.reason;
    EXPECT_EQ(sensor.status, SensorStatus::kWeak);
    EXPECT_EQ(sensor.code, SensorCode::kAmbiguous);
    EXPECT_NE(sensor.reason.find("upside down"), std::string::npos) << sensor.reason;
    EXPECT_NE(sensor.hint.find("quarter_turns"), std::string::npos) << sensor.hint;
  }
  const Rig given = BetweenWalls(3);
  const SensorResult sensor = CalibrateAs(given, given.labels.back());
  EXPECT_EQ(sensor.status, SensorStatus::kOk) << ToString(sensor.code) << ", " << sensor.reason;
}

}  // namespace
}  // namespace volalign
