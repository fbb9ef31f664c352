#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "core/config/config.h"
#include "render/egl/renderers.h"

namespace volalign {

/// The file, or none if the name is empty, with KEY=VALUE over it. Throws as ConfigSource.
inline ConfigSource ReadSource(const std::string& file,
                               const std::vector<std::string>& assignments) {
  ConfigSource source = file.empty() ? ConfigSource() : ConfigSource::FromFile(file);
  for (const std::string& assignment : assignments) source.Set(assignment);
  return source;
}

/// Adds --set KEY=VALUE for `file`, "the rig".
inline void AddSet(CLI::App* app, std::vector<std::string>* assignments, const std::string& file) {
  app->add_option("--set", *assignments, "KEY=VALUE: replaces a value of " + file)->take_all();
}

/// The same, and --threads and --device, which stand for keys of the configuration that begin with
/// `group`. They come after --set, which would otherwise replace their values.
inline void AddSettings(CLI::App* app, std::vector<std::string>* assignments,
                        const std::string& file, const std::string& group,
                        const std::string& threads) {
  AddSet(app, assignments, file);
  const auto add = [&](const std::string& name, const char* type, const std::string& text) {
    const auto assign = [key = group + name, assignments](const std::string& value) {
      assignments->push_back(key + "=" + value);
    };
    app->add_option_function<std::string>("--" + name, assign,
                                          fmt::format("{}; {}{} of the config", text, group, name))
        ->type_name(type);
  };
  add("threads", "INT", threads);
  add("device", "TEXT", "cpu, cuda or cuda:N");
}

/// --renderer and --egl-device.
struct RendererOptions {
  std::string renderer;
  int egl_device = -1;

  void AddTo(CLI::App* app) {
    app->add_option("--renderer", renderer,
                    "egl, cpu or auto; see data.renderer (docs/config.md). Without it: that of the "
                    "recipe, and egl for a rig")
        ->check(CLI::IsMember(WordsOfAll<RendererKind>()));
    app->add_option("--egl-device", egl_device,
                    "EGL device to use. Without it: the first that works, or software");
  }
  /// `kind` unless --renderer names another one.
  Renderers Choose(RendererKind kind = RendererKind::kEgl) const {
    FromWord(renderer, &kind);
    return ChooseRenderers(kind, {egl_device});
  }
};

}  // namespace volalign
