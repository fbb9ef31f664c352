#include "render/tiles/tile_renderer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <thread>
#include <vector>

#include "core/geometry/lens.h"
#include "render/sample.h"
#include "tests/core/base/pixels.h"
#include "tests/render/test_scene.h"

namespace volalign {

// For EXPECT_EQ.
bool operator==(const RenderedView& a, const RenderedView& b) {
  return a.depth == b.depth && a.labels == b.labels && a.faces == b.faces;
}

namespace tile_renderer_test {
namespace {

const Intrinsics kPinhole{161, 143, 126, 125, 79.3, 71.8, {}};
const Intrinsics kKinect = HalfKinect();

/// A large square at `distance` m along the optical axis, turned by `tilt` rad about an oblique
/// axis.
struct Wall {
  Wall(double distance, double tilt) {
    const Eigen::Matrix3d turn =
        Eigen::AngleAxisd(tilt, Eigen::Vector3d(0.6, -0.8, 0)).toRotationMatrix();
    const Eigen::Vector3d u = 40 * turn.col(0), v = 40 * turn.col(1);
    middle = Eigen::Vector3d(0, 0, distance);
    normal = -turn.col(2);
    mesh.AppendQuad({middle - u - v, middle - u + v, middle + u + v, middle + u - v}, normal, 3);
  }
  SceneMesh mesh;
  Eigen::Vector3d middle, normal;
};

/// By the kernels of each instruction set that this processor has.
class TileRendererBy : public testing::TestWithParam<int> {
 protected:
  const std::unique_ptr<DepthRenderer> tiled_ =
      TileRenderers(tiles::AllKernels().sets[GetParam()])();
  DepthRenderer& renderer_ = *tiled_;
};
INSTANTIATE_TEST_SUITE_P(InstructionSets, TileRendererBy,
                         testing::Range(0, tiles::AllKernels().count), [](const auto& set) {
                           return std::string(tiles::AllKernels().sets[set.param].name);
                         });

/// The point that a pixel shows, put through the lens, is at the pixel, and it lies on the wall.
TEST_P(TileRendererBy, DepthHasItsClosedFormNearAndFarThroughEveryLens) {
  for (const Intrinsics& k : {kPinhole, kKinect}) {
    for (const double distance : {0.05, 2.0, 15.0}) {
      for (const double tilt : {0.0, 0.5}) {
        const Wall wall(distance, tilt);
        RenderedView view;
        renderer_.Render(wall.mesh, k, Pose::Identity(), &view);
        for (const auto [u, v] : Pixels(k.width, k.height)) {
          const double z = view.depth(u, v);
          ASSERT_EQ(view.labels(u, v), 3);
          ASSERT_EQ(view.faces(u, v), 1);
          const Eigen::Vector2d ray = view.rays->at(u, v).cast<double>();
          ASSERT_NEAR((ProjectRay(k, ray) - Eigen::Vector2d(u, v)).norm(), 0, 1e-3);
          const Eigen::Vector3d p = z * Eigen::Vector3d(ray.x(), ray.y(), 1);
          ASSERT_NEAR(wall.normal.dot(p - wall.middle), 0, 2e-6 * z) << u << " " << v;
        }
      }
    }
  }
}

TEST_P(TileRendererBy, NothingIsSeenWhereTheLensHasNoRay) {
  // r (1 - 0.5 r^2) rises up to 0.5443.
  const Intrinsics k{160, 144, 126, 126, 79, 72, {-0.5, 0, 0, 0}};
  RenderedView view;
  renderer_.Render(Wall(2, 0).mesh, k, Pose::Identity(), &view);
  for (const auto [u, v] : Pixels(k.width, k.height)) {
    const double radius = std::hypot(u - k.cx, v - k.cy) / k.fx;
    if (std::abs(radius - 0.545) < 0.005) continue;
    ASSERT_EQ(view.labels(u, v), radius < 0.54 ? 3 : 0) << u << " " << v;
    ASSERT_NEAR(view.depth(u, v), radius < 0.54 ? 2 : 0, 1e-6);
  }
}

TEST_P(TileRendererBy, FacesNearerThanTheNearPlaneAreNotSeen) {
  RenderedView view;
  renderer_.Render(Wall(0.019, 0).mesh, kPinhole, Pose::Identity(), &view);
  EXPECT_EQ(view.faces, Image16(kPinhole.width, kPinhole.height));
  // One that passes through the plane: its part beyond it is.
  const Wall tilted(0.03, 1.2);
  renderer_.Render(tilted.mesh, kPinhole, Pose::Identity(), &view);
  long seen = 0;
  for (const auto [u, v] : Pixels(kPinhole.width, kPinhole.height)) {
    const Eigen::Vector2d ray = view.rays->at(u, v).cast<double>();
    const double inverse =
        tilted.normal.dot(Eigen::Vector3d(ray.x(), ray.y(), 1)) / tilted.normal.dot(tilted.middle);
    // The wall ends somewhere beyond 10 m.
    if (std::abs(inverse - 50) < 1e-3 || (inverse > 0 && inverse < 0.1)) continue;
    const bool is_seen = inverse > 0 && inverse < 50;
    EXPECT_NEAR(view.depth(u, v), is_seen ? 1 / inverse : 0, 1e-5 / (inverse * inverse));
    seen += is_seen;
  }
  EXPECT_GT(seen, 1000);
}

// Small squares beside the picture's borders, inside, in pictures of either orientation and off
// their axis.
TEST(TileRendererTest, WhatIsInAnyCornerIsSeen) {
  const std::unique_ptr<DepthRenderer> tiled = TileRenderers()();
  DepthRenderer& renderer = *tiled;
  for (const Intrinsics& k :
       {Intrinsics{40, 90, 60, 60, 19, 45, {}}, Intrinsics{90, 40, 60, 60, 45, 19, {}},
        Intrinsics{50, 50, 60, 60, 5, 40, {}}, Intrinsics{50, 50, 60, 60, 40, 5, {}}}) {
    for (const int u : {2, k.width / 2, k.width - 3}) {
      for (const int v : {2, k.height / 2, k.height - 3}) {
        SceneMesh mesh;
        const Eigen::Vector3d middle(2 * (u - k.cx) / k.fx, 2 * (v - k.cy) / k.fy, 2);
        const Eigen::Vector3d x(0.05, 0, 0), y(0, 0.05, 0);
        mesh.AppendQuad({middle - x - y, middle - x + y, middle + x + y, middle + x - y},
                        -Eigen::Vector3d::UnitZ(), 3);
        RenderedView view;
        renderer.Render(mesh, k, Pose::Identity(), &view);
        EXPECT_EQ(view.labels(u, v), 3) << k.width << "x" << k.height << ": " << u << " " << v;
      }
    }
  }
}

/// Keeps what it draws.
class Recorder : public DepthRenderer {
 public:
  explicit Recorder(const tiles::TileKernels& kernels) : renderer_(TileRenderers(kernels)()) {}
  void Render(const SceneMesh& mesh, const Intrinsics& intrinsics, const Pose& pose,
              RenderedView* view) override {
    renderer_->Render(mesh, intrinsics, pose, view);
    views.push_back(*view);
  }
  std::vector<RenderedView> views;

