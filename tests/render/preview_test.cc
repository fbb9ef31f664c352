#include "render/preview.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "core/base/error.h"
#include "core/formats/image_io.h"
#include "render/egl/egl_context.h"
#include "render/egl/gl_depth_renderer.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/has.h"
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

}  // namespace
}  // namespace volalign::preview_test
