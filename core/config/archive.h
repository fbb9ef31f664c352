#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "core/config/config_word.h"

namespace volalign {

/// Structured text: a struct describes its keys once. From that description it is read from YAML or
/// JSON, checked, written, and documented.
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
/// A struct that has to be independent of files is described by a free template
/// Describe(ar, value) in namespace volalign, beside the code that reads and writes it.
///
/// An unknown key is an error that names the nearest known one. All archives have:
///
/// ```cpp
/// ar(key, value, meaning, constraints)  // a key with a default, which may be absent
/// ar(key, value)                        // a key that every file has
/// ar.Optional(key, value)               // absent if it has no value, is empty or equals T()
/// ar.OptionalSinceVersion(key, value)   // always written; unchanged if an earlier file lacks it
/// ar.IfFinite(key, value)               // numbers (double, Eigen, Pose); an absent key is NaN
/// ar.IfFinite(key, value, absent)       // an absent key is `absent`
/// ar.Constant(key, text)                // the same text in every file; any other is an error
/// ar.WriteOnly(key, value)              // written for the file's other readers, not read
/// ar.OneOrList(key, texts)              // absent, a string or a list
/// ar.ByName(key, items, &Item::name)    // an object of the items by their names
/// Archive::kReading, ar.where()
/// ```
///
/// Values may be bool, numbers, std::string and enums with ToString(value) and AllOf(value). Also
/// Eigen vectors (a list) and matrices (a list of rows), described structs, and vectors, arrays and
/// pairs (a list of two) of all these. Also std::map<std::string, T> and
/// std::vector<std::pair<std::string, T>> (an object), and nlohmann::json (any value).

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

class ConfigSource;

/// The keys that structs ask of a configuration, in all of its groups.
struct ConfigKeys {
  const ConfigSource& source;
  bool complete = true;              ///< false: Required keys may be missing
  std::set<std::string> known = {};  ///< "train.lr"
  std::string missing = "";          ///< about the first one without a default that is missing

  /// Throws ConfigError for the first key of the source that no struct described, as it may be
  /// misspelled. Then for a missing one that is required, or whose default violates a constraint.
  void RejectUnknown() const;
};

/// The place of a value, for messages.
struct ValuePlace {
  std::string name;              ///< a configuration's key, or "capture.json: sensors[0]"
  ConfigKeys* config = nullptr;  ///< of YAML, where any scalar is a string of the tree; null: JSON

