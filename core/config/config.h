#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/config/config_word.h"

namespace volalign {

/// Configuration: plain structs with defaults, which describe their keys once.
///
/// ```cpp
/// struct OptimizerConfig {
///   double lr = 2e-4;
///   template <class Archive>
///   void Describe(Archive& ar) {
///     ar("lr", lr, "initial learning rate", AtLeast(0));
///   }
/// };
/// ```
///
/// From that description they are read, checked, written back in full, and documented. Unknown or
/// duplicate keys are errors that name file, line and the nearest known key.

/// A condition on a number or string; `text` completes "KEY = VALUE violates KEY ...".
struct Constraint {
  std::string text;
  std::function<bool(double)> number;
  std::function<bool(const std::string&)> word;
  std::string former_name = "";   ///< no condition, but a name that the key had: see FormerlyNamed
  std::string removed_name = "";  ///< no condition, but a key that is gone: see Removed
  std::string instead = "";       ///< what does its work
  std::optional<std::vector<std::string>> harmless = std::nullopt;  ///< see Removed
  bool required = false;                                            ///< see Required
};
Constraint Above(double low);
Constraint AtLeast(double low);
Constraint Between(double low, double high);  ///< closed interval
Constraint OneOf(std::vector<std::string> words);
/// The key has no default. A file without it is in error.
Constraint Required();
/// The key or group is also read under this name. A warning on stderr names the present one. Files
/// that give both are in error.
Constraint FormerlyNamed(std::string name);
/// A key of the same group that was removed. A file that gives it is in error. `instead` says in a
/// sentence which key or mechanism replaces it. `harmless`: a value without effect, which saved
/// configurations have; it is ignored.
Constraint Removed(std::string name, std::string instead,
                   std::optional<std::vector<std::string>> harmless = std::nullopt);
/// Removed, for a key that was a number and has one value now.
Constraint Fixed(std::string name, double value);

/// The leaves of a YAML document, flattened: "train.lr" -> {"2e-4", "configs/a.yaml:12"}. Sequences
/// of scalars are one leaf. Sequences of maps become "sensors[0].name", sequences of sequences
/// "intrinsics[0]".
class ConfigSource {
 public:
  struct Leaf {
    std::vector<std::string> values;
    bool is_sequence = false;
    std::string where;  ///< "file:line", or what Set calls it
  };

  ConfigSource() = default;
  /// Reads a YAML file. A top-level key `inherits` names files, relative to the file or in the data
  /// folder, that are read first, in order. Later values override earlier ones leaf by leaf. Throws
  /// IoError, or ConfigError for bad YAML, duplicate keys or a cycle of inheritance.
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

  const std::map<std::string, Leaf>& leaves() const { return leaves_; }
  /// The first leaf of a key, a group or a list; null if there is none.
  const std::pair<const std::string, Leaf>* Find(const std::string& key) const;
  /// "file:line" of the key, or else of the group around it.
  std::string WhereOf(std::string key) const;

