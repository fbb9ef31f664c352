#include "render/egl/renderers.h"

#include <fmt/format.h>

#include "core/base/error.h"
#include "render/tiles/tile_renderer.h"

namespace volalign {
namespace {

Renderers Tiles(const std::string& why) {
  const std::string reason = why.empty() ? "" : fmt::format(" (auto: {})", why);
  return {RendererKind::kCpu,
          fmt::format("cpu, tiles on the processor, {}{}", tiles::AllKernels().Best().name, reason),
          TileRenderers()};
}

}  // namespace

Renderers ChooseRenderers(RendererKind renderer, const EglContextOptions& options,
                          bool cuda_trains) {
  if (renderer == RendererKind::kCpu) return Tiles("");
  const bool is_auto = renderer == RendererKind::kAuto;
  if (is_auto && cuda_trains) return Tiles("training has the GPU");
  try {
    const EglContext egl(options);
    if (is_auto && egl.IsSoftware()) return Tiles("OpenGL is software");
    return {RendererKind::kEgl, "egl, " + egl.Describe(), GlRenderers(options)};
  } catch (const IoError&) {
    if (!is_auto) throw;
    return Tiles("no OpenGL");
  }
}

}  // namespace volalign
