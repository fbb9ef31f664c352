#pragma once

#include <cstdint>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "core/geometry/camera.h"

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

/// A JSON object that remembers which keys were asked for. All functions throw DataError with the
/// place and the expected value. The document must outlive it.
class JsonObject {
 public:
  /// `where` begins every message ("capture.json: sensor 2"). Throws unless `value` is an object.
  JsonObject(const nlohmann::json& value, std::string where);

  const std::string& where() const { return where_; }
  /// The place of a key's value, for messages.
  std::string Place(const std::string& key) const { return where_ + ": " + key; }
  /// Replaces the part after the document's name in later messages. Returns where().
  const std::string& Renamed(const std::string& part) const;

  bool Has(const std::string& key) const;
  const nlohmann::json& Get(const std::string& key) const;
  std::string Text(const std::string& key) const;
  double Number(const std::string& key) const;  ///< finite
  int Int(const std::string& key) const;
  std::vector<double> Numbers(const std::string& key) const;
  std::vector<std::string> Texts(const std::string& key) const;
  std::vector<std::vector<double>> Matrix(const std::string& key) const;
  JsonObject Child(const std::string& key) const;
  std::vector<JsonObject> Children(const std::string& key) const;
  /// Keys in alphabetical order, as the parser does not keep the document's order.
  std::vector<std::string> Keys() const;

  /// Throws for the first key that was neither asked for nor tested nor is in `known`. The message
  /// has the nearest of those.
  void RejectOthers(std::initializer_list<const char*> known = {}) const;

 private:
  template <class T>
  T Value(const std::string& key) const {
    T value{};
    ReadJsonValue(Get(key), Place(key), &value);
    return value;
  }
  /// The value of `key`, which has to be a list of `what`.
  const nlohmann::json& List(const std::string& key, const char* what) const;

  const nlohmann::json* value_;
  std::string document_;
  mutable std::string where_;
  mutable std::set<std::string> known_;
};

/// width, height, fx, fy, cx, cy and, optionally, distortion; validated.
Intrinsics ParseIntrinsics(const JsonObject& object);

}  // namespace volalign
