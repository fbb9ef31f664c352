#include "infer/view/sensor_view.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "core/geometry/sensor_kind.h"
#include "infer/view/frames.h"
#include "infer/view/network_frame.h"
#include "infer/view/network_segmenter.h"
#include "infer/view/segmentation.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::sensor_view_test {
namespace {

using namespace testing_infer;

/// A lens with tangential coefficients too.
Intrinsics Skewed() {
  Intrinsics lens = Kinect();
  lens.fy = 240;
  lens.distortion = {0.12, -0.06, 0.004, -0.006, 0.01};
  return lens;
}

TEST(SensorView, PixelsBeyondTheFoldOfALensHaveNoDepth) {
  // r (1 - 0.5 r^2) rises up to 0.5443.
  const Intrinsics k{320, 288, 252.4, 251.9, 163.2, 165.7, {-0.5, 0, 0, 0}};
  const SensorView view = MakeSensorView(DepthImage(k.width, k.height, 2.0f), k);
  for (const auto [u, v] : Pixels(k.width, k.height)) {
    const double radius = std::hypot((u - k.cx) / k.fx, (v - k.cy) / k.fy);
    if (radius < 0.53 || radius > 0.55) {
      ASSERT_EQ(view.depth(u, v), radius < 0.53 ? 2.0f : 0.0f) << u << " " << v;
    }
    ASSERT_TRUE(view.rays.at(u, v).allFinite());
  }
  EXPECT_EQ(view.ray_areas(0, 0), 0.0f);
  EXPECT_GT(view.ray_areas(163, 165), 0.0f);
}

TEST(SensorView, DropsWhatIsNoMeasurement) {
  DepthImage depth(20, 10, 1.5f);
  depth(3, 4) = -1;
  depth(4, 4) = std::numeric_limits<float>::quiet_NaN();
  depth(5, 4) = std::numeric_limits<float>::infinity();
  const SensorView view = MakeSensorView(depth, Coarse());
  for (const auto [u, v] : Pixels(20, 10))
    EXPECT_EQ(view.depth(u, v), v == 4 && u >= 3 && u <= 5 ? 0.0f : 1.5f) << u << " " << v;
  ExpectError<DataError>([&] { MakeSensorView(DepthImage(10, 20), Coarse()); }, {"10x20", "20x10"});
}

// A plane at 2 m, perpendicular to the axis: each pixel covers 5 cm x 5 cm of it.
TEST(SensorView, PixelAreaIsThatOfTheSurface) {
  const SensorView view = MakeSensorView(DepthImage(20, 10, 2.0f), Coarse());
  for (const int u : {0, 9, 19})
    EXPECT_NEAR(view.PixelArea(u, 3, 2, -Eigen::Vector3d::UnitZ()), 0.0025, 1e-9);
  // Turned by 60 deg about the vertical, a surface on the axis shows half as much of itself.
  const Eigen::Vector3d normal(std::sin(M_PI / 3), 0, -std::cos(M_PI / 3));
  const Intrinsics centred{21, 11, 40, 40, 10, 5, {}};
  const SensorView on_axis = MakeSensorView(DepthImage(21, 11, 2.0f), centred);
  EXPECT_NEAR(on_axis.PixelArea(10, 5, 2, normal), 0.005, 1e-9);
}

// Each pixel's area is that between the rays half a pixel beside it; together they fill what the
// rays of the picture's outline enclose.
TEST(SensorView, AreasOfRaysAreThoseBetweenTheirNeighbours) {
  for (const Intrinsics& lens : {Kinect(), KinectWithLens(), Skewed()}) {
    SCOPED_TRACE(lens.distortion.size());
    const SensorView view = MakeSensorView(DepthImage(lens.width, lens.height, 1.0f), lens);
    const auto cross = [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
      return a.x() * b.y() - a.y() * b.x();
    };
    const auto ray = [&](double u, double v) { return RayThroughLens(lens, u, v); };
    double worst = 0, sum = 0, largest = 0;
    for (const auto [u, v] : Pixels(lens.width, lens.height)) {
      const double area = view.ray_areas(u, v);
      sum += area;
      largest = std::max(largest, area * lens.fx * lens.fy);
      if (u % 16 != 0 || v % 16 != 0) continue;
      const double between = cross(ray(u + 0.5, v) - ray(u - 0.5, v),  //
                                   ray(u, v + 0.5) - ray(u, v - 0.5));
      worst = std::max(worst, std::abs(area / between - 1));
    }
    EXPECT_LT(worst, 1e-3);
    if (lens.distortion.size() == 8) {
      EXPECT_GT(largest, 1.75);
    }
    std::vector<Eigen::Vector2d> outline;
    const double right = lens.width - 0.5, bottom = lens.height - 0.5;
    for (double u = -0.5; u < right; ++u) outline.push_back(ray(u, -0.5));
    for (double v = -0.5; v < bottom; ++v) outline.push_back(ray(right, v));
    for (double u = right; u > -0.5; --u) outline.push_back(ray(u, bottom));
    for (double v = bottom; v > -0.5; --v) outline.push_back(ray(-0.5, v));
    double enclosed = 0;
    for (std::size_t i = 0; i < outline.size(); ++i)
      enclosed += cross(outline[i], outline[(i + 1) % outline.size()]) / 2;
    EXPECT_NEAR(sum / enclosed, 1, 1e-4);
  }
}

TEST(SensorView, CorrectedDepthsAreGainAndOffset) {
  DepthImage depth(20, 10, 2.0f);
  depth(1, 1) = 0;
  depth(2, 1) = 0.01f;
  const SensorView view = Corrected(MakeSensorView(depth, Coarse()), 1.01, -0.05);
  EXPECT_FLOAT_EQ(view.depth(0, 0), 1.97f);
  EXPECT_EQ(view.depth(1, 1), 0.0f);  // not measured
  EXPECT_GT(view.depth(2, 1), 0.0f);  // a measurement still
}

TEST(SensorView, DecimationKeepsPointsAndTheirLabels) {
  DepthImage depth(20, 10);
  SegmentationResult segmentation{LabelImage(20, 10), Image<float>(20, 10)};
  for (std::size_t i = 0; i < depth.size(); ++i) {
    depth[i] = 1 + 0.01f * static_cast<float>(i);
    segmentation.labels[i] = static_cast<std::uint8_t>(i % 21);
    segmentation.confidence[i] = 0.001f * static_cast<float>(i);
  }
  const SensorView view = MakeSensorView(depth, Coarse());
  for (const int stride : {1, 2, 3, 7}) {
    const SensorView small = Decimate(view, stride);
    const SegmentationResult labels = Decimate(segmentation, stride);
    int rows = 0;
    for (int v = stride / 2; v < 10; v += stride, ++rows) {
      int columns = 0;
      for (int u = stride / 2; u < 20; u += stride, ++columns) {
        ASSERT_TRUE(small.depth.Contains(columns, rows)) << stride;
        EXPECT_EQ(small.Point(columns, rows), view.Point(u, v)) << stride;
        EXPECT_EQ(labels.labels(columns, rows), segmentation.labels(u, v)) << stride;
        EXPECT_EQ(labels.confidence(columns, rows), segmentation.confidence(u, v)) << stride;
      }
      EXPECT_EQ(small.width(), columns) << stride;
    }
    EXPECT_EQ(small.height(), rows) << stride;
    EXPECT_NEAR(small.ray_areas(0, 0), stride * stride / 1600.0, 1e-8);
  }
}

TEST(StrideForRays, LeavesAtLeastSoMany) {
  EXPECT_EQ(StrideForRays(std::size_t{320} * 288, 10000), 3);
  EXPECT_EQ(StrideForRays(std::size_t{320} * 180, 10000), 2);
  EXPECT_EQ(StrideForRays(9999, 10000), 1);
  EXPECT_EQ(StrideForRays(0, 10000), 1);
  for (std::size_t pixels = 10000; pixels < 1000000; pixels += 7777) {
    const int stride = StrideForRays(pixels, 10000);
    const double left = static_cast<double>(pixels) / (stride * stride);
    const double next = static_cast<double>(pixels) / ((stride + 1) * (stride + 1));
    EXPECT_GE(left, 10000) << pixels;
    EXPECT_LT(next, 10000) << pixels;
  }
}

TEST(PriorErrorsOf, HasTheKindsErrorsButForTheSmoothOne) {
  for (const char* kind : {"realsense_d415", "azure_kinect_nfov_binned", "lidar"}) {
    const DepthErrorModel prior = PriorErrorsOf(kind);
    EXPECT_EQ(prior.Smooth(3), ErrorsOf("lidar").Smooth(3)) << kind;
    EXPECT_EQ(prior.White(3), ErrorsOf(kind).White(3)) << kind;
    EXPECT_EQ(prior.gain, ErrorsOf(kind).gain) << kind;
  }
  EXPECT_LT(PriorErrorsOf("realsense_d415").Smooth(2), ErrorsOf("realsense_d415").Smooth(2));
}

using namespace testing_infer;

/// Depth in centimetres is the label, the column of the network's frame the confidence.
class Ruler : public NetworkSegmenter {
 public:
  Ruler() : NetworkSegmenter({PaperStructure(), {117, 127}, "ruler", "0", ""}) {}