 private:
  void Merge(const ConfigSource& over);
  std::map<std::string, Leaf> leaves_;
  std::string name_;
  friend class ConfigReader;
};

namespace config_internal {
template <class T>
struct IsScalar : std::bool_constant<std::is_arithmetic_v<T> || std::is_same_v<T, std::string>> {};
template <class T>
struct IsVector : std::false_type {};
template <class T>
struct IsVector<std::vector<T>> : std::true_type {};
template <class T>
struct IsArray : std::false_type {};
template <class T, std::size_t N>
struct IsArray<std::array<T, N>> : std::true_type {};

std::string NumberText(double value);  // the shortest that reads back exactly
template <class T>
std::string ScalarText(const T& value) {
  if constexpr (std::is_same_v<T, bool>) {
    return value ? "true" : "false";
  } else if constexpr (std::is_same_v<T, std::string>) {
    return value;
  } else if constexpr (std::is_integral_v<T>) {
    return std::to_string(value);
  } else {
    return NumberText(static_cast<double>(value));
  }
}
/// Throw ConfigError with key, value and place if the text is of another type.
bool ParseBool(const std::string& text, const std::string& key, const std::string& where);
std::int64_t ParseInt(const std::string& text, const std::string& key, const std::string& where);
double ParseDouble(const std::string& text, const std::string& key, const std::string& where);
/// Throws ConfigError unless low <= value <= high, the limits of the key's own type.
void CheckRange(std::int64_t value, std::int64_t low, std::uint64_t high, const std::string& key,
                const std::string& where);
template <class T>
T ParseScalar(const std::string& text, const std::string& key, const std::string& where) {
  if constexpr (std::is_same_v<T, bool>) {
    return ParseBool(text, key, where);
  } else if constexpr (std::is_same_v<T, std::string>) {
    return text;
  } else if constexpr (std::is_integral_v<T>) {
    const std::int64_t value = ParseInt(text, key, where);
    CheckRange(value, static_cast<std::int64_t>(std::numeric_limits<T>::min()),
               static_cast<std::uint64_t>(std::numeric_limits<T>::max()), key, where);
    return static_cast<T>(value);
  } else {
    return static_cast<T>(ParseDouble(text, key, where));
  }
}
/// Checks a number, or a word if there is no number.
void Check(const std::string& text, std::optional<double> number,
           const std::vector<Constraint>& constraints, const std::string& key,
           const std::string& where);
template <class T>
void CheckScalar(const T& value, const std::vector<Constraint>& constraints, const std::string& key,
                 const std::string& where) {
  std::optional<double> number;
  if constexpr (!std::is_same_v<T, std::string>) number = static_cast<double>(value);
  Check(ScalarText(value), number, constraints, key, where);
}
}  // namespace config_internal

/// Fills a struct from a source; remembers which keys exist.
class ConfigReader {
 public:
  /// Without `complete`, Required keys may be missing.
  explicit ConfigReader(const ConfigSource& source, bool complete = true)
      : source_(source), complete_(complete) {}

  template <class T, class... C>
  void operator()(const std::string& name, T& value, const char* /*doc*/, const C&... constraints) {
    const std::vector<Constraint> checks{constraints...};
    if (const std::optional<std::string> in_source = NameInSource(name, checks))
      Value(prefix_ + *in_source, value, checks);
  }

  /// Throws ConfigError for the first key of the source that no struct described, then for a
  /// required one that is missing: it may be misspelled.
  void RejectUnknown() const;

 private:
  template <class T>
  void Value(const std::string& key, T& value, const std::vector<Constraint>& checks) {
    using namespace config_internal;
    if constexpr (std::is_enum_v<T>) {
      std::string word = ToString(value);
      Value(key, word, {OneOf(WordsOfAll<T>())});
      FromWord(word, &value);
    } else if constexpr (IsScalar<T>::value) {
      const auto* leaf = Find(key, false);
      if (leaf) value = ParseScalar<T>(leaf->values.at(0), key, leaf->where);
      CheckScalar(value, checks, key, leaf ? leaf->where : "default");
    } else if constexpr (IsArray<T>::value || IsVector<T>::value) {
      using Item = typename T::value_type;
      if constexpr (IsScalar<Item>::value) {
        const auto* leaf = Find(key, true);
        if (leaf) {
          if constexpr (IsVector<T>::value) value.resize(leaf->values.size());
          RequireSize(*leaf, value.size(), key);
          for (std::size_t i = 0; i < value.size(); ++i)
            value[i] = ParseScalar<Item>(leaf->values[i], key, leaf->where);
        }
        for (const auto& x : value)
          CheckScalar<Item>(x, checks, key, leaf ? leaf->where : "default");
      } else {
        if (IsEmptyList(key)) value.clear();
        const int n = CountItems(key);
        if (n > 0) value.assign(static_cast<std::size_t>(n), Item());
        for (std::size_t i = 0; i < value.size(); ++i)
          Value(key + "[" + std::to_string(i) + "]", value[i], checks);
      }
    } else {
      Nested(key + ".", value);
    }
  }
  template <class T>
  void Nested(const std::string& prefix, T& value) {
    const std::string saved = prefix_;
    prefix_ = prefix;
    value.Describe(*this);
    prefix_ = saved;
  }
  /// `name`, or a former name that the source uses; nothing if it is required and missing.
  std::optional<std::string> NameInSource(const std::string& name,
                                          const std::vector<Constraint>& checks);
  const ConfigSource::Leaf* Find(const std::string& key, bool sequence);
  static void RequireSize(const ConfigSource::Leaf& leaf, std::size_t size, const std::string& key);
  bool IsEmptyList(const std::string& key);
  /// Throws ConfigError unless the items' indices are 0, 1, ... without a gap.
  int CountItems(const std::string& key) const;

