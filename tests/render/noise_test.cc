#include "render/noise.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/noise_fields.h"
#include "core/base/statistics.h"
#include "core/geometry/frame_errors.h"
#include "core/geometry/sensor_kind.h"
#include "core/geometry/structure.h"
#include "render/egl/renderers.h"
#include "render/sample.h"
#include "render/subpixels.h"
#include "tests/core/base/pixels.h"
#include "tests/core/base/tally.h"
#include "tests/core/geometry/mesh_shapes.h"
#include "tests/render/noise_scenes.h"
#include "tests/render/test_scene.h"

namespace volalign::noise_test {
namespace {

const char* const kAzure = "azure_kinect_nfov_binned";
const char* const kD415 = "realsense_d415";
const NoiseConfig kPhysics = [] {
  NoiseConfig config;
  config.models = {"physics"};
  return config;
}();

class NoiseTest : public testing::Test {
 protected:
  NoiseTest() : structure_(ReadStructure("configs/structure.yaml")) {}

  WallScene MakeWall(double z, double plate_z, const Intrinsics& k) {
    return WallScene(renderer_, k, z, plate_z, 0.3);
  }

  NoisyView Spoil(const WallScene& scene, const Intrinsics& k, const std::string& sensor,
                  std::uint64_t index, const NoiseConfig& config = {}) {
    return ApplyNoise(config, {scene.view, scene.mesh, structure_, k, scene.pose, sensor}, 77,
                      index);
  }

