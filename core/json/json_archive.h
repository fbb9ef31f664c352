#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "core/config/archive.h"
#include "core/geometry/camera.h"
#include "core/geometry/pose.h"

namespace volalign {

/// Limits far above all documents of volalign and of the programs whose files it reads. Deeper ones
/// would end the program: a value is copied, written and destroyed by recursion.
inline constexpr int kMaxJsonDepth = 64;
inline constexpr std::size_t kMaxJsonValues = 4'000'000;

/// JSON files, by core/config/archive.h. WriteDescribed writes the keys in the order of Describe.
/// ReadDescribed reads strictly: a key that is missing, unknown, of another type or not finite is a
/// DataError with its place.

/// Parses JSON. Throws DataError in one line, with `name` and the position, for a syntax error (NaN
/// is one) or a duplicate key. It does so for a null anywhere, as a key without a value has to be
/// absent. It also does so for a document that is nested deeper than kMaxJsonDepth or has more than
/// kMaxJsonValues values.
nlohmann::json ParseStrictJson(const std::string& text, const std::string& name);

/// 4x4, row-major.
template <>
struct StoredAs<Pose> {
  using Type = Eigen::Matrix4d;
  static Type Of(const Pose& pose) { return pose.matrix(); }
  static Pose From(const Type& matrix, const std::string& place) {
    return PoseFromMatrix(matrix, place);
  }
};

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

/// The struct as a JSON object. `where` begins every message. Throws Error for a number that is not
/// finite.
template <class T>
nlohmann::ordered_json DescribedJson(T value, const std::string& where) {
  return archive_internal::ToJson(value, where);
}

/// The text of a JSON file, indented by `indent`, with a final newline. Bytes that are no UTF-8, as
/// in names of files, become U+FFFD. Throws as DescribedJson.
template <class T>
std::string WriteDescribed(T value, const std::string& name, int indent) {
  using Json = nlohmann::ordered_json;
  return archive_internal::ToJson(value, name)
             .dump(indent, ' ', false, Json::error_handler_t::replace) +
         "\n";
}

/// Reads the text of a file called `name`, or a part of one. Throws DataError.
template <class T>
T ReadDescribed(const std::string& text, const std::string& name) {
  T value;
  const nlohmann::json document = ParseStrictJson(text, name);
  archive_internal::Read(&document, ValuePlace{name}, value);
  return value;
}
template <class T>
T ReadDescribed(const ObjectReader& object) {
  T value;
  Describe(object, value);
  object.RejectOthers();
  return value;
}

}  // namespace volalign
