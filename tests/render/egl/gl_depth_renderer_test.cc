#include "render/egl/renderers.h"

#include <epoxy/gl.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "core/geometry/camera.h"
#include "core/geometry/lens.h"
#include "core/geometry/structure.h"
#include "core/geometry/visibility.h"
#include "render/egl/egl_context.h"
#include "render/sample.h"
#include "render/scene_mesh.h"
#include "render/tiles/tile_renderer.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/core/geometry/mesh_shapes.h"
#include "tests/render/test_scene.h"

namespace volalign::gl_depth_renderer_test {
namespace {

/// The face that the ray (x, y, 1) meets first, 0 for none, found by looking at each in double.
int NearestFace(const SceneMesh& mesh, const Pose& structure_from_sensor,
                const Eigen::Vector2f& ray) {
  const Eigen::Vector3d eye = structure_from_sensor.translation();
  const Eigen::Vector3d direction =
      structure_from_sensor.linear() * ray.cast<double>().homogeneous();
  double nearest = std::numeric_limits<double>::infinity();
  int found = 0;
  for (std::size_t i = 0; i < mesh.faces.size(); ++i) {
    const SceneFace& face = mesh.faces[i];
    const double height = face.offset - face.normal.dot(eye);
    const double z = height / face.normal.dot(direction);
    if (!(height < 0) || !(z > DepthRenderer::kNear) || !(z < nearest)) continue;
    if (!Inside(face, eye + z * direction)) continue;
    nearest = z;
    found = static_cast<int>(i) + 1;
  }
  return found;
}

/// Draws every picture by OpenGL and by tiles, shows one of them, and counts where they differ.
class BothRenderers : public DepthRenderer {
 public:
  BothRenderers(DepthRenderer& gl, DepthRenderer& tiles, bool shows_gl)
      : gl_(gl), tiles_(tiles), shows_gl_(shows_gl) {}

  void Render(const SceneMesh& mesh, const Intrinsics& intrinsics,
              const Pose& structure_from_sensor, RenderedView* view) override {
    RenderedView& by_gl = shows_gl_ ? *view : hidden_;
    RenderedView& by_tiles = shows_gl_ ? hidden_ : *view;
    gl_.Render(mesh, intrinsics, structure_from_sensor, &by_gl);
    tiles_.Render(mesh, intrinsics, structure_from_sensor, &by_tiles);
    ASSERT_EQ(by_gl.depth.size(), by_tiles.depth.size());
    EXPECT_EQ(by_gl.rays->rays, by_tiles.rays->rays);
    pixels_ += static_cast<long>(by_gl.depth.size());
    for (std::size_t i = 0; i < by_gl.depth.size(); ++i) {
      EXPECT_EQ(by_tiles.depth[i] > 0, by_tiles.faces[i] > 0);
      if (by_gl.faces[i] != by_tiles.faces[i]) {
        ++other_face_;
        wrong_tiles_ +=
            by_tiles.faces[i] != NearestFace(mesh, structure_from_sensor, by_tiles.rays->rays[i]);
        continue;
      }
      EXPECT_EQ(by_gl.labels[i], by_tiles.labels[i]);
      const double error = std::abs(by_gl.depth[i] - by_tiles.depth[i]);
      if (!(error <= worst_m_)) worst_m_ = error;
    }
  }

  /// Another face in at most `share` of the pixels, which lie at edges, and the same depth
  /// elsewhere; nearly always the tiles' face is the one that the pixel's ray meets. A few small
  /// pictures may differ in a pixel or two.
  void ExpectTheSame(double share = 5e-4) const {
    EXPECT_LE(other_face_, std::max(2L, std::lround(share * static_cast<double>(pixels_))))
        << "of " << pixels_ << " pixels";
    EXPECT_LE(wrong_tiles_, std::max(1L, pixels_ / 20000)) << "of " << pixels_ << " pixels";
    EXPECT_LE(worst_m_, 1e-4);
  }

