#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "core/config/config.h"

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

}  // namespace volalign