  ValuePlace At(const std::string& key) const;
  ValuePlace At(std::size_t index) const;
  /// Throws ConfigError or DataError with the place, the value as it is shown, and the problem.
  [[noreturn]] void Fail(const std::string& shown, const std::string& problem) const;
  [[noreturn]] void Fail(const nlohmann::json& value, const std::string& problem) const;
};

/// A value for a message: as JSON, and Shortened.
std::string ShownJson(const nlohmann::json& value);

/// Read one value. Throw ConfigError or DataError with the place, the value and the expected type.
/// A whole number may be written as 3.0.
void ReadValue(const nlohmann::json& json, const ValuePlace& place, bool* value);
void ReadValue(const nlohmann::json& json, const ValuePlace& place, double* value);
void ReadValue(const nlohmann::json& json, const ValuePlace& place, std::string* value);
/// The bits of a number from `low` to `high`.
std::uint64_t ReadWhole(const nlohmann::json& json, const ValuePlace& place, std::int64_t low,
                        std::uint64_t high);
template <class T, class = std::enable_if_t<std::is_integral_v<T>>>
void ReadValue(const nlohmann::json& json, const ValuePlace& place, T* value) {
  using Limits = std::numeric_limits<T>;
  *value = static_cast<T>(ReadWhole(json, place, static_cast<std::int64_t>(Limits::min()),
                                    static_cast<std::uint64_t>(Limits::max())));
}

template <class Archive, class T>
void Describe(Archive& ar, T& value) {
  value.Describe(ar);
}

/// Specialised for a type that is written as another one, `Type`. It has `static Type Of(const T&)`
/// and `static T From(const Type&, const std::string& place)`, which may throw DataError.
template <class T>
struct StoredAs {};

namespace archive_internal {

using OrderedJson = nlohmann::ordered_json;

template <class T>
inline constexpr bool kIsScalar = std::is_arithmetic_v<T> || std::is_same_v<T, std::string>;
template <class T>
inline constexpr bool kIsMatrix = std::is_base_of_v<Eigen::MatrixBase<T>, T>;
template <class T, class = void>
inline constexpr bool kIsStored = false;
template <class T>
inline constexpr bool kIsStored<T, std::void_t<typename StoredAs<T>::Type>> = true;
template <class T>
inline constexpr bool kIsOptional = false;
template <class T>
inline constexpr bool kIsOptional<std::optional<T>> = true;
template <class T>
inline constexpr bool kIsVector = false;
template <class T>
inline constexpr bool kIsVector<std::vector<T>> = true;
template <class T>
inline constexpr bool kIsArray = false;
template <class T, std::size_t N>
inline constexpr bool kIsArray<std::array<T, N>> = true;
template <class T>
inline constexpr bool kIsPair = false;
template <class First, class Second>
inline constexpr bool kIsPair<std::pair<First, Second>> = true;
/// Containers that are objects in files.
template <class T>
inline constexpr bool kIsDictionary = false;
template <class T>
inline constexpr bool kIsDictionary<std::map<std::string, T>> = true;
template <class T>
inline constexpr bool kIsDictionary<std::vector<std::pair<std::string, T>>> = true;

/// The numbers of a double, an Eigen type or a Pose, as an Eigen expression.
template <class T>
decltype(auto) NumbersOf(T& value) {
  if constexpr (std::is_same_v<T, double>) {
    return Eigen::Map<Eigen::Matrix<double, 1, 1>>(&value);
  } else {
    return (value.matrix());
  }
}

/// Returns the value. Throws Error unless it is finite.
double Finite(double value, const std::string& place);
/// Checks a number, or a word if there is no number.
void Check(const std::string& text, std::optional<double> number,
           const std::vector<Constraint>& constraints, const ValuePlace& place);
/// A list of `count` items, or of any number. In YAML a single value is a list of one: `one`, then.
constexpr std::size_t kAny = static_cast<std::size_t>(-1);
const nlohmann::json& Items(const nlohmann::json& json, const ValuePlace& place,
                            nlohmann::json* one, std::size_t count, const char* what = "values");
const nlohmann::json& NoKeys();
/// Whatever keys are in the value, they are known.
void KnowAll(const nlohmann::json& value, const ValuePlace& place);
[[noreturn]] void FailNotOneOf(const nlohmann::json& json, const std::vector<std::string>& known,
                               const ValuePlace& place);

template <class T>
OrderedJson ToJson(T& value, const std::string& place);
/// Without `json`, checks the value that is there.
template <class T>
void Read(const nlohmann::json* json, const ValuePlace& place, T& value,
          const std::vector<Constraint>& checks = {});

template <class T>
bool HasValue(const T& value) {
  if constexpr (kIsOptional<T>) {
    return value.has_value();
  } else if constexpr (kIsVector<T>) {
    return !value.empty();
  } else {
    return !(value == T());
  }
}

}  // namespace archive_internal

/// A number or text for a message or a table: the shortest that reads back exactly.
std::string ScalarText(const nlohmann::json& value);

/// An object that remembers which keys were asked for. It fills a struct that describes itself, or
/// is read key by key. All functions throw with the place and the expected value. The document must
/// outlive it.
class ObjectReader {
 public:
  static constexpr bool kReading = true;

  /// `where` begins every message ("capture.json: sensor 2"). Throws unless `value` is an object.
  ObjectReader(const nlohmann::json& value, const std::string& where)
      : ObjectReader(value, ValuePlace{where, nullptr}) {}
  ObjectReader(const nlohmann::json& value, ValuePlace place);

  const std::string& where() const { return place_.name; }
  /// The place of a key's value, for messages.
  std::string Place(const std::string& key) const { return place_.At(key).name; }
  /// Replaces the part after the document's name in later messages. Returns where().
  const std::string& Renamed(const std::string& part) const;

  bool Has(const std::string& key) const;
  const nlohmann::json& Get(const std::string& key) const;
  /// A value of any type that a described struct may have; numbers are finite.
  template <class T>
  T Read(const std::string& key) const {
    T value{};
    (*this)(key, value);
    return value;
  }
  std::string Text(const std::string& key) const { return Read<std::string>(key); }
  double Number(const std::string& key) const { return Read<double>(key); }
  ObjectReader Child(const std::string& key) const {
    return ObjectReader(Get(key), place_.At(key));
  }
  std::vector<ObjectReader> Children(const std::string& key) const;
  /// Keys in alphabetical order, as the parser does not keep the document's order.
  std::vector<std::string> Keys() const;

  /// Throws for the first key that was neither asked for nor tested nor is in `known`. The message
  /// has the nearest of those. ConfigKeys::RejectUnknown does it for a whole configuration.
  void RejectOthers(std::initializer_list<const char*> known = {}) const;

