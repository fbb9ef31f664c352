#include "render/egl/gl_depth_renderer.h"

#include <epoxy/gl.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/geometry/camera.h"
#include "core/geometry/structure.h"
#include "render/egl/egl_context.h"
#include "render/scene_mesh.h"
#include "render/tiles/tile_renderer.h"
#include "tests/core/base/expect_error.h"
#include "tests/render/both_renderers.h"

namespace volalign::gl_depth_renderer_test {
namespace {

// An analytic ray-caster of its own: numbers of configs/structure.yaml typed in again, slab tests,
// plain arrays. It shares no code with core or render.

using Vec = std::array<double, 3>;

struct RefBox {
  Vec low, high;
  std::array<int, 6> label;  // +x -x +y -y +z -z
};

const std::array<RefBox, 4> kPaper = {{
    {{-.280, -.810, -.165}, {.275, -.405, .165}, {14, 13, 12, 0, 11, 15}},
    {{-.280, -.405, -.390}, {.050, .000, .165}, {1, 2, 3, 0, 4, 5}},
    {{-.505, .000, -.165}, {.050, .405, .165}, {9, 10, 8, 0, 6, 7}},
    {{-.280, .405, -.165}, {.050, .810, .390}, {16, 19, 18, 0, 17, 20}},
}};

struct RefCamera {
  Vec x, y, z, eye;  // axes in the structure frame
};

Vec Minus(const Vec& a, const Vec& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Vec Cross(const Vec& a, const Vec& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
Vec Unit(const Vec& a) {
  const double n = std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
  return {a[0] / n, a[1] / n, a[2] / n};
}
Vec Mix(double s, const Vec& a, double t, const Vec& b) {
  return {s * a[0] + t * b[0], s * a[1] + t * b[1], s * a[2] + t * b[2]};
}

/// Levelled, image y towards the floor; then the image's x axis turns towards its y axis by `roll`.
RefCamera LookFrom(const Vec& eye, const Vec& target, double roll) {
  RefCamera c;
  c.eye = eye;
  c.z = Unit(Minus(target, eye));
  const Vec down{0, -1, 0};
  const Vec level_x = Unit(Cross(down, c.z));
  const Vec level_y = Cross(c.z, level_x);
  c.x = Mix(std::cos(roll), level_x, std::sin(roll), level_y);
  c.y = Mix(-std::sin(roll), level_x, std::cos(roll), level_y);
  return c;
}

Pose ToPose(const RefCamera& c) {
  Pose pose = Pose::Identity();
  for (int i = 0; i < 3; ++i) {
    const auto k = static_cast<std::size_t>(i);
    pose.matrix()(i, 0) = c.x[k];
    pose.matrix()(i, 1) = c.y[k];
    pose.matrix()(i, 2) = c.z[k];
    pose.matrix()(i, 3) = c.eye[k];
  }
  return pose;
}

struct RefHit {
  double depth = 0;
  int side = -1;  // 6 * box + face
  int label = 0;
};

/// Row by row.
std::size_t PixelIndex(const Intrinsics& k, int u, int v) {
  return static_cast<std::size_t>(v) * static_cast<std::size_t>(k.width) +
         static_cast<std::size_t>(u);
}

RefHit Cast(const RefCamera& c, double x, double y) {
  Vec d;
  for (std::size_t i = 0; i < 3; ++i) d[i] = x * c.x[i] + y * c.y[i] + c.z[i];
  RefHit best;
  best.depth = std::numeric_limits<double>::infinity();
  for (std::size_t b = 0; b < kPaper.size(); ++b) {
    double enter = -1e9, leave = 1e9;
    int face = -1;
    for (std::size_t i = 0; i < 3; ++i) {
      double t0 = (kPaper[b].low[i] - c.eye[i]) / d[i], t1 = (kPaper[b].high[i] - c.eye[i]) / d[i];
      const bool forward = d[i] > 0;
      if (!forward) std::swap(t0, t1);
      if (t0 > enter) {
        enter = t0;
        face = static_cast<int>(2 * i) + (forward ? 1 : 0);
      }
      leave = std::min(leave, t1);
    }
    if (enter < leave && enter > 0 && enter < best.depth) {
      best.depth = enter;
      best.side = static_cast<int>(6 * b) + face;
      best.label = kPaper[b].label[static_cast<std::size_t>(face)];
    }
  }
  if (best.side < 0) best.depth = 0;
  return best;
}

/// Whatever is drawn is drawn by both renderers and compared; the test looks at the picture of the
/// one that is its parameter.
class DepthRendererTest : public testing::TestWithParam<const char*> {
 protected:
  void TearDown() override { renderer_.ExpectTheSame(); }
  bool ShowsGl() const { return std::string(GetParam()) == "egl"; }

  EglContext egl_;
  GlDepthRenderer gl_;
  TileRenderer tiles_;
  BothRenderers renderer_{gl_, tiles_, ShowsGl()};
};

std::string ByName(const testing::TestParamInfo<const char*>& info) { return info.param; }

INSTANTIATE_TEST_SUITE_P(Renderers, DepthRendererTest, testing::Values("egl", "cpu"), ByName);

TEST_P(DepthRendererTest, AgreesWithAnalyticRayCaster) {
  const Structure structure = ReadStructure("configs/structure.yaml");
  SceneMesh mesh;
  mesh.AppendStructure(structure);
  std::vector<Intrinsics> pool;
  // Those that were measured; the other modes of these devices are parts of the same chips.
  const std::set<std::string> sensors = {"realsense_d415", "kinect_v1", "kinect_v2",
                                         "azure_kinect_nfov_binned"};
  for (const IntrinsicsPoolEntry& entry : ReadIntrinsicsPool("configs/intrinsics.yaml")) {
    if (sensors.count(entry.sensor) == 0) continue;
    pool.insert(pool.end(), entry.intrinsics.begin(), entry.intrinsics.end());
  }
  for (Intrinsics& k : pool) k.distortion.clear();
  ASSERT_EQ(pool.size(), 21u);

  constexpr double kPi = 3.14159265358979323846;
  std::mt19937 random(ShowsGl() ? 7 : 9);
  const auto uniform = [&random](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  RenderedView view;
  std::vector<RefHit> truth;
  long compared = 0, wrong_label = 0, off_side = 0;
  double worst = 0;
  for (int pose = 0; pose < 100; ++pose) {
    const Intrinsics& k = pool[static_cast<std::size_t>(pose) % pool.size()];
    const double rho = uniform(1.0, 3.5), phi = uniform(0, 2 * kPi);
    const double roll = 0.5 * kPi * (pose / 21 % 4) + uniform(-0.1, 0.1);
    const RefCamera camera =
        LookFrom({rho * std::cos(phi), uniform(-0.75, 1.3), rho * std::sin(phi)},
                 {uniform(-0.3, 0.3), uniform(-0.3, 0.3), uniform(-0.3, 0.3)}, roll);
    renderer_.Render(mesh, k, ToPose(camera), &view);
    ASSERT_EQ(view.depth.width(), k.width);
    ASSERT_EQ(view.depth.height(), k.height);
    truth.resize(view.depth.size());
    for (int v = 0; v < k.height; ++v) {
      for (int u = 0; u < k.width; ++u) {
        truth[PixelIndex(k, u, v)] = Cast(camera, (u - k.cx) / k.fx, (v - k.cy) / k.fy);
      }
    }
    const auto at = [&](int u, int v) -> const RefHit& { return truth[PixelIndex(k, u, v)]; };
    for (int v = 1; v + 1 < k.height; ++v) {
      for (int u = 1; u + 1 < k.width; ++u) {
        const RefHit& hit = at(u, v);
        bool edge = false;
        for (int dv = -1; dv <= 1; ++dv) {
          for (int du = -1; du <= 1; ++du) edge |= at(u + du, v + dv).side != hit.side;
        }
        if (edge) continue;
        ++compared;
        const double z = view.depth(u, v);
        const double error = std::abs(z - hit.depth);
        if (!(error <= worst)) worst = error;
        wrong_label += view.labels(u, v) != hit.label;
        if (hit.side < 0) continue;
        const RefBox& box = kPaper[static_cast<std::size_t>(hit.side / 6)];
        const std::size_t axis = static_cast<std::size_t>(hit.side % 6 / 2);
        const double x = (u - k.cx) / k.fx * z, y = (v - k.cy) / k.fy * z;
        for (std::size_t i = 0; i < 3; ++i) {
          const double p = camera.eye[i] + x * camera.x[i] + y * camera.y[i] + z * camera.z[i];
          const double plane = hit.side % 2 == 0 ? box.high[i] : box.low[i];
          const bool on = i == axis ? std::abs(p - plane) < 2e-4
                                    : p > box.low[i] - 2e-4 && p < box.high[i] + 2e-4;
          off_side += !on;
        }
      }
    }
  }
  EXPECT_GT(compared, 15'000'000);
  EXPECT_LE(worst, 1e-4);
  EXPECT_EQ(wrong_label, 0);
  EXPECT_EQ(off_side, 0);
}

/// OpenCV's model inverted by fixed-point iteration and written out here: x = (x' - tangential) /
/// radial.
std::array<double, 2> RefRay(const Intrinsics& k, double u, double v) {
  const auto d = [&](std::size_t i) { return i < k.distortion.size() ? k.distortion[i] : 0.0; };
  const double xd = (u - k.cx) / k.fx, yd = (v - k.cy) / k.fy;
  double x = xd, y = yd;
  for (int i = 0; i < 400; ++i) {
    const double r2 = x * x + y * y;
    const double radial =
        (1 + r2 * (d(0) + r2 * (d(1) + r2 * d(4)))) / (1 + r2 * (d(5) + r2 * (d(6) + r2 * d(7))));
    const double tx = 2 * d(2) * x * y + d(3) * (r2 + 2 * x * x);
    const double ty = d(2) * (r2 + 2 * y * y) + 2 * d(3) * x * y;
    x = (xd - tx) / radial;
    y = (yd - ty) / radial;
  }
  return {x, y};
}

/// Of pictures through a lens, against RefHits at the pixels' centres.
struct LensScore {
  long faces = 0, edges = 0;  // pixels within one side, and at borders
  long wrong_label = 0;       // of the former
  double worst_depth = 0;     // m, of the former
  long off = 0;               // of the latter: not what is at the centre
  long far_off = 0;           // nor anywhere within a quarter of a pixel of it
};

class LensPictureTest : public DepthRendererTest {
 protected:
  /// Adds the picture of a pose to the score; `rays` are RefRays of the pixels.
  void Compare(const SceneMesh& mesh, const Intrinsics& k,
               const std::vector<std::array<double, 2>>& rays, const RefCamera& camera,
               LensScore* score) {
    RenderedView view;
    renderer_.Render(mesh, k, ToPose(camera), &view);
    ASSERT_EQ(view.depth.width(), k.width);
    ASSERT_EQ(view.faces.height(), k.height);
    std::vector<RefHit> truth;
    truth.reserve(rays.size());
    for (const auto& [x, y] : rays) truth.push_back(Cast(camera, x, y));
    const auto at = [&](int u, int v) -> const RefHit& { return truth[PixelIndex(k, u, v)]; };
    for (int v = 1; v + 1 < k.height; ++v) {
      for (int u = 1; u + 1 < k.width; ++u) {
        bool edge = false;
        for (int dv = -1; dv <= 1; ++dv) {
          for (int du = -1; du <= 1; ++du) edge |= at(u + du, v + dv).side != at(u, v).side;
        }
        const double z = view.depth(u, v);
        EXPECT_EQ(z > 0, view.faces(u, v) > 0);
        if (!edge) {
          ++score->faces;
          const double error = std::abs(z - at(u, v).depth);
          if (!(error <= score->worst_depth)) score->worst_depth = error;
          score->wrong_label += view.labels(u, v) != at(u, v).label;
          continue;
        }
        ++score->edges;
        const auto seen = [&](const RefHit& hit) {
          return view.labels(u, v) == hit.label && std::abs(z - hit.depth) < 0.005;
        };
        if (seen(at(u, v))) continue;
        ++score->off;
        bool near = false;
        for (const double dv : {-0.25, 0.0, 0.25}) {
          for (const double du : {-0.25, 0.0, 0.25}) {
            near |= seen(HitAt(k, camera, u + du, v + dv));
          }
        }
        score->far_off += !near;
      }
    }
  }

  static RefHit HitAt(const Intrinsics& k, const RefCamera& camera, double u, double v) {
    const std::array<double, 2> ray = RefRay(k, u, v);
    return Cast(camera, ray[0], ray[1]);
  }
};

INSTANTIATE_TEST_SUITE_P(Renderers, LensPictureTest, testing::Values("egl", "cpu"), ByName);

TEST_P(LensPictureTest, AgreesWithAnalyticRayCaster) {
  SceneMesh mesh;
  mesh.AppendStructure(ReadStructure("configs/structure.yaml"));
  const std::array<Intrinsics, 3> cameras = {
      Intrinsics{160,
                 144,
                 126.1,
                 126.1,
                 79.3,
                 84.6,
                 {0.92185, 0.50040, 0, 0, 0.02836, 1.25842, 0.75181, 0.14419}},
      Intrinsics{128, 106, 91.8, 91.8, 64.2, 51.1, {0.09, -0.27, 0, 0, 0.10}},
      Intrinsics{120, 100, 130, 128, 58.7, 50.2, {-0.12, 0.04, 0.003, -0.002}}};
  std::mt19937 random(8);
  const auto uniform = [&random](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  std::array<std::vector<std::array<double, 2>>, 3> rays;
  for (std::size_t i = 0; i < 3; ++i) {
    for (int v = 0; v < cameras[i].height; ++v) {
      for (int u = 0; u < cameras[i].width; ++u) rays[i].push_back(RefRay(cameras[i], u, v));
    }
  }
  LensScore score;
  for (std::size_t pose = 0; pose < 24; ++pose) {
    const double rho = uniform(1.2, 3.0), phi = uniform(0, 6.28);
    Compare(mesh, cameras[pose % 3], rays[pose % 3],
            LookFrom({rho * std::cos(phi), uniform(-0.75, 1.3), rho * std::sin(phi)},
                     {uniform(-0.5, 0.5), uniform(-0.5, 0.5), uniform(-0.5, 0.5)}, uniform(-3, 3)),
            &score);
  }
  EXPECT_GT(score.faces, 200'000);
  EXPECT_GT(score.edges, 10'000);
  EXPECT_LE(score.worst_depth, 1e-4);
  EXPECT_EQ(score.wrong_label, 0);
  EXPECT_LT(score.off, 0.002 * static_cast<double>(score.edges));
  EXPECT_LE(score.far_off, 1);  // by rounding: one compiler has it, another one has not
}

TEST_P(LensPictureTest, NothingIsSeenBeyondTheFold) {
  SceneMesh mesh;
  mesh.AppendQuad({Eigen::Vector3d(-50, -50, 2), Eigen::Vector3d(-50, 50, 2),
                   Eigen::Vector3d(50, 50, 2), Eigen::Vector3d(50, -50, 2)},
                  -Eigen::Vector3d::UnitZ(), 7);
  // r (1 - 0.5 r^2) rises up to 0.5443.
  const Intrinsics k{160, 144, 126, 126, 79, 72, {-0.5, 0, 0, 0}};
  RenderedView view;
  renderer_.Render(mesh, k, Pose::Identity(), &view);
  int seen = 0;
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      const double radius = std::hypot(u - k.cx, v - k.cy) / k.fx;
      ASSERT_TRUE(view.rays->at(u, v).allFinite());
      if (radius < 0.54) {
        EXPECT_NEAR(view.depth(u, v), 2, 1e-6);
        EXPECT_EQ(view.labels(u, v), 7);
        ++seen;
      } else if (radius > 0.55) {
        EXPECT_EQ(view.depth(u, v), 0);
        EXPECT_EQ(view.labels(u, v), 0);
        EXPECT_EQ(view.faces(u, v), 0);
      }
    }
  }
  EXPECT_GT(seen, 5000);
}

TEST_P(LensPictureTest, ALensWithoutEffectShowsThePinholePicture) {
  SceneMesh mesh;
  mesh.AppendStructure(ReadStructure("configs/structure.yaml"));
  // Bodies of many small faces, and one that touches the sensor's image plane.
  mesh.AppendSphere(Eigen::Vector3d(0.6, 0.9, 0.4), 0.25, 24);
  mesh.AppendQuad({Eigen::Vector3d(-9, -0.81, -9), Eigen::Vector3d(9, -0.81, -9),
                   Eigen::Vector3d(9, -0.81, 9), Eigen::Vector3d(-9, -0.81, 9)},
                  Eigen::Vector3d::UnitY());
  const Intrinsics pinhole{160, 144, 126, 126, 79.4, 72.3, {}};
  Intrinsics lens = pinhole;
  lens.distortion = {0, 0, 0, 0};
  const Pose pose = ToPose(LookFrom({1.6, 0.5, 1.1}, {0, 0, 0}, 1.5));
  RenderedView expected, view;
  renderer_.Render(mesh, pinhole, pose, &expected);
  renderer_.Render(mesh, lens, pose, &view);
  int differ = 0;
  for (std::size_t i = 0; i < view.depth.size(); ++i) {
    differ += view.faces[i] != expected.faces[i] ||
              !(std::abs(view.depth[i] - expected.depth[i]) <= 1e-5F * expected.depth[i]);
    EXPECT_NEAR(view.rays->rays[i].x(), expected.rays->rays[i].x(), 1e-6);
    EXPECT_NEAR(view.rays->rays[i].y(), expected.rays->rays[i].y(), 1e-6);
  }
  EXPECT_LE(differ, 10);  // rays that pass an edge within rounding
}

TEST_P(DepthRendererTest, OverhangFromBelowIsSolidBackground) {
  SceneMesh mesh;
  mesh.AppendStructure(ReadStructure("configs/structure.yaml"));
  const Intrinsics k{160, 120, 150, 150, 79.5, 59.5, {}};
  // The part of mid_top's bottom that nothing covers: x in [-505, -280], y = 0; the camera is
  // straight in front of its centre.
  const RefCamera camera = LookFrom({-1.1, -0.7, 0}, {-0.3925, 0, 0}, 0);
  RenderedView view;
  renderer_.Render(mesh, k, ToPose(camera), &view);
  const RefHit hit = Cast(camera, 0.5 / 150, 0.5 / 150);
  ASSERT_EQ(hit.side, 6 * 2 + 3);
  EXPECT_NEAR(view.depth(80, 60), hit.depth, 1e-4);
  EXPECT_EQ(view.labels(80, 60), 0);
  EXPECT_GT(view.faces(80, 60), 0);
}

TEST_P(DepthRendererTest, FloorDepthHasClosedForm) {
  SceneMesh mesh;
  mesh.AppendQuad({Eigen::Vector3d(-50, -0.81, -50), Eigen::Vector3d(50, -0.81, -50),
                   Eigen::Vector3d(50, -0.81, 50), Eigen::Vector3d(-50, -0.81, 50)},
                  Eigen::Vector3d::UnitY(), 5);
  const Intrinsics k{64, 48, 40, 42, 30.25, 20.75, {}};
  // Level, looking along +z: image rows below the principal point meet the floor at z = h fy / (v -
  // cy).
  Pose pose = Pose::Identity();
  pose.linear() << -1, 0, 0, 0, -1, 0, 0, 0, 1;
  pose.translation() = Eigen::Vector3d(0.3, 0.39, -1);
  RenderedView view;
  renderer_.Render(mesh, k, pose, &view);
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      if (v < 21) {
        EXPECT_EQ(view.depth(u, v), 0);
        EXPECT_EQ(view.labels(u, v), 0);
      } else if (v > 22) {
        const double z = 1.2 * k.fy / (v - k.cy);
        EXPECT_NEAR(view.depth(u, v), z, 2e-6 * z);
        EXPECT_EQ(view.labels(u, v), 5);
      }
    }
  }
}

TEST_P(DepthRendererTest, FacesBehindTheCameraAreClipped) {
  SceneMesh mesh;
  Pose around = Pose::Identity();
  around.translation() = Eigen::Vector3d(0, 0, 2);
  mesh.AppendBox(around, Eigen::Vector3d(0.5, 0.5, 0.5));
  // A floor that passes under the camera, far behind it and in front.
  mesh.AppendQuad({Eigen::Vector3d(-9, 1, -9), Eigen::Vector3d(9, 1, -9), Eigen::Vector3d(9, 1, 9),
                   Eigen::Vector3d(-9, 1, 9)},
                  -Eigen::Vector3d::UnitY());
  const Intrinsics k{41, 41, 30, 30, 20, 20, {}};
  RenderedView view;
  renderer_.Render(mesh, k, Pose::Identity(), &view);
  EXPECT_NEAR(view.depth(20, 20), 1.75, 1e-5);
  EXPECT_NEAR(view.depth(20, 40), 30.0 / 20, 1e-5);
  EXPECT_EQ(view.depth(0, 0), 0);
}

TEST_P(DepthRendererTest, RoundBodiesLieWithinTheirChords) {
  SceneMesh mesh;
  constexpr int kSegments = 24;
  mesh.AppendSphere(Eigen::Vector3d(0, 0, 2), 0.5, kSegments);
  // Off the axis, or half of the edges would pass through the centres of pixels.
  const Intrinsics k{81, 81, 100, 100, 40.2, 39.9, {}};
  RenderedView view;
  renderer_.Render(mesh, k, Pose::Identity(), &view);
  int inside = 0;
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      const double x = (u - k.cx) / k.fx, y = (v - k.cy) / k.fy;
      // |s (x, y, 1) - (0, 0, 2)| = 0.5
      const double a = x * x + y * y + 1, discriminant = 4 - a * (4 - 0.25);
      EXPECT_TRUE(discriminant >= 0 || view.depth(u, v) == 0);
      if (discriminant < 0.1) continue;
      ++inside;
      const double z = (2 - std::sqrt(discriminant)) / a;
      EXPECT_GE(view.depth(u, v), z - 1e-4);
      EXPECT_LE(view.depth(u, v),
                z + 0.16);  // two rings a hemisphere cap: 0.5 (1 - cos 22.5 deg), seen aslant
    }
  }
  EXPECT_GT(inside, 500);
}

TEST(SceneMeshTest, FacesArePlanarAndFaceOutward) {
  SceneMesh mesh;
  mesh.AppendBox(Pose(Eigen::AngleAxisd(0.4, Eigen::Vector3d(1, 2, 3).normalized())),
                 Eigen::Vector3d(0.2, 0.5, 0.9));
  mesh.AppendCylinder(Eigen::Vector3d(-0.2, -0.5, 0.1), Eigen::Vector3d(0.2, 0.5, -0.1), 0.3, 9);
  mesh.AppendCapsule(Eigen::Vector3d(0, -0.3, 0), Eigen::Vector3d(0, 0.3, 0), 0.2, 8);
  mesh.AppendSphere(Eigen::Vector3d::Zero(), 0.4, 7);
  for (const SceneFace& face : mesh.faces) {
    EXPECT_NEAR(face.normal.norm(), 1, 1e-12);
    EXPECT_GT(face.offset, 0);  // every body contains the origin
    for (const Eigen::Vector3f& corner : face.corners) {
      EXPECT_NEAR(face.normal.dot(corner.cast<double>()), face.offset, 1e-6);
    }
  }
}

TEST_P(DepthRendererTest, RejectsWhatItCannotDraw) {
  RenderedView view;
  const Intrinsics folded{64, 64, 50, 50, 32, 32, {-20, 0, 0, 0}};
  EXPECT_THROW(renderer_.Render(SceneMesh(), folded, Pose::Identity(), &view), DataError);
  const Intrinsics empty{0, 64, 50, 50, 32, 32, {}};
  EXPECT_THROW(renderer_.Render(SceneMesh(), empty, Pose::Identity(), &view), Error);
}

// In place of a device that is reset, which a test cannot do: OpenGL's answer after that.
TEST(EglContextTest, ALostContextIsAnError) {
  const EglContext context;
  GlDepthRenderer renderer;
  SceneMesh mesh;
  mesh.BeginObject({0.5F, 1.0F, false});
  mesh.AppendQuad({Eigen::Vector3d(-1, -1, 2), Eigen::Vector3d(1, -1, 2), Eigen::Vector3d(1, 1, 2),
                   Eigen::Vector3d(-1, 1, 2)},
                  -Eigen::Vector3d::UnitZ(), 1);
  RenderedView view;
  const auto draw = [&] {
    renderer.Render(mesh, {16, 16, 16, 16, 7.5, 7.5, {}}, Pose::Identity(), &view);
  };
  draw();
  const auto real = epoxy_glGetError;
  epoxy_glGetError = [] { return static_cast<GLenum>(GL_CONTEXT_LOST); };
  ExpectError<Error>(draw, {"reset", "the renderer cpu"});
  epoxy_glGetError = real;
  draw();
}

TEST(EglContextTest, DeviceThatDoesNotExistIsAnError) {
  EXPECT_THROW(EglContext({/*device=*/1000}), IoError);
}

// Another thread may be reading the environment.
TEST(EglContextTest, LeavesTheEnvironmentAlone) {
  const char* const given = std::getenv("LP_NUM_THREADS");
  const std::string before = given ? given : "";
  ::unsetenv("LP_NUM_THREADS");
  { const EglContext egl; }
  EXPECT_EQ(std::getenv("LP_NUM_THREADS"), nullptr);
  KeepSoftwareRenderingOnOneThread();
  EXPECT_STREQ(std::getenv("LP_NUM_THREADS"), "0");
  ::setenv("LP_NUM_THREADS", "3", 1);
  KeepSoftwareRenderingOnOneThread();  // the user's choice stays
  EXPECT_STREQ(std::getenv("LP_NUM_THREADS"), "3");
  ::setenv("LP_NUM_THREADS", before.empty() ? "0" : before.c_str(), 1);
}

TEST(EglContextTest, DescribesItsRenderer) {
  const EglContext egl;
  EXPECT_NE(egl.Describe().find("OpenGL 4."), std::string::npos) << egl.Describe();
}

}  // namespace
}  // namespace volalign::gl_depth_renderer_test
