#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/config/archive.h"

namespace YAML {
class Node;
}  // namespace YAML

namespace volalign {

/// The tree of a YAML document, with the place of each value. Maps are objects, sequences are
/// arrays, and every scalar is a string. "train.lr" is the key `lr` of the group `train`. A file
/// may write it so, too. "sensors[0].name" is a key of an item.
class ConfigSource {
 public:
  ConfigSource() = default;
  /// Reads a YAML file. A top-level key `inherits` names files, relative to the file or in the data
  /// folder, that are read first, in order. Later values override earlier ones key by key, lists as
  /// a whole. Throws IoError, or ConfigError for bad YAML, duplicate keys or a cycle of
  /// inheritance.
  static ConfigSource FromFile(const std::string& path);
  static ConfigSource FromString(const std::string& yaml, const std::string& name);
  /// The maps of a document that is a list of maps. Throws ConfigError.
  static std::vector<ConfigSource> ListFromString(const std::string& yaml, const std::string& name);
  /// Sets `key=value`, value in YAML's flow syntax: "train.lr=1e-3", "pose.rho_cm=[150, 225]",
  /// "sensors=[{name: A}]", "train={lr: 1e-3}". `where` is its place in messages. Throws
  /// ConfigError.
  void Set(const std::string& assignment, const std::string& where = "--set");
  /// The leaves whose keys begin with one of these.
  ConfigSource Only(const std::vector<std::string>& beginnings) const;

  const nlohmann::json& tree() const { return tree_; }
  /// Scalars and lists of them, with their keys.
  std::vector<std::pair<std::string, nlohmann::json>> Leaves() const;
  /// The value of a key, a group or a list; null if there is none.
  const nlohmann::json* Find(const std::string& key) const;
  /// "file:line" of the key, or else of the group around it.
  std::string WhereOf(const std::string& key) const;

 private:
  void Fill(const YAML::Node& node, const std::string& file, const std::string& where);
  void Put(const std::string& key, const nlohmann::json& tree, const nlohmann::json& places);

  nlohmann::json tree_ = nlohmann::json::object();
  /// The place of a value is at its key "", that of an item at "[0".
  nlohmann::json places_ = {{"", ""}};
};

/// The leaves of a tree below a key: scalars and lists of them.
std::vector<std::pair<std::string, nlohmann::json>> LeavesOf(const nlohmann::json& tree,
                                                             const std::string& key = "");
/// A leaf's scalars.
std::vector<std::string> LeafTexts(const nlohmann::json& leaf);
/// A leaf in YAML's flow syntax, a text without quotes.
std::string FlowText(const nlohmann::json& leaf);

/// Writes a list in Markdown, one item per key: name, default, constraint, meaning.
class KeyLister {
 public:
  static constexpr bool kReading = false;

  template <class T, class... C>
  void operator()(const std::string& name, T& value, const char* meaning, const C&... constraints) {
    using namespace archive_internal;
    const std::vector<Constraint> checks{constraints...};
    if constexpr (std::is_enum_v<T>) {
      Leaf(name, ToString(value), meaning, {OneOf(WordsOfAll<T>())});
    } else if constexpr (kIsScalar<T>) {
      Leaf(name, value, meaning, checks);
    } else if constexpr (kIsArray<T> || kIsVector<T>) {
      typename T::value_type item{};
      if constexpr (kIsScalar<typename T::value_type>) {
        Leaf(name, value, meaning, checks);
      } else {
        Group(name + "[].", item);
      }
    } else {
      Group(name + ".", value);
    }
  }

  const std::string& text() const { return text_; }

 private:
  template <class T>
  void Group(const std::string& name, T& value) {
    const std::string outer = prefix_;
    prefix_ += name;
    Describe(*this, value);
    prefix_ = outer;
  }
  void Leaf(const std::string& name, const nlohmann::json& value, const char* meaning,
            const std::vector<Constraint>& checks);

  std::string text_, prefix_;
};

/// Reads and checks a whole struct; unknown keys are errors.
template <class T>
T ReadConfig(const ConfigSource& source, T config = T()) {
  ConfigKeys keys{source};
  archive_internal::Read(&source.tree(), ValuePlace{"", &keys}, config);
  keys.RejectUnknown();
  return config;
}

/// A tree as YAML: texts in quotes, lists of scalars in brackets.
std::string YamlText(const nlohmann::ordered_json& tree);

/// The resolved config as YAML; ReadConfig of it gives an equal struct.
template <class T>
std::string WriteConfig(T config) {
  return YamlText(archive_internal::ToJson(config, "configuration"));
}

/// List in Markdown of all keys with defaults, constraints and meanings (docs/config.md).
template <class T>
std::string DocumentConfig(T config = T()) {
  KeyLister lister;
  Describe(lister, config);
  return lister.text();
}

/// A key with other values in two configurations; a list's are joined by ", ".
struct ConfigDifference {
  std::string key, before, now;
};
/// Compares two outputs of WriteConfig, in the order of the keys of `now`. A key that `before`
/// lacks has "nothing".
std::vector<ConfigDifference> FindDifferences(const std::string& before, const std::string& now);

/// Checks a struct that was filled in code. Throws ConfigError as reading does.
template <class T>
void ValidateConfig(T config) {
  const ConfigSource empty;
  ConfigKeys keys{empty, /*complete=*/false};
  archive_internal::Read(&empty.tree(), ValuePlace{"", &keys}, config);
}

/// The known keys, joined by "' or '", whose last part, or a word of it, is nearest to that of
/// `key`.
std::string NearestKey(const std::string& key, const std::vector<std::string>& known);

}  // namespace volalign