 private:
  DepthRenderer& gl_;
  DepthRenderer& tiles_;
  bool shows_gl_;
  RenderedView hidden_;
  long pixels_ = 0, other_face_ = 0, wrong_tiles_ = 0;
  double worst_m_ = 0;
};

// Truth is by core's ray-caster, which shares no code with a renderer: part_mesh_test compares it
// with triangles, and camera_test the rays of a lens with OpenCV's documented model.

struct Hit {
  double depth = 0;
  int side = -1, label = 0;
};

Hit Cast(const Structure& structure, const Pose& pose, const Eigen::Vector2f& ray) {
  const RayHit hit =
      CastRay(structure, pose.translation(), pose.linear() * ray.cast<double>().homogeneous());
  if (hit.side < 0) return {};
  return {hit.t, hit.side, structure.sides()[static_cast<std::size_t>(hit.side)].label};
}

Image<Hit> CastAll(const Structure& structure, const Pose& pose, const RayTable& rays) {
  Image<Hit> hits(rays.width, rays.height);
  for (std::size_t i = 0; i < hits.size(); ++i) hits[i] = Cast(structure, pose, rays.rays[i]);
  return hits;
}

/// Whether a pixel beside (u, v) shows another side.
bool IsBorder(const Image<Hit>& hits, int u, int v) {
  for (int dv = -1; dv <= 1; ++dv) {
    for (int du = -1; du <= 1; ++du) {
      if (hits(u + du, v + dv).side != hits(u, v).side) return true;
    }
  }
  return false;
}

/// Of pictures, against hits at the pixels' centres.
struct Score {
  long faces = 0, edges = 0;  // pixels within one side, and at borders
  long labelled = 0;          // of the former
  long wrong_label = 0, wrong_side = 0;
  double worst_depth = 0;  // m, of the former
  long off = 0;            // of the latter: not what is at the centre
  long far_off = 0;        // nor what is at any of the steps beside it
};

/// Whatever is drawn is drawn by both renderers and compared; the test looks at the picture of the
/// one that is its parameter.
class DepthRendererTest : public testing::TestWithParam<const char*> {
 protected:
  void TearDown() override { renderer_.ExpectTheSame(); }
  bool ShowsGl() const { return std::string(GetParam()) == "egl"; }

  /// Pictures of a structure from random poses, by the cameras in turn. `steps`: beside a
  /// pixel's centre, px, 0 first.
  Score CompareWithRays(const Structure& structure, const std::vector<Intrinsics>& cameras,
                        std::size_t count, const std::vector<double>& steps) {
    SceneMesh mesh;
    mesh.AppendStructure(structure);
    EXPECT_EQ(mesh.objects.size(), structure.boxes().size());
    std::mt19937 random(ShowsGl() ? 7 : 9);
    const auto uniform = [&random](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random);
    };
    Score score;
    RenderedView view;
    for (std::size_t i = 0; i < count; ++i) {
      const Intrinsics& k = cameras[i % cameras.size()];
      std::vector<RayTable> rays;
      for (const double dv : steps) {
        for (const double du : steps) {
          Intrinsics beside = k;
          beside.cx -= du;
          beside.cy -= dv;
          rays.push_back(ComputeRays(beside));
        }
      }
      const double rho = uniform(1.0, 3.5), phi = uniform(0, 2 * M_PI);
      const Pose pose =
          LookAt({rho * std::cos(phi), uniform(-0.75, 1.3), rho * std::sin(phi)},
                 {uniform(-0.4, 0.4), uniform(-0.4, 0.4), uniform(-0.4, 0.4)}, uniform(-3, 3));
      renderer_.Render(mesh, k, pose, &view);
      EXPECT_EQ(view.depth.width(), k.width);
      EXPECT_EQ(view.faces.height(), k.height);
      const Image<Hit> truth = CastAll(structure, pose, rays[0]);
      for (const auto [u, v] : Pixels({1, 1}, {k.width - 1, k.height - 1})) {
        const double z = view.depth(u, v);
        if (!IsBorder(truth, u, v)) {
          ++score.faces;
          const double error = std::abs(z - truth(u, v).depth);
          if (!(error <= score.worst_depth)) score.worst_depth = error;
          score.labelled += truth(u, v).label > 0;
          score.wrong_label += view.labels(u, v) != truth(u, v).label;
          if (view.faces(u, v) > 0)
            score.wrong_side += mesh.faces[view.faces(u, v) - 1U].side != truth(u, v).side;
          continue;
        }
        ++score.edges;
        const auto seen = [&, u = u, v = v](const RayTable& table) {
          const Hit hit = Cast(structure, pose, table.at(u, v));
          return view.labels(u, v) == hit.label && std::abs(z - hit.depth) < 0.005;
        };
        score.off += !seen(rays[0]);
        score.far_off += std::none_of(rays.begin(), rays.end(), seen);
      }
    }
    EXPECT_LE(score.worst_depth, 1e-4);
    EXPECT_EQ(score.wrong_label, 0);
    EXPECT_EQ(score.wrong_side, 0);
    return score;
  }

