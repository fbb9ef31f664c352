#include "infer/evaluate/suite/suite_config.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <set>

#include "core/base/error.h"

namespace volalign {

namespace {

/// Names of items, which become names of files.
template <class T>
std::set<std::string> UniqueNames(const std::vector<T>& items, const char* what) {
  std::set<std::string> names;
  for (const T& item : items) {
    const bool plain = std::all_of(item.name.begin(), item.name.end(), [](unsigned char c) {
      return std::isalnum(c) || c == '_' || c == '-';
    });
    if (item.name.empty() || !plain) {
      throw ConfigError(fmt::format("{}: the name \"{}\" is not made of letters, digits, _ and -",
                                    what, item.name));
    }
    if (!names.insert(item.name).second)
      throw ConfigError(fmt::format("{}: {} stands twice; names are unique", what, item.name));
  }
  return names;
}

void RequireKnown(const std::set<std::string>& known, const std::string& name,
                  const std::string& where) {
  if (known.count(name)) return;
  throw ConfigError(
      fmt::format("{} names \"{}\", which there is not: {}", where, name, fmt::join(known, ", ")));
}

void CheckNames(const SuiteConfig& suite) {
  const std::set<std::string> datasets = UniqueNames(suite.datasets, "datasets");
  const std::set<std::string> methods = UniqueNames(suite.methods, "methods");
  UniqueNames(suite.tables, "tables");
  for (const SuiteMethod& method : suite.methods) {
    for (const std::string& name : method.datasets) RequireKnown(datasets, name, method.name);
  }
  for (const SuiteTable& table : suite.tables) {
    for (const SuiteBlock& block : table.blocks) {
      for (const std::string& name : block.datasets) RequireKnown(datasets, name, table.name);
    }
    for (const SuiteRow& row : table.rows) {
      RequireKnown(methods, row.method, table.name);
      if (!row.paper.empty() && row.paper.size() != 4 * table.blocks.size()) {
        throw ConfigError(
            fmt::format("{}, row {}: paper has {} cells; 4 for each of {} blocks are expected",
                        table.name, row.label, row.paper.size(), table.blocks.size()));
      }
    }
  }
}

}  // namespace

bool IsApplicable(const SuiteMethod& method, const std::string& dataset) {
  return method.datasets.empty() || std::find(method.datasets.begin(), method.datasets.end(),
                                              dataset) != method.datasets.end();
}

SuiteConfig ReadSuite(const std::string& path) {
  SuiteConfig suite = ReadConfig<SuiteConfig>(ConfigSource::FromFile(path));
  CheckNames(suite);
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  const auto resolve = [&](std::string* file) {
    if (!file->empty()) *file = (folder / *file).lexically_normal().string();
  };
  for (SuiteDataset& dataset : suite.datasets) {
    for (std::string& rig : dataset.rigs) resolve(&rig);
    for (std::string& capture : dataset.captures) resolve(&capture);
  }
  for (SuiteMethod& method : suite.methods) resolve(&method.model);
  return suite;
}

SuiteConfig SelectTables(SuiteConfig suite, const std::string& name) {
  std::set<std::string> names, datasets, methods;
  for (const SuiteTable& table : suite.tables) names.insert(table.name);
  if (name != "all" && !names.count(name)) {
    throw ConfigError(
        fmt::format("--suite {}: there are {} and all", name, fmt::join(names, ", ")));
  }
  const auto erase = [](auto* items, const auto& keep) {
    items->erase(std::remove_if(items->begin(), items->end(),
                                [&](const auto& item) { return !keep(item.name); }),
                 items->end());
  };
  erase(&suite.tables, [&](const std::string& n) { return name == "all" || n == name; });
  for (const SuiteTable& table : suite.tables) {
    for (const SuiteBlock& block : table.blocks)
      datasets.insert(block.datasets.begin(), block.datasets.end());
    for (const SuiteRow& row : table.rows) methods.insert(row.method);
  }
  if (name == "all") return suite;
  erase(&suite.datasets, [&](const std::string& n) { return datasets.count(n) > 0; });
  erase(&suite.methods, [&](const std::string& n) { return methods.count(n) > 0; });
  return suite;
}

}  // namespace volalign
