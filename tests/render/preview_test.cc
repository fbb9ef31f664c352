#include "render/preview.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <string>

#include "core/base/error.h"
#include "core/base/random.h"
#include "core/formats/image_io.h"
#include "render/depth_statistics.h"
#include "render/egl/egl_context.h"
#include "render/egl/gl_depth_renderer.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/core/base/temp_folder.h"
#include "tests/render/test_scene.h"

namespace volalign::preview_test {
namespace {

namespace fs = std::filesystem;

class Preview : public testing::Test {
 protected:
  Preview() {
    config_.sensors = {"realsense_d415"};
    config_.image_sizes = {"64x36"};
    options_.count = 2;
    fs::create_directories(real_ / "labels");
  }
  std::string Write() { return WritePreview(folder_.path(), config_, options_, renderer_); }
  RgbImage Picture() const { return ReadPngRgb(folder_ / "preview.png"); }

  SampleConfig config_ = BareConfig();
  PreviewOptions options_;
  TempFolder folder_;
  fs::path real_ = folder_ / "real";
  EglContext egl_;
  GlDepthRenderer renderer_;
};

TEST_F(Preview, ShowsSamplesAndTheirFigures) {
  const std::string table = Write();
  EXPECT_TRUE(Has(table, "realsense_d415, 64x36", "| figure | rendered | before noise |",
                  "| frames | 2 | 2 |"));
  EXPECT_GT(Picture().width(), 2 * 64);
}

TEST_F(Preview, ComparesWithRealFramesOfTheSensorsAspectRatio) {
  config_.image_sizes = {"32x18"};
  Write();
  const int height = Picture().height();
  config_.image_sizes = {"64x36"};
  Image16 depth(32, 18, 2000);
  for (const auto [u, v] : Pixels(8, 18)) depth(u, v) = 0;  // a quarter
  WritePng(real_ / "A_depth.png", depth);
  WritePng(real_ / "labels" / "A.png", LabelImage(32, 18, 1));
  WritePng(real_ / "colour.png", Image16(7, 7));  // is left out
  options_.real_frames = real_;
  const std::string table = Write();
  // Samples have the size of the real frames.
  EXPECT_TRUE(Has(table, "realsense_d415, 32x18", "| frames | 2 | 2 | 1 |",
                  "| 75.0 |"));                // valid pixels, %
  EXPECT_GT(Picture().height(), height + 18);  // a row of real frames more
}

TEST_F(Preview, SaysWhichFramesItCannotUse) {
  options_.real_frames = folder_ / "none";
  ExpectError<IoError>([&] { Write(); }, {"none"});
  options_.real_frames = real_;
  ExpectError<DataError>([&] { Write(); }, {"real", "no depth frames"});
  WritePng(real_ / "b_depth.png", Image16(32, 32, 1000));
  ExpectError<DataError>([&] { Write(); }, {"b_depth.png", "32x32"});
  fs::remove(real_ / "b_depth.png");
  WritePng(real_ / "c_depth.png", Image16(32, 18, 1000));
  WritePng(real_ / "labels" / "c.png", LabelImage(16, 9));
  ExpectError<DataError>([&] { Write(); }, {"c.png", "16x9", "32x18"});
}

Intrinsics Camera(int width, int height) {
  return {width, height, 250, 250, 0.5 * width, 0.5 * height, {}};
}

/// z of the plane n.X = h along each pixel's ray.
DepthImage PlaneDepth(const Intrinsics& k, const Eigen::Vector3d& n, double h) {
  DepthImage depth(k.width, k.height);
  for (const auto [u, v] : Pixels(k.width, k.height)) {
    depth(u, v) =
        static_cast<float>(h / n.dot(Eigen::Vector3d((u - k.cx) / k.fx, (v - k.cy) / k.fy, 1)));
  }
  return depth;
}

TEST(DepthStatistics, HolesAndFieldOfViewByHand) {
  const Intrinsics k = Camera(40, 30);
  DepthImage depth(40, 30);
  for (const auto [u, v] : Pixels({10, 5}, {30, 25})) depth(u, v) = 2;
  depth(15, 15) = depth(16, 15) = depth(20, 20) = 0;
  DepthStatistics statistics({});
  statistics.Add(depth, k);
  EXPECT_DOUBLE_EQ(statistics.hull_share(), 400.0 / 1200);
  EXPECT_DOUBLE_EQ(statistics.valid_share(), 397.0 / 1200);
  EXPECT_NEAR(statistics.hole_share(), 3.0 / 400, 1e-12);
  EXPECT_THROW(statistics.Add(depth, Camera(41, 30)), Error);
}

TEST(DepthStatistics, GapsAndFlyingPixelsByHand) {
  // One row: near, far with a gap of 0, 2, 13; a mid-depth pixel; a step below 0.3 m.
  DepthImage depth(60, 1, 2.0F);
  const auto fill = [&](int first, int last, float z) {
    for (int u = first; u <= last; ++u) depth(u, 0) = z;
  };
  fill(5, 9, 4);    // gap 0 at 4|5 and at 9|10
  fill(20, 21, 0);  // gap 2
  fill(22, 26, 4);  // back to 2 m at 27: gap 0
  fill(30, 42, 0);  // gap 13
  fill(43, 46, 4);
  depth(47, 0) = 3;  // flying: 4, 3, 2 are two jumps with gap 0
  fill(54, 55, 2.2F);
  DepthStatistics statistics({});
  statistics.Add(depth, Camera(60, 1));
  const auto shares = statistics.GapShares();
  EXPECT_NEAR(shares[0], 5.0 / 7, 1e-12);
  EXPECT_NEAR(shares[2], 1.0 / 7, 1e-12);
  EXPECT_NEAR(shares[5], 1.0 / 7, 1e-12);
  EXPECT_NEAR(statistics.FlyingShare(), 1.0 / 7, 1e-12);
}

// White noise of known spread on a slanted plane: a 9x9 fit takes 3 of 81 degrees of freedom, which
// the residual allows for; the lower quartile of a chi distribution with 78 degrees of freedom lies
// 5.4 % below its spread.
TEST(DepthStatistics, LocalResidualIsTheSpreadOfWhiteNoise) {
  const Intrinsics k = Camera(240, 200);
  DepthImage depth = PlaneDepth(k, Eigen::Vector3d(0.5, 0.1, 1).normalized(), 1.55);
  RandomStream random(1, 2, "noise");
  for (float& z : depth) z += static_cast<float>(0.004 * random.Normal());
  DepthStatistics statistics({});
  statistics.Add(depth, k);
  double measured = -1;
  for (std::size_t d = 0; d < 5; ++d) measured = std::max(measured, statistics.LocalResidual(d, 0));
  EXPECT_NEAR(measured, 4 * 0.946, 0.1);
}

TEST(DepthStatistics, AWallSeenThroughALensIsFlat) {
  Intrinsics k{160, 144, 126, 126, 79, 84, {0.92, 0.50, 0, 0, 0.028, 1.26, 0.75, 0.144}};
  DepthImage depth(k.width, k.height);
  const Eigen::Vector3d normal = Eigen::Vector3d(0.4, -0.3, 1).normalized();
  for (const auto [u, v] : Pixels(k.width, k.height)) {
    // OpenCV's radial model, inverted by bisection.
    const Eigen::Vector2d seen((u - k.cx) / k.fx, (v - k.cy) / k.fy);
    double low = 0, high = 3;
    for (int i = 0; i < 60; ++i) {
      const double r = (low + high) / 2, r2 = r * r;
      const double bent = r * (1 + r2 * (0.92 + r2 * (0.50 + r2 * 0.028))) /
                          (1 + r2 * (1.26 + r2 * (0.75 + r2 * 0.144)));
      (bent < seen.norm() ? low : high) = r;
    }
    const Eigen::Vector2d ray = seen.norm() > 0 ? seen * (low / seen.norm()) : seen;
    depth(u, v) = static_cast<float>(1.6 / normal.dot(ray.homogeneous()));
  }
  DepthStatistics through_lens({}), pinhole({});
  through_lens.Add(depth, k);
  ASSERT_EQ(through_lens.planes().size(), 1U);
  EXPECT_EQ(through_lens.planes()[0].pixels, 160 * 144);
  EXPECT_LT(through_lens.planes()[0].rms_mm, 0.01);
  LabelImage labels(k.width, k.height, 4);
  through_lens.AddSides(depth, labels, k);
  EXPECT_LT(through_lens.SideResidual(false), 0.01);
  k.distortion.clear();
  pinhole.AddSides(depth, labels, k);
  EXPECT_GT(pinhole.SideResidual(false), 5);
}

TEST(DepthStatistics, TwoWallsAreTwoPlanesWithTheirWaves) {
  const Intrinsics k = Camera(240, 200);
  const DepthImage left = PlaneDepth(k, Eigen::Vector3d(-0.5, 0, 1).normalized(), 2.0);
  const DepthImage right = PlaneDepth(k, Eigen::Vector3d(0.5, 0, 1).normalized(), 2.0);
  DepthImage depth(k.width, k.height);
  for (const auto [u, v] : Pixels(k.width, k.height)) {
    // A standing wave of 5 mm amplitude, 2.5 mm rms, too long for 7x7 means to flatten.
    const double wave =
        0.005 * std::sin(2 * 3.14159265 * u / 48) * std::sin(2 * 3.14159265 * v / 48);
    depth(u, v) = static_cast<float>(std::max(left(u, v), right(u, v)) + wave);
  }
  DepthStatistics statistics({});
  statistics.Add(depth, k);
  ASSERT_EQ(statistics.planes().size(), 2U);
  for (const DepthStatistics::Plane& plane : statistics.planes()) {
    EXPECT_GT(plane.pixels, 0.45 * 240 * 200);
    EXPECT_NEAR(plane.rms_mm, 2.5, 0.25);
    EXPECT_NEAR(plane.smooth_mm, 2.5 * 0.93, 0.25);
  }
  LabelImage labels(k.width, k.height);
  for (const auto [u, v] : Pixels(k.width, k.height))
    labels(u, v) = left(u, v) > right(u, v) ? 3 : 7;
  statistics.AddSides(depth, labels, k);
  ASSERT_EQ(statistics.sides().size(), 2U);
  EXPECT_NEAR(statistics.SideResidual(false), 2.5, 0.25);
  const double z = statistics.sides()[0].distance;
  EXPECT_NEAR(statistics.SideResidual(true), 0.0025 * 51.9 / (z * z),
              0.1 * 0.0025 * 51.9 / (z * z));
}

}  // namespace
}  // namespace volalign::preview_test
