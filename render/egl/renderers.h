#pragma once

#include <string>

#include "render/depth_renderer.h"
#include "render/egl/egl_context.h"

namespace volalign {

/// OpenGL renderers, each with its own context.
RendererFactory GlRenderers(const EglContextOptions& options = {});

/// A chosen renderer.
struct Renderers {
  std::string name;         ///< "egl" or "cpu"
  std::string description;  ///< for people
  RendererFactory make;
};

/// Makes the renderer for SampleConfig::renderer. `egl` draws by OpenGL with `options`, and `cpu`
/// by tiles. `auto` takes cpu if OpenGL is software or does not work. It also takes cpu if
/// `cuda_trains`: the first GPU, which OpenGL would use, is then busy with a step whenever a sample
/// is drawn. Throws IoError for `egl` if it does not work, Error for another name.
Renderers ChooseRenderers(const std::string& renderer, const EglContextOptions& options = {},
                          bool cuda_trains = false);

}  // namespace volalign
