#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
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
#include "core/geometry/camera.h"
#include "core/geometry/pose.h"

namespace volalign {

/// Limits far above all documents of volalign and of the programs whose files it reads. Deeper ones
/// would end the program: a value is copied, written and destroyed by recursion.
inline constexpr int kMaxJsonDepth = 64;
inline constexpr std::size_t kMaxJsonValues = 4'000'000;

/// Parses JSON. Throws DataError in one line, with `name` and the position, for a syntax error (NaN
/// is one) or a duplicate key. It does so for a null anywhere, as a key without a value has to be
/// absent. It also does so for a document that is nested deeper than kMaxJsonDepth or has more than
/// kMaxJsonValues values.
nlohmann::json ParseStrictJson(const std::string& text, const std::string& name);

/// A value for a message: as JSON, and Shortened.
std::string ShownJson(const nlohmann::json& value);

/// Read one value. `place` is its place ("capture.json: sensors[0]: depth_scale"). Throw DataError
/// with the place, the value and the expected type. An int may be written as 3.0.
void ReadJsonValue(const nlohmann::json& json, const std::string& place, bool* value);
void ReadJsonValue(const nlohmann::json& json, const std::string& place, int* value);
void ReadJsonValue(const nlohmann::json& json, const std::string& place, std::int64_t* value);
void ReadJsonValue(const nlohmann::json& json, const std::string& place, std::uint64_t* value);
void ReadJsonValue(const nlohmann::json& json, const std::string& place, double* value);
void ReadJsonValue(const nlohmann::json& json, const std::string& place, std::string* value);

/// JSON files: a struct describes its fields once, as in core/config/config.h.
///
///   struct Shot {
///     std::string name;
///     double range_m = 0;
///     std::optional<Pose> room_from_shot;
///     template <class Archive>
///     void Describe(Archive& ar) {
///       ar("name", name);
///       ar("range_m", range_m);
///       ar.Optional("room_from_shot", room_from_shot);
///     }
///   };
///
/// WriteDescribed writes the keys in this order. ReadDescribed reads strictly: a key that is
/// missing, unknown, of another type or not finite is a DataError with its place. A struct that has
/// to be independent of files is described by a free template Describe(ar, value) in namespace
/// volalign, beside the code that reads and writes it.
///
/// Fields may be bool, int, std::int64_t, std::uint64_t, double, std::string, Pose (4x4, row-major)
/// and enums with ToString(value) and AllOf(value) (all values). Also Eigen vectors (a list) and
/// matrices (a list of rows), described structs, and vectors and pairs (a list of two) of all
/// these. Also std::map<std::string, T> and std::vector<std::pair<std::string, T>> (an object).
///
/// Both archives have:
///
///   ar(key, value)              in every file
///   ar.Optional(key, value)     absent if it has no value, is empty or equals T()
///   ar.OptionalSinceVersion(key, value)   always written; unchanged if an earlier version's file
///                               lacks it
///   ar.IfFinite(key, value)     numbers (double, Eigen, Pose) that may be unknown: NaN in memory,
///                               an absent key in a file. A third argument is read instead of NaN
///   ar.Constant(key, text)      the same text in every file; any other is an error
///   ar.WriteOnly(key, value)    written for the file's other readers, not read
///   ar.OneOrList(key, texts)    absent, a string or a list
///   ar.ByName(key, items, &Item::name)   an object of the items by their names
///   Archive::kReading, ar.where()

template <class Archive, class T>
void Describe(Archive& ar, T& value) {
  value.Describe(ar);
}

template <class Archive>
void Describe(Archive& ar, PoseError& error) {
  ar.IfFinite("translation_m", error.translation_m);
  ar.IfFinite("rotation_deg", error.rotation_deg);
}

template <class Archive>
void Describe(Archive& ar, Intrinsics& intrinsics) {
  ar("width", intrinsics.width);
  ar("height", intrinsics.height);
  ar("fx", intrinsics.fx);
  ar("fy", intrinsics.fy);
  ar("cx", intrinsics.cx);
  ar("cy", intrinsics.cy);
  ar.OptionalSinceVersion("distortion", intrinsics.distortion);
  if constexpr (Archive::kReading) intrinsics.Validate(ar.where());
}

namespace json_internal {

using OrderedJson = nlohmann::ordered_json;

template <class T>
struct IsOptional : std::false_type {};
template <class T>
struct IsOptional<std::optional<T>> : std::true_type {};

template <class T>
struct IsVector : std::false_type {};
template <class T>
struct IsVector<std::vector<T>> : std::true_type {};

template <class T>
struct IsPair : std::false_type {};
template <class First, class Second>
struct IsPair<std::pair<First, Second>> : std::true_type {};

/// Containers that are objects in JSON.
template <class T>
struct IsDictionary : std::false_type {};
template <class T>
struct IsDictionary<std::map<std::string, T>> : std::true_type {};
template <class T>
struct IsDictionary<std::vector<std::pair<std::string, T>>> : std::true_type {};

template <class T>
inline constexpr bool kIsMatrix = std::is_base_of_v<Eigen::MatrixBase<T>, T>;

/// The numbers of a double, an Eigen type or a Pose, as an Eigen expression.
template <class T>
decltype(auto) NumbersOf(T& value) {
  if constexpr (std::is_same_v<T, double>) {
    return Eigen::Map<Eigen::Matrix<double, 1, 1>>(&value);
  } else if constexpr (std::is_same_v<T, Pose>) {
    return (value.matrix());
  } else {
    return (value);
  }
}

/// Returns the value. Throws Error unless it is finite.
double Finite(double value, const std::string& place);

/// Throw DataError.
void RequireCount(std::size_t count, std::size_t expected, const char* what,
                  const std::string& place);
void RequireList(const nlohmann::json& json, const std::string& place);
[[noreturn]] void FailNotOneOf(const std::string& text, const std::vector<std::string>& known,
                               const std::string& place);

template <class T>
OrderedJson ToJson(T& value, const std::string& place);
template <class T>
void FromJson(const nlohmann::json& json, const std::string& place, T* value);

template <class T>
bool HasValue(const T& value) {
  if constexpr (IsOptional<T>::value) {
    return value.has_value();
  } else if constexpr (IsVector<T>::value) {
    return !value.empty();
  } else {
    return !(value == T());
  }
}

template <class T>
OrderedJson MatrixToJson(const T& matrix, const std::string& place) {
  OrderedJson json = OrderedJson::array();
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    if constexpr (T::ColsAtCompileTime == 1) {
      json.push_back(Finite(matrix(i), place));
    } else {
      OrderedJson row = OrderedJson::array();
      for (Eigen::Index j = 0; j < matrix.cols(); ++j) row.push_back(Finite(matrix(i, j), place));
      json.push_back(std::move(row));
    }
  }
  return json;
}

template <class T>
void MatrixFromJson(const nlohmann::json& json, const std::string& place, T* matrix) {
  if constexpr (T::ColsAtCompileTime == 1) {
    std::vector<double> values;
    FromJson(json, place, &values);
    RequireCount(values.size(), static_cast<std::size_t>(matrix->rows()), "numbers", place);
    for (std::size_t i = 0; i < values.size(); ++i) {
      (*matrix)(static_cast<Eigen::Index>(i)) = values[i];
    }
  } else {
    std::vector<std::vector<double>> rows;
    FromJson(json, place, &rows);
    RequireCount(rows.size(), static_cast<std::size_t>(matrix->rows()), "rows", place);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      RequireCount(rows[i].size(), static_cast<std::size_t>(matrix->cols()), "columns", place);
      for (std::size_t j = 0; j < rows[i].size(); ++j) {
        (*matrix)(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = rows[i][j];
      }
    }
  }
}

}  // namespace json_internal

