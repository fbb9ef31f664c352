#pragma once

#include <cstdint>

#include "core/base/kernel_sets.h"

namespace volalign::noise {

/// The stereo matcher's view of a row of pixels. Faces, rays and the three numbers of a face are
/// [count], rays as pairs (x, y).
struct MatchRow {
  int count;
  const std::uint16_t* faces;
  const float* rays;
  const float* height;         ///< distance of the eye from the face's plane, m
  const float* confidence;     ///< of the face, before distance and incidence
  const float* distance_loss;  ///< of confidence, per metre
  const float *coarse, *fine;  ///< random fields
  const float* disparity_error;
  float image_fb, native_fb;  ///< focal length times baseline, px m: of this image, of the model's
  float largest_disparity;    ///< px of this image
  float margin;               ///< px
};

/// The parameters of MatchRow's law (render/noise_stereo.cc).
struct MatchFigures {
  float full_quality_distance, grazing_loss, grazing_cosine, steep_loss, steep_cosine;
  float coarse_weight, fine_weight, least_disparity;
};

/// A time-of-flight sensor's view of a row of pixels, as MatchRow.
struct TofRow {
  int count;
  const std::uint16_t* faces;
  const float* depth;  ///< of the clean view
  const float* rays;
  const float *height, *reflectivity;
  const float* patch_limit;  ///< of the face
  const float *warp, *grain, *patches;
  float bias, warp_rms, white, threshold;
};

/// The parameters of TofRow's law (render/noise_tof.cc).
struct TofFigures {
  float white_noise, white_noise_slope, least_cosine, patch_wave, farthest;
};

/// A box in its own frame.
struct SeamBox {
  float rotation[9];    ///< box_from_structure, row by row
  float centre[3];      ///< in the structure's frame, m
  float half[3];        ///< half its size, m
  float reach_squared;  ///< of the sphere about the centre beyond which no seam is near
};

/// Adjacent pixels of one face, in front of which boxes rise.
struct SeamRow {
  int count;
  const float *depth, *rays;
  float rotation[9], eye[3];  ///< structure_from_sensor, row by row
  const SeamBox* boxes;
  int num_boxes;
  std::uint64_t rising;  ///< bit b: box b rises before the face
  bool meets_floor;
  float floor;                       ///< its height, m
  float multipath, multipath_reach;  ///< m: error at a seam, distance at which it is 0
  float fill, fill_reach;            ///< the same for the filter that rounds corners
};

/// Loops over rows of pixels, each compiled for every instruction set. All give the same to the
/// last bit as the plain loops that they replace (tests/render/noise_kernels_test.cc).
struct NoiseKernels {
  const char* name;  ///< of the instruction set
  /// Row v: `source[u]` is the index of the pixel that the window takes for u. It is offset by
  /// `reach` (du, dv) and a dither in [0, 1) minus one half. `nearer[u]`: that pixel has depth, and
  /// u has none or a depth larger by more than `step`.
  void (*fatten)(const float* depth, int width, int height, int v, const float* du, const float* dv,
                 const float* dither, float reach, float step, std::int32_t* source,
                 std::uint8_t* nearer);
  /// edges[u], bit 0: the face right of u differs; bit 1: the face below (`below`) differs.
  void (*face_edges)(const std::uint16_t* faces, const std::uint16_t* below, int count,
                     std::uint8_t* edges);
  /// Adds the disparity's error to `depth`, and clears `keep` if no match is found. `scratch` has 3
  /// `count` numbers.
  void (*match)(const MatchRow&, const MatchFigures&, float* depth, std::uint8_t* keep,
                float* scratch);
  /// error[u] of depth, m, without that of seams. Clears `keep` if too little light returns.
  void (*measure)(const TofRow&, const TofFigures&, float* error, std::uint8_t* keep);
  /// Adds the nearest seam's effect to error[u]. `scratch` has 4 `count` numbers.
  void (*seams)(const SeamRow&, float* error, float* scratch);
  /// mixed[u]: whether `here` lies between both neighbours of its row or its column, if these
  /// differ by at least `jump`. It has to lie at more than `low` and less than `high` of the
  /// difference. `above` and `below` may be null.
  void (*mixed)(const float* above, const float* here, const float* below, int count, float jump,
                float low, float high, std::uint8_t* mixed);
  /// Rounds depth to the millimetre. If `keep` is 0 or depth not positive, depth and label become
  /// 0.
  void (*round)(const std::uint8_t* keep, int count, float* depth, std::uint8_t* labels);
};

const KernelSets<NoiseKernels>& AllNoiseKernels();

/// The best of them, or those of KernelsOnThisThread.
const NoiseKernels& Kernels();

/// Makes Kernels() return `kernels` on the calling thread while it lives. Tests and benchmarks
/// compare instruction sets by it.
class KernelsOnThisThread {
 public:
  explicit KernelsOnThisThread(const NoiseKernels& kernels);
  ~KernelsOnThisThread();
  KernelsOnThisThread(const KernelsOnThisThread&) = delete;
  KernelsOnThisThread& operator=(const KernelsOnThisThread&) = delete;
};

}  // namespace volalign::noise
