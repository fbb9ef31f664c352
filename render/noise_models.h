#pragma once

#include <cstring>
#include <optional>
#include <vector>

#include "core/base/noise_fields.h"
#include "core/base/random.h"
#include "render/noise.h"
#include "render/noise_kernels.h"

namespace volalign {

/// px, of the pictures that the figures of the models are for.
inline constexpr double kReferenceWidth = 320;

/// A number of a range, uniform.
inline double Draw(const double (&range)[2], RandomStream& random) {
  return random.Uniform(range[0], range[1]);
}

/// Paper, "Implementation details": zero depth along the structure's outline and its boxes' depth
/// edges, and elliptical holes.
NoisyView PaperNoise(const NoiseConfig& config, const NoiseInput& input, RandomStream& random);

/// Rounds depths to the millimetre, as sensors deliver them. Where `keep` is 0 or the depth is not
/// positive, depth and label become 0.
void RoundKept(const Image<std::uint8_t>& keep, NoisyView* view);

/// Calls visit(i) for each i < count whose byte is not 0. There are seven bytes more, which are 0.
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

/// Calls visit(begin, end, face) for each run of pixels that show one face, an index into the
/// mesh's; not for those that show none.
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

/// ForEachNeighbourPair, but for pairs that show one face.
template <class Visit>
void ForEachFaceEdge(const Image16& faces, const Visit& visit) {
  const int width = faces.width(), height = faces.height();
  std::vector<std::uint8_t> edges(static_cast<std::size_t>(width) + 7);
  for (int v = 0; v < height; ++v) {
    const std::uint16_t* const row = &faces(0, v);
    noise::Kernels().face_edges(row, v + 1 < height ? row + width : row, width, edges.data());
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

/// Time of flight (docs/sensor-models.md): white noise that grows with distance and
/// incidence, a smooth warp, a bias of the frame, multipath in concave corners, gaps and few flying
/// pixels at depth edges, dark and grazing surfaces lost.
struct TofModel {
  bool hexagon = false;  ///< Azure Kinect's illumination mask, valid region |u - u0| <= 175.2 - k
                         ///< |v - v0| at 320x288
};
/// `device` is used where it stands, and else drawn. It is the first frame's numbers that a device
/// keeps, so that a single frame is the same whether its device has others or not.
NoisyView TofNoise(const TofModel& model, const NoiseInput& input, RandomStream& random,
                   std::optional<TofDevice>* device);

/// What the Azure Kinect's lamp does not light is set to 0 in `keep`: outside of a hexagon about
/// `centre_u`, px at 320x288.
void ClearOutsideHexagon(int width, int height, double centre_u, Image<std::uint8_t>* keep);
double DrawHexagonCentre(RandomStream& random);

/// Stereo and structured light (docs/sensor-models.md): noise in disparity, z = f B / d. The
/// defaults are a D415's.
struct StereoModel {
  double native_width = 1280;              ///< px, of the resolution that the next figures are for
  double focal_baseline = 51.9;            ///< f B, px m
  double local_sigma[2] = {0.045, 0.065};  ///< px rms, range drawn from
  double warp_sigma[2] = {0.08, 0.19};     ///< px rms
  double largest_disparity = 126;          ///< px; nearer surfaces are not matched
};
/// `device` as in TofNoise.
NoisyView StereoNoise(const StereoModel& model, const NoiseInput& input, RandomStream& random,
                      std::optional<StereoDevice>* device);

// The noise model "physics" (docs/sensor-models.md): what a sensor does with light, from which its
// errors follow, instead of errors. `device_seed`: of what a device does alike in all of its
// frames.

/// Phasors of two modulation frequencies: mixed at edges, bounced between surfaces, scattered in
/// the lens, with shot noise; what is too weak, or differs between the frequencies, is lost.
NoisyView TofPhysics(const TofModel& model, const NoiseInput& input, std::uint64_t device_seed,
                     RandomStream& random);

/// Two pictures of the textured scene under the projector's dots, of a pair that is calibrated but
/// nearly, matched block by block.
NoisyView StereoPhysics(const StereoModel& model, const NoiseInput& input,
                        std::uint64_t device_seed, RandomStream& random);

}  // namespace volalign