/// A JSON object that remembers which keys were asked for: it fills a struct that describes itself,
/// or is read key by key. All functions throw DataError with the place and the expected value. The
/// document must outlive it.
class JsonObject {
 public:
  static constexpr bool kReading = true;

  /// `where` begins every message ("capture.json: sensor 2"). Throws unless `value` is an object.
  JsonObject(const nlohmann::json& value, std::string where);

  const std::string& where() const { return where_; }
  /// The place of a key's value, for messages.
  std::string Place(const std::string& key) const { return where_ + ": " + key; }
  /// Replaces the part after the document's name in later messages. Returns where().
  const std::string& Renamed(const std::string& part) const;

  bool Has(const std::string& key) const;
  const nlohmann::json& Get(const std::string& key) const;
  /// A value of any type that a described struct may have; numbers are finite.
  template <class T>
  T Read(const std::string& key) const {
    T value{};
    json_internal::FromJson(Get(key), Place(key), &value);
    return value;
  }
  std::string Text(const std::string& key) const { return Read<std::string>(key); }
  double Number(const std::string& key) const { return Read<double>(key); }
  JsonObject Child(const std::string& key) const { return JsonObject(Get(key), Place(key)); }
  std::vector<JsonObject> Children(const std::string& key) const;
  /// Keys in alphabetical order, as the parser does not keep the document's order.
  std::vector<std::string> Keys() const;

  /// Throws for the first key that was neither asked for nor tested nor is in `known`. The message
  /// has the nearest of those.
  void RejectOthers(std::initializer_list<const char*> known = {}) const;

  template <class T>
  void operator()(const std::string& key, T& value) const {
    json_internal::FromJson(Get(key), Place(key), &value);
  }
  template <class T>
  void Optional(const std::string& key, T& value) const {
    value = T();
    if (!Has(key)) return;
    if constexpr (json_internal::IsOptional<T>::value) {
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
    json_internal::NumbersOf(value).setConstant(std::numeric_limits<double>::quiet_NaN());
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
    const JsonObject object = Child(key);
    items.clear();
    for (const std::string& item : object.Keys()) {
      items.emplace_back().*name = item;
      object(item, items.back());
    }
  }

 private:
  const nlohmann::json* value_;
  std::string document_;
  mutable std::string where_;
  mutable std::set<std::string> known_;
};

/// Builds a JSON object from a struct.
class JsonWriter {
 public:
  static constexpr bool kReading = false;
  explicit JsonWriter(std::string where)
      : where_(std::move(where)), json_(nlohmann::ordered_json::object()) {}
  const std::string& where() const { return where_; }
  nlohmann::ordered_json Take() { return std::move(json_); }

