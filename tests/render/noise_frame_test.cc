#include <gtest/gtest.h>

#include <cmath>
#include <utility>

#include "core/geometry/frame_errors.h"
#include "core/geometry/sensor_kind.h"
#include "render/egl/egl_context.h"
#include "render/egl/gl_depth_renderer.h"
#include "render/noise.h"
#include "render/subpixels.h"
#include "tests/core/base/pixels.h"
#include "tests/core/base/tally.h"
#include "tests/render/corner_scene.h"

namespace volalign::noise_frame_test {
namespace {

// Over many devices: what a wall that is seen askew is off by in the middle and at the border of
// the picture.
TEST(AddFrameErrors, AreThoseThatCalibrationExpects) {
  const Intrinsics k = CentredCamera(160, 90, 118);
  EglContext egl;
  GlDepthRenderer renderer;
  const Structure structure = ReadStructure("configs/structure.yaml");
  SceneMesh mesh;
  mesh.BeginObject({0.9F, 1.0F, false});
  mesh.AppendQuad({Eigen::Vector3d(10, -90, -90), Eigen::Vector3d(10, 90, -90),
                   Eigen::Vector3d(10, 90, 90), Eigen::Vector3d(10, -90, 90)},
                  -Eigen::Vector3d::UnitX());
  const Pose pose = LookAt({8.5, 2, 1}, {10, 2.3, 0}, 0);
  RenderedView view;
  renderer.Render(mesh, k, pose, &view);
  for (const char* sensor : {"realsense_d415", "azure_kinect_nfov_binned"}) {
    const DepthErrorModel& model = ErrorsOf(sensor);
    const NoiseInput input = {view, mesh, structure, k, pose, sensor};
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
TEST(AddFrameErrors, OfTimeOfFlightHaveBouncedLight) {
  EglContext egl;
  GlDepthRenderer renderer;
  const Structure structure = ReadStructure("configs/structure.yaml");
  const CornerScene scene(structure, renderer);
  const auto& [mesh, k, pose, view] = scene;
  const double y = structure.FloorHeight();
  const DepthErrorModel& model = ErrorsOf("azure_kinect_nfov_binned");
  const NoiseInput input = {view, mesh, structure, k, pose, "azure_kinect_nfov_binned"};
  constexpr int kDevices = 300;
  Image<double> mean(k.width, k.height, 0);
  for (std::uint64_t device = 0; device < kDevices; ++device) {
    NoisyView noisy{view.depth, view.labels};
    AddFrameErrors(input, {9, device, "frame"}, &noisy);
    for (std::size_t i = 0; i < mean.size(); ++i)
      mean[i] += (noisy.depth[i] - view.depth[i]) / kDevices;
  }
  const Side floor = FloorOf(structure);
  const Subpixels bulging(input);
  int on_front = 0, on_floor = 0;
  for (const auto [u, v] : Pixels(k.width, k.height)) {
    const double z = view.depth(u, v);
    const Eigen::Vector3d q =
        pose * Eigen::Vector3d(z * (u - k.cx) / k.fx, z * (v - k.cy) / k.fy, z);
    const int label = view.labels(u, v);
    const bool is_floor = label == 0 && std::abs(q.y() - y) < 1e-3 && q.x() > 0.3 && q.x() < 0.6 &&
                          std::abs(q.z()) < 0.2;
    const bool is_front = label != 0 && structure.SideOfLabel(label).name == "bottom/front";
    if (!is_floor && !is_front) continue;
    const double expected =
        model.bounce_m * BouncedShare(structure, is_floor ? floor : structure.SideOfLabel(label), q,
                                      pose.translation(), model.bounce_reach_m);
    const double bulge =
        bulging.Depth(view.faces(u, v) - 1, view.rays->at(u, v).homogeneous()) - view.depth(u, v);
    EXPECT_NEAR(mean(u, v) - bulge, expected, 0.0005) << u << " " << v;
    (is_floor ? on_floor : on_front) += expected > 0.002;
  }
  EXPECT_GT(on_front, 200);
  EXPECT_GT(on_floor, 200);
}

}  // namespace
}  // namespace volalign::noise_frame_test
