#pragma once

#include <string>

#include "render/depth_renderer.h"
#include "render/egl/egl_context.h"

namespace volalign {

/// A renderer that was chosen.
struct Renderers {
  std::string name;         ///< "egl" or "cpu"
  std::string description;  ///< for people
  RendererFactory make;
};

/// Carries out SampleConfig::renderer. `egl` draws by OpenGL, which `options` are for, and `cpu` by
/// tiles. `auto` takes cpu where OpenGL is software or does not work, and where `cuda_trains`: the
/// first GPU, which OpenGL would draw on, is then busy with a step whenever a sample is drawn.
/// Throws IoError for `egl` where it does not work, Error for another name.
Renderers ChooseRenderers(const std::string& renderer, const EglContextOptions& options = {},
                          bool cuda_trains = false);

}  // namespace volalign
