#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/camera.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "render/depth_renderer.h"
#include "render/sample_config.h"
#include "render/scene_mesh.h"

namespace volalign {

/// The input of a noise model: the scene, and its clean view, or the result of earlier models.
/// `structure` is the one that was drawn.
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

/// Errors of a time-of-flight device that are the same in all of its frames.
struct TofDevice {
  float bias = 0;                                                         ///< m
  float white = 0, warp_rms = 0, multipath = 0, fill = 0, threshold = 0;  ///< strengths
  Image<float> warp;                                                      ///< unit normal field
  double mask_centre_u = 0;  ///< px at 320x288, if it has a mask
};

/// Errors of a stereo or structured-light device that are the same in all of its frames.
struct StereoDevice {
  Image<float> outline_u, outline_v;       ///< unit normal fields, by which the foreground grows
  double local_sigma = 0, warp_sigma = 0;  ///< px
  Image<float> warp;                       ///< unit normal field
};

/// The errors of one device, the same in every frame. Empty until a frame has drawn them. All
/// frames of a device have the same size.
struct DeviceErrors {
  std::optional<TofDevice> tof;
  std::optional<StereoDevice> stereo;
  std::optional<std::uint64_t> seed;  ///< of the noise model "physics"
};

/// Depth and labels after a sensor's noise. A pure function of the input and the numbers that it
/// draws, on which alone a training sample depends. Called by several threads at once.
using NoiseModel = std::function<NoisyView(const NoiseInput&, RandomStream&)>;

/// Makes `name` a noise model of recipes and rigs. To be called at the start of a program, before
/// other threads run. Throws Error if the model exists.
void RegisterNoiseModel(const std::string& name, NoiseModel model);

/// Throws ConfigError if the models of the key cannot be applied to a sensor (pool name). There is
/// no "sensor" and no "physics" for some, and "physics" has to be the first model.
void RequireNoiseModels(const std::string& key, const std::vector<std::string>& models,
                        const std::string& sensor);

/// Applies config.models in order. Pixels that one leaves without depth show no face to the next.
/// Random stage "noise". If `device` has errors, they replace those that the frame would draw. If
/// it is empty, it receives the frame's. Throws as RequireNoiseModels.
NoisyView ApplyNoise(const NoiseConfig& config, const NoiseInput& input, std::uint64_t seed,
                     std::uint64_t index, DeviceErrors* device = nullptr);

/// Adds a few millimetres of errors that a whole frame has in common, as calibration expects them
/// of the sensor's kind: a gain, tilts, shear and multipath (core/geometry/frame_errors.h).
/// Also adds the bulges of the structure's sides (Subpixels). For captures of rigs; training
/// samples have none. Pixels without depth do not change.
void AddFrameErrors(const NoiseInput& input, RandomStream random, NoisyView* noisy);

}  // namespace volalign