  std::vector<std::size_t> batches;

 private:
  std::vector<SegmentationResult> Forward(const std::vector<const DepthImage*>& depths) override {
    batches.push_back(depths.size());
    std::vector<SegmentationResult> results;
    for (const DepthImage* depth : depths) {
      EXPECT_EQ(depth->size(), depths.front()->size());
      SegmentationResult result{LabelImage(depth->width(), depth->height()),
                                Image<float>(depth->width(), depth->height())};
      for (const auto [u, v] : Pixels(*depth)) {
        result.labels(u, v) = static_cast<std::uint8_t>(std::lround(100 * (*depth)(u, v)));
        result.confidence(u, v) = static_cast<float>(u);
      }
      results.push_back(std::move(result));
    }
    return results;
  }
};

TEST(NetworkSegmenter, BringsFramesThereAndLabelsBack) {
  Ruler ruler;
  const Intrinsics full = Kinect(), small = Kinect().Resized(160, 144);
  DepthImage large_depth(320, 288, 1.0f), small_depth(160, 144, 2.0f);
  large_depth(10, 20) = 0;
  std::vector<SegmentationRequest> requests(10, {&small_depth, &small, 0});
  requests.push_back({&large_depth, &full, 0});  // of the small ones' size for the network
  requests.push_back({&small_depth, &small, 1});
  const std::vector<SegmentationResult> results = ruler.Segment(requests);
  ASSERT_EQ(results.size(), 12u);
  // Eleven frames of one size, in batches of eight, and one that is turned.
  EXPECT_EQ(ruler.batches, (std::vector<std::size_t>{1, 8, 3}));
  EXPECT_EQ(results[9].labels, LabelImage(160, 144, 200));
  EXPECT_EQ(results[9].confidence(7, 3), 7);
  EXPECT_EQ(results[10].labels(11, 20), 100);
  EXPECT_EQ(results[10].labels(10, 20), 0);  // no depth, no label
  EXPECT_EQ(results[10].confidence(319, 0), 159);
  // Turned clockwise, the frame's lowest row is the first column.
  EXPECT_EQ(results[11].confidence(5, 143), 0);
  EXPECT_EQ(results[11].confidence(5, 0), 143);
  EXPECT_EQ(ruler.Segment(small_depth, small, 2).confidence(5, 0), 154);
  EXPECT_EQ(ruler.Segment(small_depth, small, 3).confidence(5, 143), 143);
  EXPECT_EQ(ruler.file(), "ruler");
  EXPECT_EQ(ruler.structure().Hash(), PaperStructure().Hash());
}

TEST(NetworkFrame, BringsTheFocalLengthIntoTheTrainedRange) {
  struct Case {
    double focal;
    int width, height;
    double scale;
    int out_width, out_height;
  };
  // Azure Kinect and D415 at full size, a network-sized frame, one just beyond the range, and one
  // of odd ratio.
  for (const Case& c : {Case{252.2, 320, 288, 2, 160, 144}, Case{235.9, 320, 180, 2, 160, 90},
                        Case{126.1, 160, 144, 1, 160, 144}, Case{127.5, 160, 144, 1, 160, 144},
                        Case{943.6, 1280, 720, 8, 160, 90}, Case{63, 80, 72, 0.5, 160, 144}}) {
    const NetworkFrame frame =
        PlanNetworkFrame({c.width, c.height, c.focal, c.focal, 0, 0, {}}, {117.0, 126.5});
    EXPECT_NEAR(frame.scale, c.scale, 0.05 * c.scale) << c.focal;
    EXPECT_NEAR(frame.width, c.out_width, 0.05 * c.out_width);
    EXPECT_NEAR(frame.height, c.out_height, 0.05 * c.out_height);
    EXPECT_GE(c.focal / frame.scale, 117.0 / 1.02);
    EXPECT_LE(c.focal / frame.scale, 126.5 * 1.02);
  }
  const Intrinsics tiny{20, 20, 252, 252, 0, 0, {}};
  ExpectError<DataError>([&] { PlanNetworkFrame(tiny, {117, 126}); }, {"20x20", "16 px"});
}

TEST(NetworkFrame, ResamplingInventsNoDepth) {
  DepthImage depth(320, 288);
  for (std::size_t i = 0; i < depth.size(); ++i) depth[i] = static_cast<float>(i + 1);
  for (const double scale : {2.0, 2.37, 0.5}) {
    const NetworkFrame frame{static_cast<int>(320 / scale), static_cast<int>(288 / scale), scale};
    const DepthImage small = ResampleDepth(depth, frame);
    for (const auto [u, v] : Pixels(small)) {
      const int i = static_cast<int>(small(u, v)) - 1;
      ASSERT_EQ(static_cast<float>(i + 1), small(u, v)) << "not a value of the frame";
      // Brute force: the frame pixel whose centre is nearest; pixel centres have integer
      // coordinates.
      const int column = i % 320, row = i / 320;
      EXPECT_LE(std::abs(column - ((u + .5) * scale - .5)), 0.5 + 1e-9) << scale;
      EXPECT_LE(std::abs(row - ((v + .5) * scale - .5)), 0.5 + 1e-9) << scale;
    }
  }
}

TEST(NetworkFrame, LabelsComeBackToTheSurfaceThatTheyMark) {
  // An edge at column 5: the half-size frame samples odd columns, so that column 4's nearest sample
  // is across it.
  DepthImage depth(12, 8, 3.0f);
  for (const auto [u, v] : Pixels(5, 8)) depth(u, v) = 2.0f;
  depth(1, 1) = 0;
  const NetworkFrame frame{6, 4, 2.0};
  const DepthImage small = ResampleDepth(depth, frame);
  LabelImage labels(6, 4);
  Image<float> confidence(6, 4);
  for (const auto [u, v] : Pixels(6, 4)) {
    labels(u, v) = small(u, v) == 2.0f ? 7 : 0;
    confidence(u, v) = labels(u, v) ? 0.75f : 0.5f;
  }
  const SegmentationResult result = RestoreSegmentation(depth, small, labels, confidence, frame);
  for (const auto [u, v] : Pixels(12, 8)) {
    const bool hole = u == 1 && v == 1;
    EXPECT_EQ(result.labels(u, v), u < 5 && !hole ? 7 : 0) << u << " " << v;
    EXPECT_EQ(result.confidence(u, v), hole ? 0.0f : u < 5 ? 0.75f : 0.5f) << u << " " << v;
  }
}

}  // namespace
}  // namespace volalign::sensor_view_test