  const ConfigSource& source_;
  const bool complete_;
  std::set<std::string> known_;
  std::string missing_;  // about the first required key that is missing
  std::string prefix_;
};

/// Writes a struct as YAML with every key and its value (the resolved configuration). Or writes a
/// list in Markdown, one item per key: name, default, constraint, meaning.
class ConfigWriter {
 public:
  enum class Form { kYaml, kMarkdown };
  explicit ConfigWriter(Form form = Form::kYaml) : form_(form) {}

  template <class T, class... C>
  void operator()(const std::string& name, T& value, const char* doc, const C&... constraints) {
    using namespace config_internal;
    const std::vector<Constraint> checks{constraints...};
    if constexpr (std::is_enum_v<T>) {
      Leaf(name, Word(ToString(value)), doc, {OneOf(WordsOfAll<T>())});
    } else if constexpr (IsScalar<T>::value) {
      Leaf(name, Text(value), doc, checks);
    } else if constexpr (IsArray<T>::value || IsVector<T>::value) {
      using Item = typename T::value_type;
      if constexpr (IsScalar<Item>::value) {
        std::string list = "[";
        for (const Item& item : value) list += (&item == &value[0] ? "" : ", ") + Text(item);
        Leaf(name, list + "]", doc, checks);
      } else if (form_ == Form::kMarkdown) {
        Item item;
        Group(name + "[].", item);
      } else if (value.empty()) {
        Leaf(name, "[]", doc, checks);
      } else {
        Line(name + ":");
        for (Item& item : value) Group("  - ", item);
      }
    } else if (form_ == Form::kMarkdown) {
      Group(name + ".", value);
    } else {
      Line(name + ":");
      Group("  ", value);
    }
  }

  const std::string& text() const { return text_; }

 private:
  template <class T>
  std::string Text(const T& value) const {
    if constexpr (std::is_same_v<T, std::string>) return Word(value);
    return config_internal::ScalarText(value);
  }
  /// In quotes, in YAML.
  std::string Word(const std::string& word) const;
  /// Writes a described object behind `begin`.
  template <class T>
  void Group(const std::string& begin, T& value) {
    const std::string outer = begin_;
    begin_ += begin;
    value.Describe(*this);
    begin_ = outer;
  }
  void Line(const std::string& text);
  void Leaf(const std::string& name, const std::string& value, const char* doc,
            const std::vector<Constraint>& checks);

  Form form_;
  std::string text_;
  std::string begin_;  ///< of lines: in YAML with the dash of an item in its first; else of keys
};

/// Reads and checks a whole struct; unknown keys are errors.
template <class T>
T ReadConfig(const ConfigSource& source, T config = T()) {
  ConfigReader reader(source);
  config.Describe(reader);
  reader.RejectUnknown();
  return config;
}

/// The resolved config as YAML; ReadConfig of it gives an equal struct.
template <class T>
std::string WriteConfig(T config) {
  ConfigWriter writer;
  config.Describe(writer);
  return writer.text();
}

/// List in Markdown of all keys with defaults, constraints and meanings (docs/config.md).
template <class T>
std::string DocumentConfig(T config = T()) {
  ConfigWriter writer(ConfigWriter::Form::kMarkdown);
  config.Describe(writer);
  return writer.text();
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
  ConfigSource empty;
  ConfigReader reader(empty, /*complete=*/false);
  config.Describe(reader);
}

/// The known keys, joined by "' or '", whose last part, or a word of it, is nearest to that of
/// `key`.
std::string NearestKey(const std::string& key, const std::vector<std::string>& known);

}  // namespace volalign
