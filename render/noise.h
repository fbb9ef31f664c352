#pragma once

#include <cstdint>
#include <string>

#include "core/camera.h"
#include "core/pose.h"
#include "core/structure.h"
#include "render/depth_renderer.h"
#include "render/sample_config.h"
#include "render/scene_mesh.h"

namespace volalign {

/// What a noise model may look at: the clean view and the scene that it shows. `structure` is the
/// one that was drawn.
struct NoiseInput {
  const RenderedView& view;
  const SceneMesh& mesh;
  const Structure& structure;
  const Intrinsics& intrinsics;
  const Pose& structure_from_sensor;
  const std::string& sensor;  ///< pool name
};

struct NoisyView {
  DepthImage depth;   ///< m, 0 for no measurement
  LabelImage labels;  ///< 0 where the depth is 0 or does not come from one surface
};

/// Pool names that have a sensor model: time of flight the first two, disparity the others.
inline constexpr char kSensorModels[] =
    "azure_kinect*, kinect_v2*, realsense_d415*, realsense_d435*, realsense_d455* and kinect_v1*";

/// Whether a sensor model exists for a pool name.
bool HasSensorModel(const std::string& sensor);

/// Random stage "noise". Throws ConfigError for model "sensor" and a sensor without one.
NoisyView ApplyNoise(const NoiseConfig& config, const NoiseInput& input, std::uint64_t seed,
                     std::uint64_t index);

}  // namespace volalign
