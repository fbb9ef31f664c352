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

/// Adds an option that stands for a key of the configuration in every sub-command. Call it after
/// --set, which would otherwise replace its value.
inline void AddAssignment(CLI::App* app, const std::string& option, const std::string& key,
                          std::vector<std::string>* assignments, const std::string& text) {
  app->add_option_function<std::string>(
         option,
         [key, assignments](const std::string& value) {
           assignments->push_back(key + "=" + value);
         },
         fmt::format("{}; {} of the config", text, key))
      ->type_name(option == "--threads" ? "INT" : "TEXT");
}

}  // namespace volalign
