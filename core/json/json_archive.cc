#include "core/json/json_archive.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>
#include <utility>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/config/config.h"

namespace volalign {

using Json = nlohmann::json;

namespace {

[[noreturn]] void Fail(const Json& value, const std::string& place, const char* expected) {
  throw DataError(fmt::format("{} = {} is not {}", place, ShownJson(value), expected));
}

}  // namespace

std::string ShownJson(const Json& value) {
  return Shortened(value.dump(-1, ' ', false, Json::error_handler_t::replace));
}

Json ParseStrictJson(const std::string& text, const std::string& name) {
  using Event = Json::parse_event_t;
  std::vector<std::set<std::string>> open;
  std::size_t values = 0;
  std::string problem;
  const auto check = [&](int depth, Event event, Json& parsed) {
    if (event == Event::key) {
      const auto key = parsed.get<std::string>();
      if (!open.back().insert(key).second && problem.empty()) {
        problem =
            fmt::format("the key \"{}\" stands twice in one object; remove one", Shortened(key));
      }
      return true;
    }
    if (event == Event::object_end) open.pop_back();
    if (event == Event::object_end || event == Event::array_end) return true;
    if (event != Event::value && depth >= kMaxJsonDepth) {
      throw DataError(fmt::format("{}: nested deeper than the {} levels that are read of JSON",
                                  name, kMaxJsonDepth));
    }
    if (++values > kMaxJsonValues) {
      throw DataError(
          fmt::format("{}: more than the {} values that are read of JSON", name, kMaxJsonValues));
    }
    if (event == Event::object_start) open.emplace_back();
    if (event == Event::value && parsed.is_null() && problem.empty())
      problem = "a value is null; leave the key out instead";
    return true;
  };
  Json document;
  try {
    document = Json::parse(text, check);
  } catch (const Json::exception& error) {
    const std::string what = error.what();
    const std::size_t id = what.find("] ");
    throw DataError(fmt::format("{}: not valid JSON: {}", name,
                                Shortened(id == std::string::npos ? what : what.substr(id + 2))));
  }
  if (!problem.empty()) throw DataError(name + ": " + problem);
  return document;
}

void ReadJsonValue(const Json& json, const std::string& place, bool* value) {
  if (!json.is_boolean()) Fail(json, place, "true or false");
  *value = json.get<bool>();
}

void ReadJsonValue(const Json& json, const std::string& place, int* value) {
  double number = 0;
  ReadJsonValue(json, place, &number);
  if (number != std::floor(number) || std::abs(number) > 1e9) Fail(json, place, "a whole number");
  *value = static_cast<int>(number);
}

void ReadJsonValue(const Json& json, const std::string& place, std::int64_t* value) {
  if (!json.is_number_integer()) Fail(json, place, "a whole number");
  *value = json.get<std::int64_t>();
}

void ReadJsonValue(const Json& json, const std::string& place, std::uint64_t* value) {
  if (!json.is_number_unsigned()) Fail(json, place, "a whole number of 0 or more");
  *value = json.get<std::uint64_t>();
}

void ReadJsonValue(const Json& json, const std::string& place, double* value) {
  if (!json.is_number() || !std::isfinite(json.get<double>())) Fail(json, place, "a finite number");
  *value = json.get<double>();
}

void ReadJsonValue(const Json& json, const std::string& place, std::string* value) {
  if (!json.is_string()) Fail(json, place, "a string");
  *value = json.get<std::string>();
}

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
  Fail(json, place, "a list");
}

void FailNotOneOf(const std::string& text, const std::vector<std::string>& known,
                  const std::string& place) {
  throw DataError(
      fmt::format("{} = \"{}\" is none of {}", place, Shortened(text), fmt::join(known, ", ")));
}

}  // namespace json_internal

JsonObject::JsonObject(const Json& value, std::string where)
    : value_(&value), document_(where), where_(std::move(where)) {
  if (!value.is_object()) {
    throw DataError(
        fmt::format("{}: a JSON object {{...}} is expected, not {}", where_, value.type_name()));
  }
}

const std::string& JsonObject::Renamed(const std::string& part) const {
  where_ = document_ + ": " + part;
  return where_;
}

bool JsonObject::Has(const std::string& key) const {
  known_.insert(key);
  return value_->contains(key);
}

const Json& JsonObject::Get(const std::string& key) const {
  if (!Has(key)) throw DataError(fmt::format("{}: the key \"{}\" is missing", where_, key));
  return (*value_)[key];
}

std::vector<JsonObject> JsonObject::Children(const std::string& key) const {
  const Json& value = Get(key);
  json_internal::RequireList(value, Place(key));
  std::vector<JsonObject> children;
  for (std::size_t i = 0; i < value.size(); ++i) {
    children.emplace_back(value[i], fmt::format("{}[{}]", Place(key), i));
    children.back().document_ = where_;
  }
  return children;
}

std::vector<std::string> JsonObject::Keys() const {
  std::vector<std::string> keys;
  for (const auto& item : value_->items()) keys.push_back(item.key());
  return keys;
}

void JsonObject::RejectOthers(std::initializer_list<const char*> known) const {
  known_.insert(known.begin(), known.end());
  for (const auto& item : value_->items()) {
    if (known_.count(item.key())) continue;
    const std::string nearest =
        NearestKey(item.key(), std::vector<std::string>(known_.begin(), known_.end()));
    throw DataError(fmt::format(
        "{}: the key \"{}\" is unknown{}", where_, Shortened(item.key()),
        nearest.empty() ? "; remove it" : fmt::format("; did you mean \"{}\"?", nearest)));
  }
}

void JsonObject::Constant(const std::string& key, const std::string& text) const {
  if (Text(key) == text) return;
  throw DataError(fmt::format("{} \"{}\" is unknown; this version reads \"{}\"", Place(key),
                              Shortened(Text(key)), text));
}

void JsonObject::OneOrList(const std::string& key, std::vector<std::string>& texts) const {
  texts.clear();
  if (!Has(key)) return;
  if (Get(key).is_string()) {
    texts = {Text(key)};
  } else {
    (*this)(key, texts);
  }
}

void JsonWriter::OneOrList(const std::string& key, const std::vector<std::string>& texts) {
  if (texts.size() == 1) json_[key] = texts.front();
  if (texts.size() > 1) json_[key] = texts;
}

}  // namespace volalign