  template <class T>
  void operator()(const std::string& key, T& value) {
    json_[key] = json_internal::ToJson(value, Place(key));
  }
  template <class T>
  void Optional(const std::string& key, T& value) {
    if (!json_internal::HasValue(value)) return;
    if constexpr (json_internal::IsOptional<T>::value) {
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
    if (json_internal::NumbersOf(value).allFinite()) (*this)(key, value);
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
      object[item.*name] = json_internal::ToJson(item, Place(key) + ": " + item.*name);
    }
  }

 private:
  std::string Place(const std::string& key) const { return where_ + ": " + key; }

  std::string where_;
  nlohmann::ordered_json json_;
};

namespace json_internal {

template <class T>
OrderedJson ToJson(T& value, const std::string& place) {
  if constexpr (std::is_same_v<T, double>) {
    return Finite(value, place);
  } else if constexpr (std::is_arithmetic_v<T> || std::is_same_v<T, std::string>) {
    return value;
  } else if constexpr (std::is_enum_v<T>) {
    return ToString(value);
  } else if constexpr (std::is_same_v<T, Pose>) {
    return MatrixToJson(value.matrix(), place);
  } else if constexpr (kIsMatrix<T>) {
    return MatrixToJson(value, place);
  } else if constexpr (IsDictionary<T>::value) {
    OrderedJson json = OrderedJson::object();
    for (auto& [key, item] : value)
      json[key] = ToJson(item, std::string(place).append(": ").append(key));
    return json;
  } else if constexpr (IsVector<T>::value) {
    OrderedJson json = OrderedJson::array();
    for (std::size_t i = 0; i < value.size(); ++i) {
      json.push_back(ToJson(value[i], place + "[" + std::to_string(i) + "]"));
    }
    return json;
  } else if constexpr (IsPair<T>::value) {
    return OrderedJson::array({ToJson(value.first, place), ToJson(value.second, place)});
  } else {
    JsonWriter writer(place);
    Describe(writer, value);
    return writer.Take();
  }
}

template <class T>
void FromJson(const nlohmann::json& json, const std::string& place, T* value) {
  if constexpr (std::is_arithmetic_v<T> || std::is_same_v<T, std::string>) {
    ReadJsonValue(json, place, value);
  } else if constexpr (std::is_enum_v<T>) {
    std::string text;
    ReadJsonValue(json, place, &text);
    if (!FromWord(text, value)) FailNotOneOf(text, WordsOfAll<T>(), place);
  } else if constexpr (std::is_same_v<T, Pose>) {
    Eigen::Matrix4d matrix;
    MatrixFromJson(json, place, &matrix);
    *value = PoseFromMatrix(matrix, place);
  } else if constexpr (kIsMatrix<T>) {
    MatrixFromJson(json, place, value);
  } else if constexpr (IsDictionary<T>::value) {
    const JsonObject object(json, place);
    value->clear();
    for (const std::string& key : object.Keys()) {
      value->insert(value->end(), {key, object.Read<typename T::value_type::second_type>(key)});
    }
  } else if constexpr (IsVector<T>::value) {
    RequireList(json, place);
    value->clear();
    for (std::size_t i = 0; i < json.size(); ++i) {
      typename T::value_type item{};
      FromJson(json[i], place + "[" + std::to_string(i) + "]", &item);
      value->push_back(std::move(item));
    }
  } else if constexpr (IsPair<T>::value) {
    RequireList(json, place);
    RequireCount(json.size(), 2, "elements", place);
    FromJson(json[0], place, &value->first);
    FromJson(json[1], place, &value->second);
  } else {
    const JsonObject object(json, place);
    Describe(object, *value);
    object.RejectOthers();
  }
}

}  // namespace json_internal

/// The struct as a JSON object. `where` begins every message. Throws Error for a number that is not
/// finite.
template <class T>
nlohmann::ordered_json DescribedJson(T value, const std::string& where) {
  return json_internal::ToJson(value, where);
}

/// The text of a JSON file, indented by `indent`, with a final newline. Bytes that are no UTF-8, as
/// in names of files, become U+FFFD. Throws as DescribedJson.
template <class T>
std::string WriteDescribed(T value, const std::string& name, int indent) {
  using Json = nlohmann::ordered_json;
  return json_internal::ToJson(value, name)
             .dump(indent, ' ', false, Json::error_handler_t::replace) +
         "\n";
}

/// Reads the text of a file called `name`, or a part of one. Throws DataError.
template <class T>
T ReadDescribed(const std::string& text, const std::string& name) {
  T value;
  json_internal::FromJson(ParseStrictJson(text, name), name, &value);
  return value;
}
template <class T>
T ReadDescribed(const JsonObject& object) {
  T value;
  Describe(object, value);
  object.RejectOthers();
  return value;
}

}  // namespace volalign
