#include <Eigen/Geometry>
#include <cmath>

#include "core/geometry/frame_errors.h"
#include "core/geometry/sensor_kind.h"
#include "render/noise_models.h"
#include "render/subpixels.h"

namespace volalign {
namespace {

// The floor that the structure stands on.
constexpr double kLevel = 0.99, kFloorThickness = 2e-3;  // cosine, m

}  // namespace

void AddFrameErrors(const NoiseInput& input, RandomStream random, NoisyView* noisy) {
  const DepthErrorModel& model = ErrorsOf(input.sensor);
  const double gain = random.Normal(0, model.gain);
  FrameErrorVector errors = FrameErrorSigmas(model);
  for (double& error : errors) error *= random.Normal();
  errors[kDiffuseMultipath] = random.Uniform(0, 2 * model.bounce_m);
  const Pose& pose = input.structure_from_sensor;
  const Side floor = FloorOf(input.structure);
  const Subpixels bulging(input);
  for (std::size_t i = 0; i < noisy->depth.size(); ++i) {
    float& depth = noisy->depth[i];
    if (depth == 0 || input.view.faces[i] == 0) continue;
    const int index = input.view.faces[i] - 1;
    const SceneFace& face = input.mesh.faces[static_cast<std::size_t>(index)];
    const Eigen::Vector3d p = depth * input.view.rays->rays[i].homogeneous().cast<double>();
    FrameErrorVector at = FrameErrorsAt(model, p, pose.linear().transpose() * face.normal);
    const int label = input.view.labels[i];
    const bool on_floor =
        face.normal.y() > kLevel && std::abs(face.offset - floor.centre.y()) < kFloorThickness;
    if (errors[kDiffuseMultipath] != 0 && (label != 0 || on_floor)) {
      at[kDiffuseMultipath] = DiffuseMultipathShare(
          input.structure, label == 0 ? floor : input.structure.SideOfLabel(label), pose * p,
          pose.translation(), model.bounce_reach_m);
    }
    const Eigen::Vector3f ray = input.view.rays->rays[i].homogeneous();
    depth += static_cast<float>(gain * depth + errors.dot(at)) + bulging.Depth(index, ray) -
             input.view.depth[i];
  }
  RoundKept(Image<std::uint8_t>(noisy->depth.width(), noisy->depth.height(), 1), noisy);
}

}  // namespace volalign
