#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "core/base/random.h"
#include "core/geometry/camera.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "render/depth_renderer.h"
#include "render/sample_config.h"
#include "render/scene_mesh.h"

namespace volalign {

/// What a noise model may look at: the scene, and the clean view of it or, behind other models,
/// what these left of that. `structure` is the one that was drawn.
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

/// What a time-of-flight device does alike in all of its frames.
struct TofDevice {
  float bias = 0;                                                         ///< m
  float white = 0, warp_rms = 0, multipath = 0, fill = 0, threshold = 0;  ///< strengths
  Image<float> warp;                                                      ///< unit normal field
  double mask_centre_u = 0;  ///< px at 320x288, where it has a mask
};

/// What a stereo or structured-light device does alike in all of its frames.
struct StereoDevice {
  Image<float> outline_u, outline_v;       ///< unit normal fields, by which the foreground grows
  double local_sigma = 0, warp_sigma = 0;  ///< px
  Image<float> warp;                       ///< unit normal field
};

/// The errors of one device, which stay the same from frame to frame. Empty until a frame has drawn
/// them. All frames of a device have the same size.
struct DeviceErrors {
  std::optional<TofDevice> tof;
  std::optional<StereoDevice> stereo;
  std::optional<std::uint64_t> seed;  ///< of the noise model "physics"
};

/// Whether this value of noise.models wants sensors that have a model.
bool WantsSensorModel(const std::string& model);
/// Whether a sensor model exists for a pool name.
bool HasSensorModel(const std::string& sensor);
/// The beginnings of such names, for messages: "azure_kinect*, kinect_v2*, ...".
std::string SensorModelNames();

/// Depth and labels as a sensor measures them. A pure function of the input and the numbers it
/// draws, called by several threads at once: a training sample depends on nothing else.
using NoiseModel = std::function<NoisyView(const NoiseInput&, RandomStream&)>;

/// Makes `name` a value of noise.models. To be called at the start of a program, before other
/// threads run. Throws Error where there is such a model.
void RegisterNoiseModel(const std::string& name, NoiseModel model);

/// Applies config.models in order; pixels that one has left without depth show no face to the next.
/// Random stage "noise". `device`: where it has errors, they take the place of those that the frame
/// would draw; where it is empty, it receives the ones that the frame has drawn. Throws ConfigError
/// for the models "sensor" and "physics" and a sensor that is none of SensorModelNames.
NoisyView ApplyNoise(const NoiseConfig& config, const NoiseInput& input, std::uint64_t seed,
                     std::uint64_t index, DeviceErrors* device = nullptr);

/// Adds errors that a whole frame has, as calibration expects them of the sensor's kind: a gain,
/// tilts, twist, shear and bounced light (core/geometry/frame_errors.h); and the bulges of the
/// structure's sides (Subpixels). Of a few millimetres: for the captures of rigs; training samples
/// are without. Where there is no depth, there is none after.
void AddFrameErrors(const NoiseInput& input, RandomStream random, NoisyView* noisy);

}  // namespace volalign
