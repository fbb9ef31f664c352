#include "core/json/json_archive.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>

#include "core/base/error.h"
#include "core/base/text.h"

namespace volalign {

namespace json_internal {

double Finite(double value, const std::string& place) {
  if (!std::isfinite(value)) {
    throw Error(fmt::format("{} = {} is not finite and was not written", place, value));
  }
  return value;
}

void RequireCount(std::size_t count, std::size_t expected, const char* what,
                  const std::string& place) {
  if (count == expected) return;
  throw DataError(fmt::format("{} has {} {}, not {}", place, count, what, expected));
}

void RequireList(const nlohmann::json& json, const std::string& place) {
  if (json.is_array()) return;
  throw DataError(fmt::format("{} = {} is not a list", place, ShownJson(json)));
}

void FailNotOneOf(const std::string& text, const std::vector<std::string>& known,
                  const std::string& place) {
  throw DataError(
      fmt::format("{} = \"{}\" is none of {}", place, Shortened(text), fmt::join(known, ", ")));
}

}  // namespace json_internal

void JsonReader::Constant(const std::string& key, const std::string& text) {
  if (object_.Text(key) == text) return;
  throw DataError(fmt::format("{} \"{}\" is unknown; this version reads \"{}\"", object_.Place(key),
                              Shortened(object_.Text(key)), text));
}

void JsonReader::OneOrList(const std::string& key, std::vector<std::string>& texts) {
  texts.clear();
  if (!object_.Has(key)) return;
  if (object_.Get(key).is_string()) {
    texts = {object_.Text(key)};
  } else {
    texts = object_.Texts(key);
  }
}

void JsonWriter::OneOrList(const std::string& key, const std::vector<std::string>& texts) {
  if (texts.size() == 1) json_[key] = texts.front();
  if (texts.size() > 1) json_[key] = texts;
}

}  // namespace volalign
