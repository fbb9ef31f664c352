#pragma once

#include <array>
#include <string>
#include <vector>

#include "core/config/config.h"
#include "core/geometry/scene_config.h"

namespace volalign {

/// Distribution of sensor poses. The defaults are the paper's (Results, "Implementation details").
struct PoseConfig {
  std::array<double, 2> rho_cm{150, 275};
  std::array<double, 2> height_cm{-15, 75};
  std::vector<double> phi_deg;
  double phi_jitter_deg = 0;
  double look_at_radius_cm = 20;
  double roll_deg = 5;
  std::vector<double> roll_offsets_deg{90};

  template <class Archive>
  void Describe(Archive& ar) {
    ar("rho_cm", rho_cm, "horizontal distance of the sensor from the origin, cm, uniform",
       Above(0));
    ar("height_cm", height_cm, "height of the sensor above the origin, cm, uniform");
    ar("phi_deg", phi_deg,
       "fixed azimuths of the sensor from +x towards +z, deg, one drawn for each sample; empty: "
       "all "
       "azimuths alike");
    ar("phi_jitter_deg", phi_jitter_deg,
       "largest deviation from a fixed azimuth, deg, uniform; only with phi_deg", Between(0, 180));
    ar("look_at_radius_cm", look_at_radius_cm, "radius of the ball of look-at points, cm",
       AtLeast(0));
    ar("roll_deg", roll_deg, "largest roll about the levelled optical axis, deg, uniform",
       AtLeast(0));
    ar("roll_offsets_deg", roll_offsets_deg,
       "mounting rolls, deg, one drawn for each sample; 90 turns image +x to the floor");
  }
};

/// A scene that is drawn for each sample, with the probability of a room.
struct SampleSceneConfig : SceneConfig {
  double room_probability = 1.0;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("room_probability", room_probability, "share of samples with floor and walls", Between(0, 1),
       Removed("structure_probability", "every sample has the structure; leave the key out",
               std::vector<std::string>{"1"}));
    SceneConfig::Describe(ar);
  }
};

/// Noise of the depth map.
struct NoiseConfig {
  std::vector<std::string> models{"sensor"};
  double paper_border_px = 2;
  double paper_hole_count = 6;  ///< mean number in a sample, at most 90; no key
  double paper_hole_radius_px = 6;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("models", models,
       "list of models, applied in this order: none, paper (zeroed borders and holes), sensor "
       "(models of the drawn sensor), physics (a simulation of its light, for tests, always "
       "first). Your program can register others (render/noise.h)",
       OneOf(NoiseModelNames()), FormerlyNamed("model"));
    ar("paper_border_px", paper_border_px, "largest width of the zeroed structure border, px",
       AtLeast(0),
       Removed("paper_hole_count", "a sample has six holes in the mean; leave the key out",
               std::vector<std::string>{"6"}));
    ar("paper_hole_radius_px", paper_hole_radius_px, "mean radius of a hole, px", AtLeast(0));
  }
};

/// Renderers of depth images. ChooseRenderers decides kAuto.
enum class RendererKind { kEgl, kCpu, kAuto };
constexpr Words<RendererKind, 3> WordsOf(RendererKind) {
  return {
      {{"egl", RendererKind::kEgl}, {"cpu", RendererKind::kCpu}, {"auto", RendererKind::kAuto}}};
}

/// Everything that decides a sample, except seed and index.
struct SampleConfig {
  std::string structure = "configs/structure.yaml";
  std::string intrinsics = "configs/intrinsics.yaml";
  std::vector<std::string> sensors{"realsense_d415", "azure_kinect_nfov_binned"};
  std::vector<std::string> image_sizes{"160x144", "160x90"};
  PoseConfig pose;
  SampleSceneConfig scene;
  AssemblyConfig assembly;
  NoiseConfig noise;
  RendererKind renderer = RendererKind::kEgl;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("structure", structure, "structure file: .yaml, or a mesh (.glb, .gltf, .obj, .stl, .ply)");
    ar("intrinsics", intrinsics, "pool of measured intrinsics");
    ar("sensors", sensors,
       "sensors of the pool. One is drawn for each sample among those with the aspect ratio of the "
       "batch's images. Empty: all that fit a size");
    ar("image_sizes", image_sizes,
       "WIDTHxHEIGHT; one is drawn for each batch, and intrinsics are scaled to it. Each size has "
       "to fit a sensor, and each named sensor a size: aspect ratios within 2 %");
    ar("pose", pose, "sensor pose sampling");
    ar("scene", scene, "procedural room");
    ar("assembly", assembly,
       "how imprecisely the structure's boxes are stacked; 0 is the exact model");
    ar("noise", noise, "sensor noise");
    ar("renderer", renderer,
       "egl (OpenGL), cpu (without a driver), or auto. Auto is cpu if OpenGL is software or "
       "missing, or if training is on CUDA. A run's config.yaml has the choice");
  }
};

}  // namespace volalign