  const Structure paper_ = ReadStructure("configs/structure.yaml");
  const std::unique_ptr<DepthRenderer> owned_ = GlRenderers()();
  DepthRenderer& gl_ = *owned_;
  const std::unique_ptr<DepthRenderer> tiled_ = TileRenderers()();
  DepthRenderer& tiles_ = *tiled_;
  BothRenderers renderer_{gl_, tiles_, ShowsGl()};
};

std::string ByName(const testing::TestParamInfo<const char*>& info) { return info.param; }

INSTANTIATE_TEST_SUITE_P(Renderers, DepthRendererTest, testing::Values("egl", "cpu"), ByName);

TEST_P(DepthRendererTest, AgreesWithAnalyticRayCaster) {
  // Those that were measured; the other modes of these devices are parts of the same chips.
  const std::set<std::string> sensors = {"realsense_d415", "kinect_v1", "kinect_v2",
                                         "azure_kinect_nfov_binned"};
  std::vector<Intrinsics> pool;
  for (const IntrinsicsPoolEntry& entry : ReadIntrinsicsPool("configs/intrinsics.yaml")) {
    if (sensors.count(entry.sensor) == 0) continue;
    pool.insert(pool.end(), entry.intrinsics.begin(), entry.intrinsics.end());
  }
  for (Intrinsics& k : pool) k.distortion.clear();
  ASSERT_EQ(pool.size(), 21u);
  EXPECT_GT(CompareWithRays(paper_, pool, 100, {0}).faces, 15'000'000);
}

TEST_P(DepthRendererTest, AgreesWithAnalyticRayCasterThroughALens) {
  const std::vector<Intrinsics> cameras = {
      HalfKinect(),
      {128, 106, 91.8, 91.8, 64.2, 51.1, {0.09, -0.27, 0, 0, 0.10}},
      {120, 100, 130, 128, 58.7, 50.2, {-0.12, 0.04, 0.003, -0.002}}};
  const Score score = CompareWithRays(paper_, cameras, 24, {0, -0.25, 0.25});
  EXPECT_GT(score.faces, 200'000);
  EXPECT_GT(score.edges, 10'000);
  EXPECT_LT(score.off, 0.002 * static_cast<double>(score.edges));
  EXPECT_LE(score.far_off, 3);  // by rounding: one compiler has it, another one has not
}

TEST_P(DepthRendererTest, NothingIsSeenWhereTheLensHasNoRay) {
  const Intrinsics k{160, 144, 126, 126, 79, 72, {-0.5, 0, 0, 0}};
  const RayTable rays = ComputeRays(k);
  SceneMesh mesh;
  mesh.AppendQuad({Eigen::Vector3d(-9, -9, 2), Eigen::Vector3d(9, -9, 2), Eigen::Vector3d(9, 9, 2),
                   Eigen::Vector3d(-9, 9, 2)},
                  -Eigen::Vector3d::UnitZ(), 3);
  RenderedView view;
  renderer_.Render(mesh, k, Pose::Identity(), &view);
  int without = 0;
  for (const auto [u, v] : Pixels(k.width, k.height)) {
    const bool has_ray = rays.at(u, v).allFinite();
    ASSERT_EQ(view.labels(u, v), has_ray ? 3 : 0) << u << " " << v;
    ASSERT_NEAR(view.depth(u, v), has_ray ? 2 : 0, 1e-6);
    without += !has_ray;
  }
  EXPECT_GT(without, 1000);
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

TEST_P(DepthRendererTest, RejectsWhatItCannotDraw) {
  RenderedView view;
  const Intrinsics folded{64, 64, 50, 50, 32, 32, {-20, 0, 0, 0}};
  const Intrinsics empty{0, 64, 50, 50, 32, 32, {}}, good{64, 64, 50, 50, 32, 32, {}};
  SceneMesh many;
  many.faces.resize(65536);
  for (DepthRenderer* renderer : std::initializer_list<DepthRenderer*>{&gl_, &tiles_}) {
    EXPECT_THROW(renderer->Render(SceneMesh(), folded, Pose::Identity(), &view), DataError);
    EXPECT_THROW(renderer->Render(SceneMesh(), empty, Pose::Identity(), &view), Error);
    EXPECT_THROW(renderer->Render(many, good, Pose::Identity(), &view), Error);
  }
}

// In place of a device that is reset, which a test cannot do: OpenGL's answer after that.
TEST(EglContextTest, ALostContextIsAnError) {
  const std::unique_ptr<DepthRenderer> owned = GlRenderers()();
  DepthRenderer& renderer = *owned;
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

TEST_P(DepthRendererTest, DrawsMeshesAsRaysMeetThem) {
  for (const mesh_shapes::Shape& shape : mesh_shapes::TenShapes()) {
    SCOPED_TRACE(shape.name);
    const Structure structure = mesh_shapes::StructureOf(shape);
    // As it is built: moved and scaled.
    Pose offset = Pose::Identity();
    offset.linear() = RotationExp({0, 0.1, 0});
    const Structure built =
        structure.DisplacedToDraw(std::vector<Pose>(structure.boxes().size(), offset), 1.02);
    EXPECT_GT(CompareWithRays(built, {{160, 144, 126, 126, 79.4, 71.7, {}}}, 2, {0}).labelled, 400);
  }
}

TEST(ChooseRenderersTest, DecidesAuto) {
  constexpr RendererKind kEgl = RendererKind::kEgl, kCpu = RendererKind::kCpu,
                         kAuto = RendererKind::kAuto;
  EXPECT_EQ(ChooseRenderers(kEgl).kind, kEgl);
  EXPECT_EQ(ChooseRenderers(kCpu).kind, kCpu);
  EXPECT_EQ(ChooseRenderers(kAuto).kind, EglContext().IsSoftware() ? kCpu : kEgl);
  EXPECT_EQ(ChooseRenderers(kAuto, {}, /*cuda_trains=*/true).kind, kCpu);
  EXPECT_TRUE(Has(ChooseRenderers(kAuto, {}, true).description, "GPU"));
}

TEST(ChooseRenderersTest, AutoDoesWithoutOpenGl) {
  const EglContextOptions none{/*device=*/1000};
  EXPECT_EQ(ChooseRenderers(RendererKind::kAuto, none).kind, RendererKind::kCpu);
  EXPECT_THROW(ChooseRenderers(RendererKind::kEgl, none), IoError);
}

/// Training samples of furnished rooms: of every sensor of the pool, with its lens.
class SampleScenes : public testing::TestWithParam<std::pair<const char*, const char*>> {};

TEST_P(SampleScenes, LookTheSame) {
  const std::unique_ptr<DepthRenderer> owned = GlRenderers()();
  DepthRenderer& gl = *owned;
  const std::unique_ptr<DepthRenderer> tiled = TileRenderers()();
  DepthRenderer& tiles = *tiled;
  BothRenderers both(gl, tiles, true);
  const SampleContext context =
      MakeSampleContext(SamplesOf(GetParam().first, GetParam().second, "none"), 16);
  for (std::uint64_t index = 0; index < 24; ++index) Synthesize(context, both, 77, index);
  // Through a lens, OpenGL loses what is smaller than a pixel of the picture that it is cut from.
  both.ExpectTheSame(context.image_sizes[0].first < 100 ? 5e-3 : 5e-4);
}

INSTANTIATE_TEST_SUITE_P(Sensors, SampleScenes,
                         testing::Values(std::pair("realsense_d415", "320x180"),
                                         std::pair("realsense_d415", "73x41"),
                                         std::pair("azure_kinect_nfov_binned", "320x288"),
                                         std::pair("azure_kinect_nfov_binned", "51x46")));

}  // namespace
}  // namespace volalign::gl_depth_renderer_test
