#include "render/noise_models.h"

#include <algorithm>
#include <cmath>

#include "core/base/noise_fields.h"

namespace volalign {

NoisyView PaperNoise(const NoiseConfig& config, const NoiseInput& input, RandomStream& random) {
  constexpr float kDepthEdge = 0.05F;  // m, between boxes that overlap in the image
  const RenderedView& view = input.view;
  const int width = view.depth.width(), height = view.depth.height();
  Image<std::uint8_t> keep(width, height, 1);
  const Image<float> roughness = SmoothField(width, height, 8, random);
  const double border = random.Uniform(0, config.paper_border_px);
  const auto on_structure = [&](int u, int v) {
    const std::uint16_t face = view.faces(u, v);
    return face > 0 &&
           input.mesh.objects[static_cast<std::size_t>(input.mesh.faces[face - 1U].object)]
               .is_structure;
  };
  Image<std::uint8_t> structure(width, height);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) structure(u, v) = on_structure(u, v);
  }
  const auto edge = [&](int u, int v, int p, int q) {
    if (structure(u, v) != structure(p, q)) return true;
    return structure(u, v) && std::abs(view.depth(u, v) - view.depth(p, q)) > kDepthEdge;
  };
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      if ((u + 1 < width && edge(u, v, u + 1, v)) || (v + 1 < height && edge(u, v, u, v + 1))) {
        const double r = border * (1 + 0.4 * roughness(u, v));
        if (r > 0) ClearDisc(u + 0.5, v + 0.5, r, &keep);
      }
    }
  }
  for (std::size_t i = 0; i < keep.size(); ++i) {
    if (!structure[i]) keep[i] = 1;
  }
  const int holes = DrawPoisson(config.paper_hole_count, random);
  for (int i = 0; i < holes; ++i) {
    const double u = random.Uniform(0, width), v = random.Uniform(0, height);
    const double a = config.paper_hole_radius_px * random.Uniform(0.3, 1.7);
    const double b = config.paper_hole_radius_px * random.Uniform(0.3, 1.7);
    const double angle = random.Uniform(0, M_PI);
    if (a > 0 && b > 0) ClearEllipse(u, v, a, b, angle, &keep);
  }
  NoisyView out{view.depth, view.labels};
  for (std::size_t i = 0; i < keep.size(); ++i) {
    if (keep[i]) continue;
    out.depth[i] = 0;
    out.labels[i] = 0;
  }
  return out;
}

}  // namespace volalign
