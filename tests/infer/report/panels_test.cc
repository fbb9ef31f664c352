#include "infer/report/panels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "core/plot/picture.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::panels_test {
namespace {

using testing_infer::Kinect;
using testing_infer::PaperStructure;
using testing_infer::Render;
using testing_infer::RingPose;

FrameResult Seen(const Structure& structure, const Pose& pose) {
  const testing_infer::SyntheticView view = Render(structure, Kinect(), pose);
  FrameResult sensor;
  sensor.name = "S";
  sensor.view = MakeSensorView(view.depth, Kinect());
  sensor.segmentation.labels = view.labels;
  sensor.structure_from_sensor = pose;
  return sensor;
}

// Of a failed sensor, the pose that was rejected, and no residuals.
TEST(MakePanels, ShowsTheBestGuessOfAFailedSensor) {
  const Structure structure = PaperStructure();
  FrameResult sensor = Seen(structure, RingPose(40));
  const FramePanels placed = MakePanels(sensor, structure, 0);
  sensor.best_guess = *std::exchange(sensor.structure_from_sensor, std::nullopt);
  const FramePanels failed = MakePanels(sensor, structure, 0);
  ASSERT_EQ(failed.edges.size(), placed.edges.size());
  EXPECT_GT(placed.edges.size(), 0u);
  EXPECT_TRUE(std::equal(
      failed.edges.begin(), failed.edges.end(), placed.edges.begin(),
      [](const Rgb& a, const Rgb& b) { return a.r == b.r && a.g == b.g && a.b == b.b; }));
  EXPECT_TRUE(failed.residual.empty());
  sensor.best_guess.reset();
  EXPECT_TRUE(MakePanels(sensor, structure, 0).edges.empty());
}

TEST(SideResiduals, AreSignedAndZeroWhereThePoseIsRight) {
  const Structure structure = PaperStructure();
  FrameResult sensor = Seen(structure, RingPose(40));
  const auto extremes = [&] {
    const Image<float> residuals = SideResiduals(sensor, structure);
    double low = 1e9, high = -1e9;
    int known = 0;
    for (std::size_t i = 0; i < residuals.size(); ++i) {
      EXPECT_EQ(std::isnan(residuals[i]), sensor.segmentation.labels[i] == 0);
      if (std::isnan(residuals[i])) continue;
      ++known;
      low = std::min<double>(low, residuals[i]);
      high = std::max<double>(high, residuals[i]);
    }
    EXPECT_GT(known, 5000);
    return std::pair(low, high);
  };
  EXPECT_NEAR(extremes().first, 0, 1e-5);
  EXPECT_NEAR(extremes().second, 0, 1e-5);
  // Measured 10 mm too near along the axis: in front of every side that is seen, by at most that.
  sensor.depth_offset_m = -0.01;
  EXPECT_GT(extremes().first, 0);
  EXPECT_LT(extremes().second, 0.0125);
  sensor.depth_offset_m = 0.01;
  EXPECT_LT(extremes().second, 0);
  // Taken for 1 % farther, from 1 to 3 m: behind every side.
  sensor.depth_offset_m = 0;
  sensor.depth_gain = 1.01;
  EXPECT_LT(extremes().second, -0.001);
  EXPECT_GT(extremes().first, -0.03);
  sensor.structure_from_sensor.reset();
  for (const float residual : SideResiduals(sensor, structure)) EXPECT_TRUE(std::isnan(residual));
}

TEST(MakePanels, TurnsFramesUprightAndThinsLargeOnes) {
  const Structure structure = PaperStructure();
  FrameResult sensor = Seen(structure, RingPose(40));
  const FramePanels panels = MakePanels(sensor, structure, 1);
  EXPECT_EQ(panels.depth.width(), 288);
  EXPECT_EQ(panels.depth.height(), 320);
  // The pose is exact: the edges lie on measured pixels of the stack, beside another label.
  int edges = 0;
  for (int v = 0; v < 288; ++v) {
    for (int u = 0; u < 320; ++u) {
      const int x = 288 - 1 - v, y = u;
      if (panels.edges(x, y) == panels.depth(x, y)) continue;
      ++edges;
      const LabelImage& labels = sensor.segmentation.labels;
      const int label = labels(u, v);
      EXPECT_GT(label, 0) << u << ", " << v;
      EXPECT_TRUE((u > 0 && labels(u - 1, v) != label) || (u < 319 && labels(u + 1, v) != label) ||
                  (v > 0 && labels(u, v - 1) != label) || (v < 287 && labels(u, v + 1) != label))
          << u << ", " << v;
    }
  }
  EXPECT_GT(edges, 300);
  ASSERT_FALSE(panels.sides.empty());
  EXPECT_LT(panels.sides.front().rms_m, 1e-5);
  EXPECT_FALSE(panels.shown_labels.empty());
  EXPECT_GT(panels.shown_labels.front(), 0);
  for (int v = 0; v < 288; ++v) {
    for (int u = 0; u < 320; ++u) {
      const bool labelled = sensor.segmentation.labels(u, v) > 0;
      const Rgb residual = panels.residual(288 - 1 - v, u);
      EXPECT_EQ(labelled, residual == SignedColour(0)) << u << ", " << v;
    }
  }
  sensor.structure_from_sensor.reset();
  const FramePanels without = MakePanels(sensor, structure, 0);
  EXPECT_TRUE(without.edges.empty());
  EXPECT_TRUE(without.sides.empty());
  EXPECT_TRUE(without.residual.empty());

  Intrinsics wide = Kinect();
  wide.width = 1280;
  wide.height = 720;
  FrameResult large;
  large.view = MakeSensorView(DepthImage(1280, 720, 2.0f), wide);
  large.segmentation.labels = LabelImage(1280, 720, 0);
  const FramePanels thinned = MakePanels(large, structure, 0);
  EXPECT_EQ(thinned.depth.width(), 427);
  EXPECT_EQ(thinned.depth.height(), 240);
}

}  // namespace
}  // namespace volalign::panels_test
