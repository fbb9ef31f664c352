// The figures that docs/sensor-models.md cites, measured on rendered frames, each within 10 %.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <vector>

#include "core/geometry/structure.h"
#include "render/egl/renderers.h"
#include "render/noise.h"
#include "render/sample.h"
#include "tests/core/base/pixels.h"
#include "tests/core/base/tally.h"
#include "tests/render/noise_scenes.h"
#include "tests/render/test_scene.h"

namespace volalign::noise_figures_test {
namespace {

const char* const kAzure = "azure_kinect_nfov_binned";
const char* const kD415 = "realsense_d415";
constexpr double kFocalBaseline = 51.9;  // px m

#define EXPECT_WITHIN_10_PERCENT(value, cited) EXPECT_NEAR(value, cited, 0.1 * (cited))

class NoiseFiguresTest : public testing::Test {
 protected:
  NoiseFiguresTest() : structure_(ReadStructure("configs/structure.yaml")) {}

  static Intrinsics Camera(bool stereo) {
    return stereo ? CentredCamera(320, 180, 236) : CentredCamera(320, 288, 252);
  }

  /// A bright, textured wall at z and perhaps a plate before it, of `half` height and width.
  std::vector<DepthImage> Frames(const char* sensor, double z, double plate_z, double half,
                                 int count) {
    const Intrinsics k = Camera(sensor == kD415);
    const WallScene scene(renderer_, k, z, plate_z, half);
    std::vector<DepthImage> frames;
    frames.reserve(static_cast<std::size_t>(count));
    for (int i = 0; i < count; ++i)
      frames.push_back(ApplyNoise({}, {scene.view, scene.mesh, structure_, k, scene.pose, sensor},
                                  5, static_cast<std::uint64_t>(i))
                           .depth);
    return frames;
  }

  struct Spread {
    double local = 0, whole = 0;
  };
  /// Root mean squares over the frames, m or px of disparity: `whole` of all pixels about their
  /// frame's mean, `local` of the difference between pixels `lag` columns apart, as if independent.
  static Spread Measure(const std::vector<DepthImage>& frames, double z, bool in_disparity) {
    constexpr int kLag = 3;  // beyond the grain's correlation, far below the warp's
    Tally whole, local;
    for (const DepthImage& frame : frames) {
      const auto error = [&](float d) {
        return in_disparity ? kFocalBaseline / d - kFocalBaseline / z : d - z;
      };
      Tally errors;
      for (const float d : frame)
        if (d > 0) errors += error(d);
      for (const float d : frame)
        if (d > 0) whole += error(d) - errors.Mean();
      for (int v = 0; v < frame.height(); ++v) {
        for (int u = kLag; u + kLag < frame.width(); ++u) {
          const float a = frame(u - kLag, v), b = frame(u, v), c = frame(u + kLag, v);
          if (a <= 0 || b <= 0 || c <= 0) continue;
          // The second difference leaves out what is smooth; its variance is 1.5 times a pixel's.
          local += (error(b) - 0.5 * (error(a) + error(c))) / std::sqrt(1.5);
        }
      }
    }
    return {local.Rms(), whole.Rms()};
  }

  const std::unique_ptr<DepthRenderer> owned_ = GlRenderers()();
  DepthRenderer& renderer_ = *owned_;
  Structure structure_;
};

TEST_F(NoiseFiguresTest, TimeOfFlightAxialNoiseAndWarp) {
  const double cited_mm[] = {0.41, 0.48, 0.57};  // at 1, 2 and 3 m, rounding to 1 mm included
  for (int metres = 1; metres <= 3; ++metres) {
    const Spread spread = Measure(Frames(kAzure, metres, 0, 0, 80), metres, false);
    EXPECT_WITHIN_10_PERCENT(1000 * spread.local, cited_mm[metres - 1]) << metres;
    EXPECT_WITHIN_10_PERCENT(1000 * spread.whole, 3.7) << metres;
  }
}

TEST_F(NoiseFiguresTest, StereoAxialNoiseAndWarp) {
  for (int metres = 1; metres <= 3; ++metres) {
    const Spread spread = Measure(Frames(kD415, metres, 0, 0, 120), metres, true);
    EXPECT_WITHIN_10_PERCENT(spread.local, 0.055) << metres;
    EXPECT_WITHIN_10_PERCENT(spread.whole, 0.15) << metres;
  }
}

// Runs of zeros at the left and right border of a plate 1.1 m wide, 1.3 m before a wall 3 m away.
TEST_F(NoiseFiguresTest, TimeOfFlightEdgeGaps) {
  double none = 0, few = 0, many = 0, wide = 0, flying = 0, total = 0;
  for (const DepthImage& frame : Frames(kAzure, 3.0, 1.7, 0.55, 600)) {
    for (int v = 80; v < 208; v += 4) {
      for (const int direction : {-1, 1}) {
        int near = direction > 0 ? 230 : 89;
        while (frame(near, v) == 0) near -= direction;
        while (frame(near, v) > 0 && frame(near, v) < 2.0F) near += direction;
        int far = near;
        while (frame(far, v) == 0) far += direction;
        const int gap = std::abs(far - near);
        flying += frame(far, v) < 2.9F;
        none += gap == 0;
        few += gap >= 1 && gap <= 3;
        many += gap > 3;
        wide += gap > 12;
        ++total;
      }
    }
  }
  EXPECT_GT(total, 10000);
  EXPECT_WITHIN_10_PERCENT(none / total, 0.33);
  EXPECT_WITHIN_10_PERCENT(few / total, 0.45);
  EXPECT_WITHIN_10_PERCENT(many / total, 0.22);
  EXPECT_NEAR(flying / total, 0.035, 0.03);  // 2 to 5 % flying pixels
  EXPECT_LT(wide / total, 0.01);
}

TEST_F(NoiseFiguresTest, ShareOfHolesInRooms) {
  for (const bool stereo : {false, true}) {
    const SampleContext context =
        MakeSampleContext(stereo ? SamplesOf(kD415, "320x180") : SamplesOf(kAzure, "320x288"), 1);
    Tally valid, on_structure;
    for (std::uint64_t i = 0; i < 160; ++i) {
      const Sample sample = Synthesize(context, renderer_, 12, i);
      for (const float z : sample.depth) valid += z > 0;
      for (std::size_t k = 0; k < sample.depth.size(); ++k)
        if (sample.labels_clean[k] != 0) on_structure += sample.depth[k] > 0;
    }
    EXPECT_GT(on_structure.Mean(), 0.88);
    // Of a picture of time of flight 17 % lie beyond the mask (noise_test), and 12 % of the rest
    // are holes.
    EXPECT_NEAR(valid.Mean(), stereo ? 0.63 : 0.83 * 0.88, stereo ? 0.063 : 0.015);
  }
}

}  // namespace
}  // namespace volalign::noise_figures_test