  const std::unique_ptr<DepthRenderer> owned_ = GlRenderers()();
  DepthRenderer& renderer_ = *owned_;
  Structure structure_;
};

struct Residual {
  double mean = 0, rms = 0, local = 0, valid = 0;
};

/// `local`: standard deviation per pixel estimated from differences of horizontal neighbours, which
/// a smooth warp hardly changes.
Residual Measure(const DepthImage& depth, double z, bool in_disparity) {
  Tally errors, differences;
  for (const auto [u, v] : Pixels(depth)) {
    const double d = depth(u, v);
    if (d == 0) continue;
    const double e = in_disparity ? 51.9 / d - 51.9 / z : d - z;
    errors += e;
    if (u + 1 < depth.width() && depth(u + 1, v) > 0) {
      const double f = depth(u + 1, v);
      const double g = in_disparity ? 51.9 / f - 51.9 / z : f - z;
      differences += e - g;
    }
  }
  return {errors.Mean(), std::sqrt(errors.Variance()), std::sqrt(0.5) * differences.Rms(),
          errors.count / static_cast<double>(depth.size())};
}

TEST(NoiseFieldsTest, SmoothFieldHasUnitVarianceAndItsCorrelation) {
  Tally values, lag, far;
  for (std::uint64_t i = 0; i < 60; ++i) {
    RandomStream random(1, i, "field");
    const Image<float> field = SmoothField(120, 90, 12, random);
    for (const auto [u, v] : Pixels(120, 90)) {
      values += field(u, v);
      if (u + 12 < 120) lag += field(u, v) * field(u + 12, v);
      if (u + 40 < 120) far += field(u, v) * field(u + 40, v);
    }
  }
  EXPECT_NEAR(values.Mean(), 0, 0.1);
  EXPECT_NEAR(values.squares / values.count, 1, 0.1);
  EXPECT_NEAR(lag.Mean(), std::exp(-1.0), 0.1);
  EXPECT_NEAR(far.Mean(), 0, 0.08);
}

TEST(NoiseFieldsTest, PixelNumbersHaveTheirMoments) {
  RandomStream random(1, 2, "pixel");
  const PixelRandom pixel(random);
  Tally normal, uniform;
  for (std::uint64_t i = 0; i < 200'000; ++i) {
    normal += pixel.Normal(i);
    uniform += pixel.Uniform(i);
  }
  EXPECT_NEAR(normal.Mean(), 0, 0.012);
  EXPECT_NEAR(normal.squares / normal.count, 1, 0.012);
  EXPECT_NEAR(uniform.Mean(), 0.5, 0.004);
}

TEST(NoiseFieldsTest, PoissonHasItsMeanAndVariance) {
  RandomStream random(1, 2, "poisson");
  Tally drawn;
  for (int i = 0; i < 4000; ++i) drawn += DrawPoisson(6, random);
  EXPECT_NEAR(drawn.Mean(), 6, 0.25);
  EXPECT_NEAR(drawn.Variance(), 6, 0.8);
}

// docs/sensor-models.md: bias within 11 mm; mask about 82 %. noise_figures_test has the others.
TEST_F(NoiseTest, TimeOfFlightHasABiasAndAMask) {
  const Intrinsics k = CentredCamera(320, 288, 252);
  const WallScene scene = MakeWall(2.0, 0, k);
  double bias = 0, valid = 0;
  for (std::uint64_t i = 0; i < 20; ++i) {
    const NoisyView noisy = Spoil(scene, k, kAzure, i);
    const Residual r = Measure(noisy.depth, 2.0, false);
    EXPECT_LT(std::abs(r.mean), 0.017);
    EXPECT_GT(r.valid, 0.77);
    EXPECT_LT(r.valid, 0.84);
    bias = std::max(bias, std::abs(r.mean));
    valid += r.valid / 20;
  }
  EXPECT_GT(bias, 0.005);
  EXPECT_NEAR(valid, 0.815, 0.015);
}

// The grain is as round at twice the size of 320x288 as there: with 1.24 px in one direction and
// 0.62 in the other, neighbours would differ 1.5 times as much in the second.
TEST_F(NoiseTest, TimeOfFlightGrainIsAlikeAlongRowsAndColumns) {
  const Intrinsics k = CentredCamera(640, 576, 504);
  const NoisyView noisy = Spoil(MakeWall(8.0, 0, k), k, kAzure, 0);
  Tally along_rows, along_columns;
  for (const auto [u, v] : Pixels({1, 1}, {k.width, k.height})) {
    const float d = noisy.depth(u, v), left = noisy.depth(u - 1, v), up = noisy.depth(u, v - 1);
    if (d == 0 || left == 0 || up == 0) continue;
    along_rows += d - left;
    along_columns += d - up;
  }
  EXPECT_GT(along_rows.count, 100000);
  EXPECT_NEAR(along_rows.Rms() / along_columns.Rms(), 1, 0.05);
}

TEST_F(NoiseTest, HexagonKeepsItsShapeAtHalfSize) {
  const Intrinsics k = CentredCamera(160, 144, 126);
  const WallScene scene = MakeWall(2.0, 0, k);
  const NoisyView noisy = Spoil(scene, k, kAzure, 3);
  // Row 73.55 of 144 is the widest; the first row reaches 93 of 320 px to each side of a centre at
  // 158 to 170.
  int first = 0, middle = 0;
  for (int u = 0; u < 160; ++u) {
    first += noisy.depth(u, 0) > 0;
    middle += noisy.depth(u, 73) > 0;
  }
  EXPECT_NEAR(first, 93, 6);
  EXPECT_GT(middle, 150);
}

// The plate spans 0.6 m at 1.6 m: columns 159.5 -+ 44.25. Its shadow is 12.975 (1/1.6 - 1/z) px
// wide, of which the matcher sees half a pixel: whole pixels are lost.
TEST_F(NoiseTest, StereoShadowLiesLeftOfTheForeground) {
  const Intrinsics k = CentredCamera(320, 180, 236);
  for (const double z : {4.0, 3.5}) {
    const WallScene scene = MakeWall(z, 1.6, k);
    double left = 0, right = 0;
    constexpr int kFrames = 12;
    for (std::uint64_t i = 0; i < kFrames; ++i) {
      const NoisyView noisy = Spoil(scene, k, kD415, i);
      for (int v = 70; v < 110; ++v) {
        // From inside the plate outwards: past its last pixel (it may be grown by a pixel or two),
        // count what is lost.
        for (const int step : {-1, 1}) {
          int u = step < 0 ? 119 : 200, run = 0;
          while (noisy.depth(u, v) > 0 && noisy.depth(u, v) < 2) u += step;
          for (; noisy.depth(u, v) == 0; u += step) ++run;
          (step < 0 ? left : right) += run / (40.0 * kFrames);
        }
      }
    }
    EXPECT_NEAR(left, std::floor(12.975 * (1 / 1.6 - 1 / z) - 0.5) + 0.3, 0.4) << z;
    EXPECT_LT(right, 2.0);
  }
}

// Surfaces too near for the search of 126 px at 1280, and, along a floor, steeper than 70 deg.
TEST_F(NoiseTest, StereoLosesNearAndSteepSurfaces) {
  const Intrinsics k = CentredCamera(320, 180, 236);
  const auto valid = [](const NoisyView& noisy) {
    return std::count_if(noisy.depth.begin(), noisy.depth.end(), [](float z) { return z > 0; });
  };
  EXPECT_EQ(valid(Spoil(MakeWall(0.40, 0, k), k, kD415, 0)), 0);
  EXPECT_GT(valid(Spoil(MakeWall(0.43, 0, k), k, kD415, 0)), 10000);
  WallScene scene;
  scene.mesh.BeginObject({0.9F, 1.0F, true});
  scene.mesh.AppendQuad({Eigen::Vector3d(-90, 0, -90), Eigen::Vector3d(90, 0, -90),
                         Eigen::Vector3d(90, 0, 90), Eigen::Vector3d(-90, 0, 90)},
                        Eigen::Vector3d::UnitY());
  scene.pose = LookAt({0, 0.4, 0}, {1, 0.4, 0}, 0);
  renderer_.Render(scene.mesh, k, scene.pose, &scene.view);
  Tally steep, flat;
  for (std::uint64_t i = 0; i < 60; ++i) {
    const NoisyView noisy = Spoil(scene, k, kD415, i);
    // Cosines of 0.06 to 0.08 and of 0.24 to 0.28.
    for (const auto [u, v] : Pixels({140, 104}, {180, 108})) steep += noisy.depth(u, v) == 0;
    for (const auto [u, v] : Pixels({140, 148}, {180, 158})) flat += noisy.depth(u, v) == 0;
  }
  // Texture of 2.3 to 3.6 less 2 (0.35 - c) and 8 (0.22 - c), with fields of 0.98 in all.
  EXPECT_NEAR(steep.Mean(), 0.13, 0.05);
  EXPECT_LT(flat.Mean(), 0.02);
}

// A wall that returns half the light at the highest threshold is lost in half of the frames, and
// in many of them in part. None is measured beyond 16 m.
TEST_F(NoiseTest, TimeOfFlightLosesDarkAndFarSurfaces) {
  const Intrinsics k = CentredCamera(320, 288, 252);
  WallScene scene = MakeWall(2.0, 0, k);
  scene.mesh.objects[0].reflectivity = 0.002F * 4;
  Tally lost, partly;
  for (std::uint64_t i = 0; i < 100; ++i) {
    const NoisyView noisy = Spoil(scene, k, kAzure, i);
    Tally here;
    for (const auto [u, v] : Pixels({140, 124}, {180, 164})) here += noisy.depth(u, v) == 0;
    lost += here.Mean();
    partly += here.Mean() > 0.1 && here.Mean() < 0.9;
  }
  EXPECT_NEAR(lost.Mean(), 0.5, 0.12);
  EXPECT_GT(partly.Mean(), 0.2);
  const auto measured = [&](double z) {
    WallScene far = MakeWall(z, 0, k);
    far.mesh.objects[0].reflectivity = 2;
    return Spoil(far, k, kAzure, 0).depth(160, 144) > 0;
  };
  EXPECT_TRUE(measured(15.8));
  EXPECT_FALSE(measured(16.2));
}

/// How much farther the floor reads at a box than 35 cm and more away from it, m: within 5 cm of
/// it, and from 8 to 18 cm.
struct CornerErrors {
  double near = 0, middle = 0;
};

CornerErrors MeasureCorner(const NoiseConfig& config, int frames, const Structure& structure,
                           DepthRenderer& renderer) {
  const CornerScene scene(structure, renderer);
  const auto& [mesh, k, pose, view] = scene;
  const double y = structure.FloorHeight();
  Tally near, middle, far;
  for (std::uint64_t i = 0; i < static_cast<std::uint64_t>(frames); ++i) {
    const NoisyView noisy = ApplyNoise(config, {view, mesh, structure, k, pose, kAzure}, 78, i);
    for (const auto [u, v] : Pixels(k.width, k.height)) {
      const double z = view.depth(u, v);
      if (noisy.depth(u, v) == 0 || view.labels(u, v) != 0) continue;
      const Eigen::Vector3d p =
          pose * Eigen::Vector3d((u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z);
      if (std::abs(p.y() - y) > 1e-3 || std::abs(p.z()) > 0.12) continue;
      const double error = noisy.depth(u, v) - z;
      if (p.x() < 0.275 + 0.05) near += error;
      if (p.x() > 0.275 + 0.08 && p.x() < 0.275 + 0.18) middle += error;
      if (p.x() > 0.275 + 0.35) far += error;
    }
  }
  EXPECT_GT(std::min({near.count, middle.count, far.count}), 12.0 * frames);
  return {near.Mean() - far.Mean(), middle.Mean() - far.Mean()};
}

TEST_F(NoiseTest, ConcaveCornersReadTooFar) {
  const CornerErrors errors = MeasureCorner({}, 40, structure_, renderer_);
  // On average 12.5 mm at the seam, falling linearly over 0.3 m, and the corner filled by 10 mm,
  // falling over 6 cm: 11.5 - 5.8 mm in the first 5 cm, 7.1 mm at 8 to 18 cm.
  EXPECT_NEAR(errors.near, 0.0057, 0.003);
  EXPECT_NEAR(errors.middle, 0.0071, 0.003);
  // Light that bounces off the box has farther to go, too.
  const CornerErrors bounced = MeasureCorner(kPhysics, 6, structure_, renderer_);
  EXPECT_GT(bounced.middle, 0.001);
  EXPECT_LT(bounced.middle, 0.012);
  // Close to the seam the way over the box is hardly longer.
  EXPECT_LT(bounced.near, bounced.middle);
}

// The noise model "physics", of time of flight. A wall is straight for it, but for the device's
// harmonics.
TEST_F(NoiseTest, PhysicsOfTimeOfFlightHasTheWhiteNoiseOfRealFrames) {
  const Intrinsics k = CentredCamera(320, 288, 252);
  for (const double z : {1.0, 2.0, 3.0}) {
    const WallScene scene = MakeWall(z, 0, k);
    const Residual r = Measure(Spoil(scene, k, kAzure, 1, kPhysics).depth, z, false);
    // 0.4 mm at 2 m and what grows with z for reflectivity 0.6, 1 mm steps, an offset of each
    // pixel.
    const double white = 0.0004 * z / 2 * std::sqrt(0.6 / 0.9);
    const double local = std::hypot(white, 0.0003, 0.00029);
    EXPECT_NEAR(r.local, local, 0.25 * local) << z;
    EXPECT_LT(r.rms, 0.006) << z;
    EXPECT_LT(std::abs(r.mean), 0.015) << z;
  }
}

TEST_F(NoiseTest, PhysicsOfTimeOfFlightMixesSurfacesAtEdges) {
  const Intrinsics k = CentredCamera(320, 288, 252);
  int lost = 0, off = 0, rows = 0;
  for (const double wall : {2.2, 2.6, 3.0, 3.4, 3.8}) {
    const WallScene scene = MakeWall(wall, 1.77, k);
    const NoisyView noisy = Spoil(scene, k, kAzure, 1, kPhysics);
    for (int v = 110; v < 178; ++v) {
      ++rows;
      // The plate's right edge, column 159.5 + 42.7: a pixel of which it has 70 %.
      for (int u = 198; u < 206; ++u) {
        const float z = noisy.depth(u, v);
        lost += z == 0;
        if (z == 0 || std::abs(z - scene.view.depth(u, v)) < 0.05F) continue;
        ++off;
        EXPECT_EQ(noisy.labels(u, v), 0) << u << " " << v;
      }
    }
  }
  // The edge crosses one pixel of a row: its mixture is dropped or flies, or one surface outshines
  // the other.
  EXPECT_GT(lost, rows / 10);
  EXPECT_GT(lost + off, rows / 4);
  EXPECT_LE(lost + off, rows);
}

TEST_F(NoiseTest, PhysicsOfADeviceStaysFromFrameToFrame) {
  const Intrinsics k = CentredCamera(160, 144, 126), d415 = CentredCamera(160, 90, 118);
  for (const bool stereo : {false, true}) {
    const Intrinsics& camera = stereo ? d415 : k;
    const WallScene scene = MakeWall(2.0, 0, camera);
    const std::string sensor = stereo ? kD415 : kAzure;
    const NoiseInput input{scene.view, scene.mesh, structure_, camera, scene.pose, sensor};
    DeviceErrors device;
    const NoisyView first = ApplyNoise(kPhysics, input, 5, 1, &device);
    const NoisyView second = ApplyNoise(kPhysics, input, 5, 2, &device);
    const NoisyView other = ApplyNoise(kPhysics, input, 5, 3);
    EXPECT_TRUE(ApplyNoise(kPhysics, input, 5, 1).depth == first.depth);
    EXPECT_FALSE(second.depth == first.depth);
    const auto apart = [](const NoisyView& a, const NoisyView& b) {
      Tally off;
      for (std::size_t i = 0; i < a.depth.size(); ++i)
        if (a.depth[i] > 0 && b.depth[i] > 0) off += a.depth[i] - b.depth[i];
      return std::abs(off.Mean());
    };
    EXPECT_LT(apart(first, second), 2e-4) << sensor;
    EXPECT_GT(apart(first, other), 1e-3) << sensor;
  }
}

// The noise model "physics", of stereo: what block matching makes of two pictures.
TEST_F(NoiseTest, PhysicsOfStereoErrsInDisparityAndGrowsTheForeground) {
  const Intrinsics k = CentredCamera(320, 180, 236);
  for (const double z : {1.5, 3.0}) {
    const WallScene scene = MakeWall(z, 0, k);
    double rms = 0;
    for (std::uint64_t i = 0; i < 4; ++i) {
      const Residual r = Measure(Spoil(scene, k, kD415, i, kPhysics).depth, z, true);
      rms += r.rms / 4;
      EXPECT_GT(r.valid, 0.8) << z;
      EXPECT_LT(r.local, 0.08) << z;
    }
    // 0.10 to 0.27 px over whole faces of the real frame, bent cardboard with them.
    EXPECT_GT(rms, 0.03) << z;
    EXPECT_LT(rms, 0.27) << z;
  }
  // The plate spans 0.6 m at 1.6 m: columns 159.5 -+ 44.25. Shadow: 12.975 (1/1.6 - 1/4) = 4.9 px.
  const WallScene scene = MakeWall(4.0, 1.6, k);
  const NoisyView noisy = Spoil(scene, k, kD415, 1, kPhysics);
  double shadow = 0, grown = 0;
  for (int v = 70; v < 110; ++v) {
    int u = 119;
    while (noisy.depth(u, v) > 0 && noisy.depth(u, v) < 2) --u;
    for (; noisy.depth(u, v) == 0; --u) shadow += 1.0 / 40;
    double edge = 199.5;
    for (u = 200; noisy.depth(u, v) > 0 && u < 210; ++u)
      edge += std::clamp((4.0 - noisy.depth(u, v)) / (4.0 - 1.6), 0.0, 1.0);
    grown += (edge - 203.75) / 40;
  }
  EXPECT_NEAR(shadow, 4.9, 2.5);
  // By 0.10 px in this frame; up to half a window of 9 native pixels.
  EXPECT_GT(grown, 0.05);
  EXPECT_LT(grown, 1.2);
}

// The mean of pixels that are not about the middle of theirs would move all that is seen.
TEST_F(NoiseTest, PhysicsOfStereoMovesNothingAside) {
  const Intrinsics k = CentredCamera(160, 90, 118);
  for (const bool rows : {true, false}) {
    // A ridge 2 m away, whose slopes fall off steeply to both sides. What a device adds to the
    // depth of both moves them in opposite directions.
    WallScene scene;
    scene.mesh.BeginObject({0.9F, 1.0F, true});
    const double y = 2, run = 2.5, half = 1, wide = 9;
    const auto corner = [&](double x, double along, double across) {
      return rows ? Eigen::Vector3d(x, y + along, across) : Eigen::Vector3d(x, y + across, along);
    };
    for (const double side : {-1.0, 1.0}) {
      const std::array<Eigen::Vector3d, 4> slope = {corner(2, -wide, 0), corner(2, wide, 0),
                                                    corner(2 + run, wide, side * half),
                                                    corner(2 + run, -wide, side * half)};
      const Eigen::Vector3d out = corner(-half, 0, side * run) - corner(0, 0, 0);
      const bool turns = (slope[1] - slope[0]).cross(slope[2] - slope[1]).dot(out) < 0;
      scene.mesh.AppendQuad(
          turns ? std::array<Eigen::Vector3d, 4>{slope[3], slope[2], slope[1], slope[0]} : slope,
          out.normalized(), side < 0 ? 1 : 2);
    }
    scene.pose = LookAt({0, y, 0}, {2, y, 0}, 0);
    renderer_.Render(scene.mesh, k, scene.pose, &scene.view);
    Tally aside;
    for (std::uint64_t device = 0; device < 16; ++device) {
      const NoisyView noisy = Spoil(scene, k, kD415, device, kPhysics);
      for (const auto [u, v] : Pixels({8, 8}, {152, 82})) {
        const auto clean = [&, u = u, v = v](int step) {
          return rows ? scene.view.depth(u + step, v) : scene.view.depth(u, v + step);
        };
        const float before = clean(-5), after = clean(5);
        const bool straight = std::abs(before + after - 2 * clean(0)) < 0.1F;
        if (noisy.depth(u, v) == 0 || clean(0) > 3 || !straight) continue;
        aside += (noisy.depth(u, v) - clean(0)) / (after - before) * 10;
      }
    }
    EXPECT_GT(aside.count, 5000) << rows;
    // px. Tilts of 16 devices leave some 0.03; half a native pixel would be 0.125.
    EXPECT_NEAR(aside.Mean(), 0, 0.08) << rows;
  }
}

TEST_F(NoiseTest, LabelsVanishWithTheDepthAndFollowTheSurface) {
  SampleConfig config;
  config.sensors = {};
  config.image_sizes = {"160x144", "160x90", "160x120"};
  for (const char* model : {"sensor", "paper"}) {
    config.noise.models = {model};
    const SampleContext context = MakeSampleContext(config, 1);
    for (std::uint64_t i = 0; i < 24; ++i) {
      const Sample sample = Synthesize(context, renderer_, 31, i);
      long kept = 0, structure = 0, elsewhere = 0;
      for (std::size_t k = 0; k < sample.depth.size(); ++k) {
        EXPECT_TRUE(sample.depth[k] > 0 || sample.labels[k] == 0);
        EXPECT_GE(sample.depth[k], 0);
        structure += sample.labels_clean[k] != 0;
        kept += sample.labels_clean[k] != 0 && sample.labels[k] == sample.labels_clean[k];
        elsewhere += sample.labels[k] != 0 && sample.labels_clean[k] == 0;
      }
      EXPECT_GT(kept, 0.45 * structure) << model << " " << i << " " << sample.sensor;
      EXPECT_LE(elsewhere, 0.12 * structure) << model << " " << i << " " << sample.sensor;
    }
  }
}

TEST_F(NoiseTest, PaperNoiseClearsBordersAndHolesAlone) {
  const Intrinsics k = CentredCamera(160, 90, 118);
  const WallScene scene = MakeWall(4.0, 1.6, k);
  NoiseConfig config;
  config.models = {"paper"};
  config.paper_border_px = 4;
  config.paper_hole_count = 0;
  long cleared = 0;
  for (std::uint64_t i = 0; i < 10; ++i) {
    const NoisyView noisy = Spoil(scene, k, kD415, i, config);
    for (const auto [u, v] : Pixels(160, 90)) {
      if (noisy.depth(u, v) > 0) {
        EXPECT_EQ(noisy.depth(u, v), scene.view.depth(u, v));
        EXPECT_EQ(noisy.labels(u, v), scene.view.labels(u, v));
        continue;
      }
      ++cleared;
      // Brute force: an edge of the plate lies within the border, which varies by up to 3.5 sigma
      // of 40 %.
      bool near_edge = false;
      const int reach = static_cast<int>(4 * (1 + 0.4 * 4)) + 1;
      for (int q = std::max(0, v - reach); q <= std::min(89, v + reach); ++q) {
        for (int p = std::max(0, u - reach); p <= std::min(159, u + reach); ++p)
          near_edge |= scene.view.labels(p, q) != scene.view.labels(u, v);
      }
      EXPECT_TRUE(near_edge) << u << " " << v;
    }
  }
  EXPECT_GT(cleared, 1000);
  config.paper_border_px = 0;
  config.paper_hole_count = 6;
  config.paper_hole_radius_px = 5;
  double holes = 0;
  for (std::uint64_t i = 0; i < 60; ++i) {
    const NoisyView noisy = Spoil(scene, k, kD415, i, config);
    holes += static_cast<double>(std::count(noisy.depth.begin(), noisy.depth.end(), 0.0F)) / 60;
  }
  // 6 ellipses of mean area pi 25, some of it beyond the image or shared.
  EXPECT_GT(holes, 0.7 * 6 * 3.14 * 25);
  EXPECT_LT(holes, 1.05 * 6 * 3.14 * 25);
}

// The right image begins at the left one's column f B / z: what is left of it has no match.
// Baselines of Intel's datasheet: 55, 50 and 95 mm; the D415's focal length is the one at 1280x720.
TEST_F(NoiseTest, EachRealSenseHasItsOwnBaseline) {
  constexpr double kFocal = 210;
  const Intrinsics k = CentredCamera(320, 180, kFocal);
  for (const double distance : {1.0, 1.6, 3.1}) {
    const WallScene scene = MakeWall(distance, 0, k);
    for (const auto& [sensor, focal_baseline] : {std::pair("realsense_d415", 0.055 * 943.6 / 4),
                                                 {"realsense_d435i", 0.050 * kFocal},
                                                 {"realsense_d455", 0.095 * kFocal},
                                                 {"oak_d", 0.075 * kFocal}}) {
      const NoisyView noisy = Spoil(scene, k, sensor, 0);
      int first = k.width;
      for (const auto [u, v] : Pixels(noisy.depth))
        if (noisy.depth(u, v) > 0) first = std::min(first, u);
      EXPECT_EQ(first, std::ceil(focal_baseline / distance)) << sensor << distance;
    }
  }
  for (const char* unknown : {"realsense_d405", "lidar"})
    EXPECT_THROW(Spoil(MakeWall(1, 0, k), k, unknown, 0), ConfigError);
}

// The corners of a wall: dark in the narrow modes, whose pictures are not square.
TEST_F(NoiseTest, TheHexagonIsThatOfTheNarrowModes) {
  for (const std::string sensor : {"azure_kinect", "orbbec_femto_bolt", "kinect_v2"}) {
    for (const int height : {288, 320}) {
      const Intrinsics k = CentredCamera(320, height, 250);
      const WallScene scene = MakeWall(2.0, 0, k);
      const NoisyView noisy = Spoil(scene, k, sensor, 0);
      int measured = 0;
      for (const auto [u, v] : Pixels(20, 20)) measured += noisy.depth(u, v) > 0;
      EXPECT_EQ(measured > 200, height == 320 || sensor == "kinect_v2") << sensor << measured;
    }
  }
}

TEST_F(NoiseTest, ARegisteredModelHasAStreamOfItsOwnSample) {
  RegisterNoiseModel("offset", [](const NoiseInput& input, RandomStream& random) {
    NoisyView seen{input.view.depth, input.view.labels};
    const auto offset = static_cast<float>(random.Uniform(0.1, 0.2));
    for (float& z : seen.depth) z += offset;
    return seen;
  });
  EXPECT_THROW(RegisterNoiseModel("offset", nullptr), Error);
  EXPECT_THROW(RegisterNoiseModel("paper", nullptr), Error);
  EXPECT_EQ(NoiseModelNames().back(), "offset");
  const Intrinsics k = CentredCamera(64, 64, 50);
  const WallScene scene = MakeWall(2.0, 0, k);
  NoiseConfig config;
  config.models = {"offset"};
  const auto offset_of = [&](std::uint64_t index) {
    return Spoil(scene, k, "lidar", index, config).depth(32, 32) - scene.view.depth(32, 32);
  };
  EXPECT_EQ(offset_of(3), offset_of(3));
  EXPECT_NE(offset_of(3), offset_of(4));
  EXPECT_GE(offset_of(3), 0.0999);
  EXPECT_LE(offset_of(3), 0.2001);
  // Several are applied in order: one sees what the one before it left.
  const DepthImage once = Spoil(scene, k, "lidar", 3, config).depth;
  config.models = {"offset", "none", "offset"};
  EXPECT_GE(Spoil(scene, k, "lidar", 3, config).depth(32, 32) - once(32, 32), 0.0999);
  config.models = {"paper", "offset"};
  EXPECT_GE(Spoil(scene, k, "lidar", 3, config).depth(32, 32) - scene.view.depth(32, 32), 0.0999);
  config.models = {"sensor", "sensor"};
  EXPECT_FALSE(Spoil(scene, k, kAzure, 3, config).depth == Spoil(scene, k, kAzure, 3).depth);
  config.models = {};
  EXPECT_TRUE(Spoil(scene, k, "lidar", 3, config).depth == scene.view.depth);
}

// Over many devices: what a wall that is seen askew is off by in the middle and at the border of
// the picture.
TEST_F(NoiseTest, FrameErrorsAreThoseThatCalibrationExpects) {
  const Intrinsics k = CentredCamera(160, 90, 118);
  SceneMesh mesh;
  mesh.BeginObject({0.9F, 1.0F, false});
  mesh.AppendQuad({Eigen::Vector3d(10, -90, -90), Eigen::Vector3d(10, 90, -90),
                   Eigen::Vector3d(10, 90, 90), Eigen::Vector3d(10, -90, 90)},
                  -Eigen::Vector3d::UnitX());
  const Pose pose = LookAt({8.5, 2, 1}, {10, 2.3, 0}, 0);
  RenderedView view;
  renderer_.Render(mesh, k, pose, &view);
  for (const char* sensor : {kD415, kAzure}) {
    const DepthErrorModel& model = ErrorsOf(sensor);
    const NoiseInput input = {view, mesh, structure_, k, pose, sensor};
    for (const auto& [u, v] : {std::pair{80, 45}, std::pair{4, 8}, std::pair{150, 80}}) {
      const double z = view.depth(u, v);
      const Eigen::Vector3d p(z * (u - k.cx) / k.fx, z * (v - k.cy) / k.fy, z);
      const FrameErrorVector at =
          FrameErrorsAt(model, p, pose.linear().transpose() * -Eigen::Vector3d::UnitX());
      const double expected =
          std::hypot(model.gain * z, at.cwiseProduct(FrameErrorSigmas(model)).norm());
      Tally errors;
      for (std::uint64_t device = 0; device < 400; ++device) {
        NoisyView noisy{DepthImage(k.width, k.height, 0), view.labels};
        noisy.depth(u, v) = view.depth(u, v);
        AddFrameErrors(input, {9, device, "frame"}, &noisy);
        errors += noisy.depth(u, v) - z;
        EXPECT_EQ(noisy.depth(0, 0), 0);
      }
      EXPECT_NEAR(errors.Rms(), expected, 0.12 * expected) << sensor << u;
      EXPECT_NEAR(errors.Mean(), 0, 0.2 * expected) << sensor << u;
    }
  }
}

// Light that bounces has the longer way: a box that stands on the floor reads too far, and the
// floor beside it.
TEST_F(NoiseTest, FrameErrorsOfTimeOfFlightHaveMultipath) {
  const CornerScene scene(structure_, renderer_);
  const auto& [mesh, k, pose, view] = scene;
  const double y = structure_.FloorHeight();
  const DepthErrorModel& model = ErrorsOf(kAzure);
  const NoiseInput input = {view, mesh, structure_, k, pose, kAzure};
  constexpr int kDevices = 300;
  Image<double> mean(k.width, k.height, 0);
  for (std::uint64_t device = 0; device < kDevices; ++device) {
    NoisyView noisy{view.depth, view.labels};
    AddFrameErrors(input, {9, device, "frame"}, &noisy);
    for (std::size_t i = 0; i < mean.size(); ++i)
      mean[i] += (noisy.depth[i] - view.depth[i]) / kDevices;
  }
  const Side floor = FloorOf(structure_);
  const Subpixels bulging(input);
  int on_front = 0, on_floor = 0;
  for (const auto [u, v] : Pixels(k.width, k.height)) {
    const double z = view.depth(u, v);
    const Eigen::Vector3d q =
        pose * Eigen::Vector3d(z * (u - k.cx) / k.fx, z * (v - k.cy) / k.fy, z);
    const int label = view.labels(u, v);
    const bool is_floor = label == 0 && std::abs(q.y() - y) < 1e-3 && q.x() > 0.3 && q.x() < 0.6 &&
                          std::abs(q.z()) < 0.2;
    const bool is_front = label != 0 && structure_.SideOfLabel(label).name == "bottom/front";
    if (!is_floor && !is_front) continue;
    const double expected =
        model.bounce_m * DiffuseMultipathShare(structure_,
                                               is_floor ? floor : structure_.SideOfLabel(label), q,
                                               pose.translation(), model.bounce_reach_m);
    const double bulge =
        bulging.Depth(view.faces(u, v) - 1, view.rays->at(u, v).homogeneous()) - view.depth(u, v);
    EXPECT_NEAR(mean(u, v) - bulge, expected, 0.0005) << u << " " << v;
    (is_floor ? on_floor : on_front) += expected > 0.002;
  }
  EXPECT_GT(on_front, 200);
  EXPECT_GT(on_floor, 200);
}

// The paper's stack as a mesh: light from its sides makes the same seams as from its boxes.
TEST_F(NoiseTest, ConcaveCornersOfMeshesAreThoseOfBoxes) {
  const Structure mesh = mesh_shapes::StructureOf(mesh_shapes::Stack());
  const CornerScene boxes_scene(structure_, renderer_), mesh_scene(mesh, renderer_);
  std::vector<double> off;
  for (std::uint64_t i = 0; i < 4; ++i) {
    const auto spoil = [&](const CornerScene& scene, const Structure& of) {
      return ApplyNoise({}, {scene.view, scene.mesh, of, scene.k, scene.pose, kAzure}, 5, i).depth;
    };
    const DepthImage a = spoil(boxes_scene, structure_), b = spoil(mesh_scene, mesh);
    for (std::size_t p = 0; p < a.size(); ++p) {
      if (a[p] > 0 && b[p] > 0) off.push_back(std::abs(a[p] - b[p]));
    }
  }
  EXPECT_GT(off.size(), 20000u);
  EXPECT_LT(Quantile(off, 0.5), 1e-4);
  EXPECT_LT(Quantile(off, 0.95), 2e-3);
}

TEST_F(NoiseTest, MeshesAreMeasuredByEveryModel) {
  const Structure housing = mesh_shapes::StructureOf(mesh_shapes::Housing());
  const CornerScene scene(housing, renderer_);
  for (const char* sensor : {kAzure, kD415}) {
    for (const char* model : {"sensor", "physics", "paper"}) {
      NoiseConfig config;
      config.models = {model};
      NoisyView noisy =
          ApplyNoise(config, {scene.view, scene.mesh, housing, scene.k, scene.pose, sensor}, 5, 0);
      if (model == std::string("sensor"))
        AddFrameErrors({scene.view, scene.mesh, housing, scene.k, scene.pose, sensor},
                       {5, 0, "frame"}, &noisy);
      std::vector<double> off;
      for (std::size_t p = 0; p < noisy.depth.size(); ++p)
        if (noisy.labels[p] > 0) off.push_back(std::abs(noisy.depth[p] - scene.view.depth[p]));
      ASSERT_GT(off.size(), 1500u) << sensor << ' ' << model;
      EXPECT_LT(Quantile(off, 0.5), 0.03) << sensor << ' ' << model;
    }
  }
}

}  // namespace
}  // namespace volalign::noise_test
