#include "infer/pose/initial_pose.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "core/procrustes.h"
#include "core/random.h"
#include "tests/infer/synthetic.h"

namespace volalign {
namespace {

using testing_infer::AddNoise;
using testing_infer::Certain;
using testing_infer::Kinect;
using testing_infer::LabelOf;
using testing_infer::PaperStructure;
using testing_infer::Render;
using testing_infer::RingPose;

std::vector<int> LabelsOf(const Structure& structure, const std::vector<std::string>& names) {
  std::vector<int> labels;
  for (const std::string& name : names) labels.push_back(LabelOf(structure, name));
  return labels;
}

struct Outcome {
  bool found = false;
  PoseError error;
};

Outcome Estimate(const Structure& structure, const Pose& truth, DepthImage depth,
                 const LabelImage& labels, const InitialPoseOptions& options = {}) {
  const SensorView view = MakeSensorView(depth, Kinect());
  const InitialPose pose = EstimateInitialPose(view, Certain(labels), structure, options);
  return {pose.found, ComparePoses(pose.structure_from_sensor, truth)};
}

TEST(InitialPose, PerfectLabelsGiveThePoseAllRound) {
  const Structure structure = PaperStructure();
  for (int phi = 0; phi < 360; phi += 30) {
    for (const double roll : {0.0, 90.0, 180.0}) {
      const Pose truth = RingPose(phi, 1.9, 0.4, roll, Eigen::Vector3d(-0.1, 0.05, 0));
      const auto rendered = Render(structure, Kinect(), truth);
      const Outcome outcome = Estimate(structure, truth, rendered.depth, rendered.labels);
      ASSERT_TRUE(outcome.found) << phi;
      EXPECT_FALSE(!(outcome.error.translation_m < 0.002))
          << phi << ": " << outcome.error.translation_m;
      EXPECT_FALSE(!(outcome.error.rotation_deg < 0.1))
          << phi << ": " << outcome.error.rotation_deg;
    }
  }
}

/// The paper's estimate is the least-squares pose between the sides' pixel means, summed here, and
/// their centres: every small step away from it raises the sum of squares.
TEST(InitialPose, PaperIsLeastSquaresOverPixelMeans) {
  const Structure structure = PaperStructure();
  InitialPoseOptions options;
  options.method = "paper";
  const auto rendered = Render(structure, Kinect(), RingPose(35));
  SegmentationResult segmentation = Certain(rendered.labels);
  // Unsure pixels, a whole side of them and every fifth, do not count.
  const int unsure = LabelOf(structure, "mid_top/front");
  for (std::size_t i = 0; i < segmentation.labels.size(); ++i) {
    if (segmentation.labels[i] == unsure || i % 5 == 0) segmentation.confidence[i] = 0.3f;
  }
  const SensorView view = MakeSensorView(rendered.depth, Kinect());
  const InitialPose estimate = EstimateInitialPose(view, segmentation, structure, options);
  ASSERT_TRUE(estimate.found);
  const auto cost = [&](const Pose& pose) {
    double sum = 0;
    for (int label = 1; label < structure.num_classes(); ++label) {
      Eigen::Vector3d mean = Eigen::Vector3d::Zero();
      int count = 0;
      for (int v = 0; v < view.height(); ++v) {
        for (int u = 0; u < view.width(); ++u) {
          if (segmentation.labels(u, v) != label || segmentation.confidence(u, v) < 0.5f) continue;
          mean += view.Point(u, v);
          ++count;
        }
      }
      if (count < options.evidence.min_pixels) continue;
      sum += (pose * Eigen::Vector3d(mean / count) - structure.SideOfLabel(label).centre)
                 .squaredNorm();
    }
    return sum;
  };
  const double least = cost(estimate.structure_from_sensor);
  for (int axis = 0; axis < 6; ++axis) {
    for (const double step : {-1e-3, 1e-3}) {
      const Vector6d delta = step * Vector6d::Unit(axis);
      EXPECT_GT(cost(PerturbLeft(delta, estimate.structure_from_sensor)), least) << axis;
    }
  }
}

TEST(InitialPose, PaperFindsNothingInCollinearCentres) {
  const Structure structure = PaperStructure();
  const auto rendered = Render(structure, Kinect(), RingPose(35));
  const std::vector<int> kept =
      LabelsOf(structure, {"mid_bottom/front", "mid_top/front", "top/front"});
  LabelImage labels = rendered.labels;
  for (std::uint8_t& label : labels) {
    if (std::find(kept.begin(), kept.end(), label) == kept.end()) label = 0;
  }
  InitialPoseOptions options;
  options.method = "paper";
  EXPECT_FALSE(Estimate(structure, RingPose(35), rendered.depth, labels, options).found);
}

TEST(InitialPose, OursBeatsThePaperEstimate) {
  const Structure structure = PaperStructure();
  InitialPoseOptions paper;
  paper.method = "paper";
  double sum_paper = 0, sum_ours = 0;
  for (int phi = 15; phi < 360; phi += 45) {
    const Pose truth = RingPose(phi);
    const auto rendered = Render(structure, Kinect(), truth);
    sum_paper +=
        Estimate(structure, truth, rendered.depth, rendered.labels, paper).error.translation_m;
    sum_ours += Estimate(structure, truth, rendered.depth, rendered.labels).error.translation_m;
  }
  EXPECT_LT(sum_ours, 0.05 * sum_paper);
  EXPECT_GT(sum_paper / 8, 0.01);  // hidden parts bias centroids by centimetres
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
  EXPECT_TRUE(pose.evidence.empty());
}

TEST(SidesFixPose, KnowsTheStructuresCollinearKeypoints) {
  const Structure structure = PaperStructure();
  const auto fixes = [&](const std::vector<std::string>& names, KeypointKind kind) {
    return SidesFixPose(structure, LabelsOf(structure, names), kind);
  };
  // Design section 2: exactly collinear centres, of parallel sides.
  EXPECT_FALSE(fixes({"mid_bottom/front", "mid_top/front", "top/front"}, KeypointKind::kCentre));
  EXPECT_FALSE(fixes({"bottom/right", "mid_bottom/right", "mid_top/right"}, KeypointKind::kCentre));
  EXPECT_FALSE(fixes({"mid_bottom/front"}, KeypointKind::kCentre));
  EXPECT_FALSE(fixes({"mid_bottom/front", "mid_top/right"}, KeypointKind::kCentre));
  EXPECT_FALSE(fixes({}, KeypointKind::kCentre));
  // One side off the line.
  EXPECT_TRUE(fixes({"mid_bottom/front", "mid_top/front", "top/front", "bottom/front"},
                    KeypointKind::kCentre));
  EXPECT_TRUE(fixes({"mid_bottom/front", "mid_top/front", "top/right"}, KeypointKind::kCentre));
  EXPECT_TRUE(fixes({"bottom/right", "mid_bottom/front", "mid_top/up"}, KeypointKind::kExposed));
}

TEST(SidesFixPose, PlanesFixWhatKeypointsInALineDoNot) {
  const auto box = [](const char* name, const Eigen::Vector3d& min, const Eigen::Vector3d& max) {
    return Box::FromMinMax(name, min, max);
  };
  // Faces of three directions whose centres are (0, 0, 0), (0, 1, 0) and (0, 2, 0).
  const Structure mixed =
      Structure::FromBoxes("mixed", {box("a", {-0.5, -0.25, -0.25}, {0, 0.25, 0.25}),
                                     box("b", {-0.25, 0.75, -0.5}, {0.25, 1.25, 0}),
                                     box("c", {-0.25, 1.5, -0.25}, {0.25, 2, 0.25})});
  const std::vector<int> labels = LabelsOf(mixed, {"a/front", "b/right", "c/up"});
  std::vector<Eigen::Vector3d> centres;
  for (const int label : labels) centres.push_back(mixed.SideOfLabel(label).centre);
  ASSERT_LT((centres[1] - Eigen::Vector3d(0, 1, 0)).norm(), 1e-12);
  ASSERT_LT(SecondSingularValue(centres), 1e-9);
  EXPECT_TRUE(SidesFixPose(mixed, labels, KeypointKind::kCentre));
  EXPECT_FALSE(SidesFixPose(mixed, LabelsOf(mixed, {"a/front", "b/right"}), KeypointKind::kCentre));
}

}  // namespace
}  // namespace volalign