  template <class T>
  void operator()(const std::string& key, T& value) const {
    archive_internal::Read(&Get(key), place_.At(key), value);
  }
  template <class T, class... C>
  void operator()(const std::string& key, T& value, const char* /*meaning*/,
                  const C&... constraints) const {
    const std::vector<Constraint> checks{constraints...};
    if (const std::optional<std::string> name = NameOf(key, checks))
      archive_internal::Read(Has(*name) ? &Get(*name) : nullptr, place_.At(*name), value, checks);
  }
  template <class T>
  void Optional(const std::string& key, T& value) const {
    value = T();
    if (!Has(key)) return;
    if constexpr (archive_internal::kIsOptional<T>) {
      value.emplace();
      (*this)(key, *value);
    } else {
      (*this)(key, value);
    }
  }
  template <class T>
  void OptionalSinceVersion(const std::string& key, T& value) const {
    if (Has(key)) (*this)(key, value);
  }
  template <class T>
  void IfFinite(const std::string& key, T& value) const {
    archive_internal::NumbersOf(value).setConstant(std::numeric_limits<double>::quiet_NaN());
    OptionalSinceVersion(key, value);
  }
  template <class T>
  void IfFinite(const std::string& key, T& value, const T& absent) const {
    value = absent;
    OptionalSinceVersion(key, value);
  }
  void Constant(const std::string& key, const std::string& text) const;
  template <class T>
  void WriteOnly(const std::string& key, const T& /*value*/) const {
    Has(key);
  }
  void OneOrList(const std::string& key, std::vector<std::string>& texts) const;
  template <class T, class Named>
  void ByName(const std::string& key, std::vector<T>& items, std::string Named::*name) const {
    const ObjectReader object = Child(key);
    items.clear();
    for (const std::string& item : object.Keys()) {
      items.emplace_back().*name = item;
      object(item, items.back());
    }
  }

 private:
  /// `key`, or a former name that the object uses; nothing if it is required and missing.
  std::optional<std::string> NameOf(const std::string& key,
                                    const std::vector<Constraint>& checks) const;

  const nlohmann::json* value_;
  mutable ValuePlace place_;
  std::string document_;
  mutable std::set<std::string> known_;
};

/// Builds a JSON object from a struct.
class ObjectWriter {
 public:
  static constexpr bool kReading = false;
  explicit ObjectWriter(std::string where)
      : where_(std::move(where)), json_(nlohmann::ordered_json::object()) {}
  const std::string& where() const { return where_; }
  nlohmann::ordered_json Take() { return std::move(json_); }

  template <class T, class... Rest>
  void operator()(const std::string& key, T& value, const Rest&... /*meaning, constraints*/) {
    json_[key] = archive_internal::ToJson(value, Place(key));
  }
  template <class T>
  void Optional(const std::string& key, T& value) {
    if (!archive_internal::HasValue(value)) return;
    if constexpr (archive_internal::kIsOptional<T>) {
      (*this)(key, *value);
    } else {
      (*this)(key, value);
    }
  }
  template <class T>
  void OptionalSinceVersion(const std::string& key, T& value) {
    (*this)(key, value);
  }
  template <class T>
  void IfFinite(const std::string& key, T& value) {
    if (archive_internal::NumbersOf(value).allFinite()) (*this)(key, value);
  }
  template <class T>
  void IfFinite(const std::string& key, T& value, const T& /*absent*/) {
    IfFinite(key, value);
  }
  void Constant(const std::string& key, const std::string& text) { json_[key] = text; }
  template <class T>
  void WriteOnly(const std::string& key, T& value) {
    (*this)(key, value);
  }
  void OneOrList(const std::string& key, const std::vector<std::string>& texts);
  template <class T, class Named>
  void ByName(const std::string& key, std::vector<T>& items, std::string Named::*name) {
    nlohmann::ordered_json& object = json_[key] = nlohmann::ordered_json::object();
    for (T& item : items) {
      object[item.*name] = archive_internal::ToJson(item, Place(key) + ": " + item.*name);
    }
  }

 private:
  std::string Place(const std::string& key) const { return where_ + ": " + key; }

