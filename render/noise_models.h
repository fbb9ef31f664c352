#pragma once

#include <cstring>
#include <optional>
#include <vector>

#include "core/base/noise_fields.h"
#include "core/base/random.h"
#include "render/noise.h"

namespace volalign {

/// px, width of the pictures for which the models' parameters are given.
inline constexpr double kReferenceWidth = 320;

/// A uniform number within a range.
inline double Draw(const double (&range)[2], RandomStream& random) {
  return random.Uniform(range[0], range[1]);
}

/// The paper's noise ("Implementation details"): zero depth along the structure's outline and its
/// boxes' depth edges, and elliptical holes.
NoisyView PaperNoise(const NoiseConfig& config, const NoiseInput& input, RandomStream& random);

/// Rounds depths to the millimetre, as sensors do. If `keep` is 0 or the depth is not positive,
/// depth and label become 0.
void RoundKept(const Image<std::uint8_t>& keep, NoisyView* view);

/// Calls visit(i) for each i < count whose byte is not 0. There are seven more bytes, which are 0.
template <class Visit>
void ForEachSet(const std::vector<std::uint8_t>& bytes, int count, const Visit& visit) {
  for (int first = 0; first < count; first += 8) {
    std::uint64_t eight = 0;
    std::memcpy(&eight, &bytes[static_cast<std::size_t>(first)], sizeof eight);
    // The first byte is the lowest.
    while (eight != 0) {
      const int next = __builtin_ctzll(eight) / 8;
      visit(first + next);
      eight &= ~(std::uint64_t{0xFF} << (8 * next));
    }
  }
}

/// Calls visit(begin, end, face) for each run of pixels of one face, an index into the mesh's
/// faces. Pixels without a face are skipped.
template <class Visit>
void ForEachRun(const std::uint16_t* faces, int count, const Visit& visit) {
  for (int begin = 0, end = 0; begin < count; begin = end) {
    const std::uint16_t face = faces[begin];
    const std::uint64_t four = face * 0x0001000100010001ULL;
    for (std::uint64_t next = 0; end + 4 <= count; end += 4) {
      std::memcpy(&next, faces + end, sizeof next);
      if (next != four) break;
    }
    while (end < count && faces[end] == face) ++end;
    if (face != 0) visit(begin, end, static_cast<std::size_t>(face - 1));
  }
}

/// edges[u], bit 0: the face right of u differs; bit 1: the face below (`below`) differs.
void FindFaceEdges(const std::uint16_t* faces, const std::uint16_t* below, int count,
                   std::uint8_t* edges);

/// ForEachNeighbourPair without pairs of one face.
template <class Visit>
void ForEachFaceEdge(const Image16& faces, const Visit& visit) {
  const int width = faces.width(), height = faces.height();
  std::vector<std::uint8_t> edges(static_cast<std::size_t>(width) + 7);
  for (int v = 0; v < height; ++v) {
    const std::uint16_t* const row = &faces(0, v);
    FindFaceEdges(row, v + 1 < height ? row + width : row, width, edges.data());
    ForEachSet(edges, width, [&](int u) {
      const std::uint8_t edge = edges[static_cast<std::size_t>(u)];
      const std::uint64_t pair =
          2 * (static_cast<std::uint64_t>(v) * static_cast<std::uint64_t>(width) +
               static_cast<std::uint64_t>(u));
      if (edge & 1) visit(u, v, u + 1, v, pair);
      if (edge & 2) visit(u, v, u, v + 1, pair + 1);
    });
  }
}

/// Time of flight (docs/sensor-models.md): white noise that grows with distance and incidence, a
/// smooth warp, and a bias of the frame. Also multipath in concave corners, gaps and few flying
/// pixels at depth edges, and lost depth on dark and grazing surfaces.
struct TofModel {
  bool hexagon = false;  ///< Azure Kinect's illumination mask, valid region |u - u0| <= 175.2 - k
                         ///< |v - v0| at 320x288
};
/// Uses `device` if it has a value, else draws it. A device keeps the numbers of its first frame,
/// so that a single frame does not depend on further frames of its device.
NoisyView TofNoise(const TofModel& model, const NoiseInput& input, RandomStream& random,
                   std::optional<TofDevice>* device);

/// Sets `keep` to 0 where the Azure Kinect's lamp gives no light: outside of a hexagon about
/// `centre_u`, px at 320x288.
void ClearOutsideHexagon(int width, int height, double centre_u, Image<std::uint8_t>* keep);
double DrawHexagonCentre(RandomStream& random);

/// Stereo and structured light (docs/sensor-models.md): noise in disparity, z = f B / d. The
/// defaults are a D415's.
struct StereoModel {
  double native_width = 1280;              ///< px, resolution of the following numbers
  double focal_baseline = 51.9;            ///< f B, px m
  double local_sigma[2] = {0.045, 0.065};  ///< px rms, range drawn from
  double warp_sigma[2] = {0.08, 0.19};     ///< px rms
  double largest_disparity = 126;          ///< px; nearer surfaces are not matched
};
/// `device` as in TofNoise.
NoisyView StereoNoise(const StereoModel& model, const NoiseInput& input, RandomStream& random,
                      std::optional<StereoDevice>* device);

// The noise model "physics" (docs/sensor-models.md): it simulates the sensor's light, from which
// errors follow. `device_seed`: of the errors that are the same in all frames of a device.

/// Phasors of two modulation frequencies: mixed at edges, reflected between surfaces, scattered in
/// the lens, with shot noise. Depth is lost if light is too weak, or differs between the
/// frequencies.
NoisyView TofPhysics(const TofModel& model, const NoiseInput& input, std::uint64_t device_seed,
                     RandomStream& random);

/// Block matching of two pictures of the textured scene under the projector's dots, by a pair that
/// is not perfectly calibrated.
NoisyView StereoPhysics(const StereoModel& model, const NoiseInput& input,
                        std::uint64_t device_seed, RandomStream& random);

}  // namespace volalign
