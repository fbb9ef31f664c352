#include "infer/evaluate/suite/paper_pose.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "infer/view/sensor_view.h"
#include "tests/core/base/pixels.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::paper_pose_test {
namespace {

using namespace testing_infer;

/// The paper's estimate is the least-squares pose between the medians of the sides' pixels, found
/// here by sorting, and the centroids of what is exposed of them.
TEST(PaperPose, IsLeastSquaresOverMediansOfLargeSides) {
  const Structure structure = PaperStructure();
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
  const std::optional<Pose> estimate = EstimatePaperPose(view, segmentation, structure);
  ASSERT_TRUE(estimate.has_value());
  Eigen::Matrix3Xd medians(3, 0), keypoints(3, 0);
  for (int label = 1; label < structure.num_classes(); ++label) {
    std::array<std::vector<double>, 3> coordinates;
    for (const auto [u, v] : Pixels(view)) {
      if (segmentation.labels(u, v) != label || !(view.depth(u, v) > 0)) continue;
      for (std::size_t i = 0; i < 3; ++i)
        coordinates[i].push_back(view.Point(u, v)[static_cast<Eigen::Index>(i)]);
    }
    if (coordinates[0].size() <= most) continue;
    for (Eigen::Matrix3Xd* points : {&medians, &keypoints})
      points->conservativeResize(3, points->cols() + 1);
    keypoints.rightCols<1>() = structure.SideOfLabel(label).exposed_centroid;
    for (std::size_t i = 0; i < 3; ++i) {
      std::sort(coordinates[i].begin(), coordinates[i].end());
      medians.rightCols<1>()[static_cast<Eigen::Index>(i)] =
          coordinates[i][coordinates[i].size() / 2];
    }
  }
  ASSERT_GE(medians.cols(), 3);
  EXPECT_LT((estimate->matrix() - Eigen::umeyama(medians, keypoints, false)).cwiseAbs().maxCoeff(),
            1e-6);
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
  EXPECT_FALSE(
      EstimatePaperPose(MakeSensorView(rendered.depth, Kinect()), Certain(labels), structure)
          .has_value());
}

}  // namespace
}  // namespace volalign::paper_pose_test