  std::string where_;
  nlohmann::ordered_json json_;
};

namespace archive_internal {

template <class T>
OrderedJson ToJson(T& value, const std::string& place) {
  if constexpr (std::is_floating_point_v<T>) {
    return Finite(static_cast<double>(value), place);
  } else if constexpr (kIsScalar<T> || std::is_same_v<T, nlohmann::json>) {
    return value;
  } else if constexpr (std::is_enum_v<T>) {
    return ToString(value);
  } else if constexpr (kIsStored<T>) {
    auto stored = StoredAs<T>::Of(value);
    return ToJson(stored, place);
  } else if constexpr (kIsMatrix<T>) {
    OrderedJson json = OrderedJson::array();
    for (Eigen::Index i = 0; i < value.rows(); ++i) {
      if constexpr (T::ColsAtCompileTime == 1) {
        json.push_back(Finite(value(i), place));
      } else {
        OrderedJson& row = json.emplace_back(OrderedJson::array());
        for (Eigen::Index j = 0; j < value.cols(); ++j) row.push_back(Finite(value(i, j), place));
      }
    }
    return json;
  } else if constexpr (kIsDictionary<T>) {
    OrderedJson json = OrderedJson::object();
    for (auto& [key, item] : value)
      json[key] = ToJson(item, std::string(place).append(": ").append(key));
    return json;
  } else if constexpr (kIsVector<T> || kIsArray<T>) {
    OrderedJson json = OrderedJson::array();
    for (std::size_t i = 0; i < value.size(); ++i) {
      json.push_back(ToJson(value[i], place + "[" + std::to_string(i) + "]"));
    }
    return json;
  } else if constexpr (kIsPair<T>) {
    return OrderedJson::array({ToJson(value.first, place), ToJson(value.second, place)});
  } else {
    ObjectWriter writer(place);
    Describe(writer, value);
    return writer.Take();
  }
}

template <class T>
void Read(const nlohmann::json* json, const ValuePlace& place, T& value,
          const std::vector<Constraint>& checks) {
  const auto know = [&] {
    if (place.config != nullptr) place.config->known.insert(place.name);
  };
  if constexpr (kIsScalar<T>) {
    if (!place.name.empty() && place.name.back() != ']') know();  // a list is known as a whole
    if constexpr (std::is_same_v<T, float>) {
      double number = value;
      if (json) ReadValue(*json, place, &number);
      value = static_cast<float>(number);
    } else {
      if (json) ReadValue(*json, place, &value);
    }
    if (checks.empty()) return;
    std::optional<double> number;
    if constexpr (!std::is_same_v<T, std::string>) number = static_cast<double>(value);
    Check(ScalarText(value), number, checks, place);
  } else if constexpr (std::is_same_v<T, nlohmann::json>) {
    if (json) value = *json;
    KnowAll(value, place);
  } else if constexpr (std::is_enum_v<T>) {
    know();
    if (!json) return;
    std::string text;
    ReadValue(*json, place, &text);
    if (!FromWord(text, &value)) FailNotOneOf(*json, WordsOfAll<T>(), place);
  } else if constexpr (kIsStored<T>) {
    if (!json) return;
    typename StoredAs<T>::Type stored;
    Read(json, place, stored);
    value = StoredAs<T>::From(stored, place.name);
  } else if constexpr (kIsMatrix<T>) {
    if (!json) return;
    constexpr bool kOneColumn = T::ColsAtCompileTime == 1;
    nlohmann::json one;
    const nlohmann::json& rows = Items(*json, place, &one, static_cast<std::size_t>(value.rows()),
                                       kOneColumn ? "numbers" : "rows");
    for (Eigen::Index i = 0; i < value.rows(); ++i) {
      const nlohmann::json& row = rows[static_cast<std::size_t>(i)];
      if constexpr (kOneColumn) {
        Read(&row, place.At(static_cast<std::size_t>(i)), value(i));
      } else {
        const nlohmann::json& cells =
            Items(row, place, &one, static_cast<std::size_t>(value.cols()), "columns");
        for (Eigen::Index j = 0; j < value.cols(); ++j)
          Read(&cells[static_cast<std::size_t>(j)], place, value(i, j));
      }
    }
  } else if constexpr (kIsDictionary<T>) {
    if (!json) return;
    const ObjectReader object(*json, place);
    value.clear();
    for (const std::string& key : object.Keys()) {
      value.insert(value.end(), {key, object.Read<typename T::value_type::second_type>(key)});
    }
  } else if constexpr (kIsVector<T> || kIsArray<T>) {
    know();
    nlohmann::json one;
    const nlohmann::json* items = nullptr;
    if (json) {
      items = &Items(*json, place, &one, kIsArray<T> ? value.size() : kAny);
      if constexpr (kIsVector<T>) value = T(items->size());
    }
    for (std::size_t i = 0; i < value.size(); ++i)
      Read(items ? &(*items)[i] : nullptr, place.At(i), value[i], checks);
  } else if constexpr (kIsPair<T>) {
    if (!json) return;
    nlohmann::json one;
    const nlohmann::json& both = Items(*json, place, &one, 2, "elements");
    Read(&both[0], place, value.first);
    Read(&both[1], place, value.second);
  } else {
    const ObjectReader object(json ? *json : NoKeys(), place);
    Describe(object, value);
    object.RejectOthers();
  }
}

}  // namespace archive_internal

}  // namespace volalign
