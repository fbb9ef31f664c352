#pragma once

#include <string>

#include "render/depth_renderer.h"
#include "render/egl/egl_context.h"
#include "render/sample_config.h"

namespace volalign {

/// OpenGL renderers, each with its own context. Cameras with distortion are drawn by tiles.
RendererFactory GlRenderers(const EglContextOptions& options = {});

/// A chosen renderer.
struct Renderers {
  RendererKind kind;        ///< kEgl or kCpu
  std::string description;  ///< for people
  RendererFactory make;
};

/// Makes the renderer for SampleConfig::renderer. kEgl draws by OpenGL with `options`, and kCpu by
/// tiles. kAuto takes kCpu if OpenGL is software or does not work. It also takes kCpu if
/// `cuda_trains`: the first GPU, which OpenGL would use, is then busy with a step whenever a sample
/// is drawn. Throws IoError for kEgl if it does not work.
Renderers ChooseRenderers(RendererKind renderer, const EglContextOptions& options = {},
                          bool cuda_trains = false);

}  // namespace volalign
