#include "infer/initial/paper_pose.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/infer/view/synthetic.h"

namespace volalign::paper_pose_test {
namespace {

using testing_infer::Certain;
using testing_infer::Kinect;
using testing_infer::LabelOf;
using testing_infer::PaperStructure;
using testing_infer::Render;
using testing_infer::RingPose;

std::vector<int> LabelsOf(const Structure& structure, const std::vector<std::string>& names) {
  std::vector<int> labels;
  labels.reserve(names.size());
  for (const std::string& name : names) labels.push_back(LabelOf(structure, name));
  return labels;
}

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

/// The paper's estimate is the least-squares pose between the medians of the sides' pixels, found
/// here by sorting, and the centroids of what is exposed of them: every small step away from it
/// raises the sum of squares.
TEST(PaperPose, IsLeastSquaresOverMediansOfLargeSides) {
  const Structure structure = PaperStructure();
  InitialPoseOptions options;
  options.method = PoseMethod::kPaper;
  const auto rendered = Render(structure, Kinect(), RingPose(35));
  SegmentationResult segmentation = Certain(rendered.labels);
  // Unsure pixels count, a side of 1 pixel in 288 and less does not.
  for (std::size_t i = 0; i < segmentation.labels.size(); i += 5) segmentation.confidence[i] = 0.1f;
  const std::size_t most = segmentation.labels.size() / 288;
  const int small = LabelOf(structure, "mid_top/front");
  std::size_t kept = 0;
  for (std::uint8_t& label : segmentation.labels) {
    if (label == small && kept++ >= most) label = 0;
  }
  ASSERT_GT(kept, most);
  const SensorView view = MakeSensorView(rendered.depth, Kinect());
  const InitialPose estimate = EstimateInitialPose(view, segmentation, structure, options);
  ASSERT_TRUE(estimate.found);
  std::vector<Eigen::Vector3d> medians, keypoints;
  for (int label = 1; label < structure.num_classes(); ++label) {
    std::array<std::vector<double>, 3> coordinates;
    for (int v = 0; v < view.height(); ++v) {
      for (int u = 0; u < view.width(); ++u) {
        if (segmentation.labels(u, v) != label || !(view.depth(u, v) > 0)) continue;
        for (std::size_t i = 0; i < 3; ++i)
          coordinates[i].push_back(view.Point(u, v)[static_cast<Eigen::Index>(i)]);
      }
    }
    if (coordinates[0].size() <= most) continue;
    Eigen::Vector3d median;
    for (std::size_t i = 0; i < 3; ++i) {
      std::sort(coordinates[i].begin(), coordinates[i].end());
      median[static_cast<Eigen::Index>(i)] = coordinates[i][coordinates[i].size() / 2];
    }
    medians.push_back(median);
    keypoints.push_back(structure.SideOfLabel(label).exposed_centroid);
  }
  ASSERT_GE(medians.size(), 3u);
  const auto cost = [&](const Pose& pose) {
    double sum = 0;
    for (std::size_t i = 0; i < medians.size(); ++i)
      sum += (pose * medians[i] - keypoints[i]).squaredNorm();
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

TEST(PaperPose, FindsNothingInCollinearCentres) {
  const Structure structure = PaperStructure();
  const auto rendered = Render(structure, Kinect(), RingPose(35));
  const std::vector<int> kept =
      LabelsOf(structure, {"mid_bottom/front", "mid_top/front", "top/front"});
  LabelImage labels = rendered.labels;
  for (std::uint8_t& label : labels) {
    if (std::find(kept.begin(), kept.end(), label) == kept.end()) label = 0;
  }
  InitialPoseOptions options;
  options.method = PoseMethod::kPaper;
  EXPECT_FALSE(Estimate(structure, RingPose(35), rendered.depth, labels, options).found);
}

TEST(PaperPose, OursBeatsThePaperEstimate) {
  const Structure structure = PaperStructure();
  InitialPoseOptions paper;
  paper.method = PoseMethod::kPaper;
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

}  // namespace
}  // namespace volalign::paper_pose_test