 private:
  const std::unique_ptr<DepthRenderer> renderer_;
};

/// Of the first samples of the default recipe, and of its last ones before them where `backwards`.
std::vector<RenderedView> SampleViews(const tiles::TileKernels& kernels, bool backwards) {
  SampleConfig config;
  config.image_sizes = {"160x144", "73x41"};
  config.noise.models = {"none"};
  const SampleContext context = MakeSampleContext(config, 1);
  constexpr std::uint64_t kCount = 12;
  Recorder recorder(kernels);
  for (std::uint64_t i = 0; i < kCount; ++i)
    Synthesize(context, recorder, 5, backwards ? kCount - 1 - i : i);
  if (backwards) std::reverse(recorder.views.begin(), recorder.views.end());
  return recorder.views;
}

TEST(TileRendererTest, PicturesDependOnNothingElse) {
  const KernelSets<tiles::TileKernels>& all = tiles::AllKernels();
  const std::vector<RenderedView> expected = SampleViews(all.sets[0], false);
  for (int set = 0; set < all.count; ++set) {
    std::vector<std::vector<RenderedView>> views(4);
    std::vector<std::thread> threads;
    for (std::size_t t = 0; t < views.size(); ++t) {
      threads.emplace_back([&, t] { views[t] = SampleViews(all.sets[set], t % 2 == 1); });
    }
    for (std::thread& thread : threads) thread.join();
    for (const auto& of_thread : views) EXPECT_TRUE(of_thread == expected) << all.sets[set].name;
  }
}

}  // namespace
}  // namespace tile_renderer_test
}  // namespace volalign
