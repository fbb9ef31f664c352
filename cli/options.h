#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace volalign {

/// Options that are the same in every sub-command and stand for a key of its configuration. Add
/// them after --set, which would otherwise replace what they assign.
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
