#include "core/strict_json.h"

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "core/config.h"
#include "core/error.h"

namespace volalign {

using Json = nlohmann::json;

Json ParseStrictJson(const std::string& text, const std::string& name) {
  std::vector<std::set<std::string>> open;
  std::string problem;
  const auto check = [&](int /*depth*/, Json::parse_event_t event, Json& parsed) {
    switch (event) {
      case Json::parse_event_t::object_start:
        open.emplace_back();
        break;
      case Json::parse_event_t::object_end:
        open.pop_back();
        break;
      case Json::parse_event_t::key: {
        const auto key = parsed.get<std::string>();
        if (!open.back().insert(key).second && problem.empty()) {
          problem = fmt::format("the key \"{}\" stands twice in one object; remove one", key);
        }
        break;
      }
      case Json::parse_event_t::value:
        if (parsed.is_null() && problem.empty()) {
          problem = "a value is null; leave the key out instead";
        }
        break;
      default:
        break;
    }
    return true;
  };
  Json document;
  try {
    document = Json::parse(text, check);
  } catch (const Json::exception& error) {
    const std::string what = error.what();
    const std::size_t id = what.find("] ");
    throw DataError(fmt::format("{}: not valid JSON: {}", name,
                                id == std::string::npos ? what : what.substr(id + 2)));
  }
  if (!problem.empty()) throw DataError(name + ": " + problem);
  return document;
}

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

void JsonObject::Fail(const std::string& key, const char* expected) const {
  throw DataError(
      fmt::format("{}: {} = {} is not {}", where_, key, value_->at(key).dump(), expected));
}

bool JsonObject::Has(const std::string& key) const {
  known_.insert(key);
  return value_->contains(key);
}

const Json& JsonObject::Get(const std::string& key) const {
  if (!Has(key)) throw DataError(fmt::format("{}: the key \"{}\" is missing", where_, key));
  return (*value_)[key];
}

std::string JsonObject::Text(const std::string& key) const {
  const Json& value = Get(key);
  if (!value.is_string()) Fail(key, "a string");
  return value.get<std::string>();
}

double JsonObject::Number(const std::string& key) const {
  const Json& value = Get(key);
  if (!value.is_number() || !std::isfinite(value.get<double>())) Fail(key, "a finite number");
  return value.get<double>();
}

int JsonObject::Int(const std::string& key) const {
  const double number = Number(key);
  if (number != std::floor(number) || std::abs(number) > 1e9) Fail(key, "a whole number");
  return static_cast<int>(number);
}

bool JsonObject::Bool(const std::string& key) const {
  const Json& value = Get(key);
  if (!value.is_boolean()) Fail(key, "true or false");
  return value.get<bool>();
}

std::vector<double> JsonObject::Numbers(const std::string& key) const {
  const Json& value = Get(key);
  if (!value.is_array()) Fail(key, "a list of numbers");
  std::vector<double> numbers;
  for (const Json& item : value) {
    if (!item.is_number() || !std::isfinite(item.get<double>()))
      Fail(key, "a list of finite numbers");
    numbers.push_back(item.get<double>());
  }
  return numbers;
}

std::vector<std::string> JsonObject::Texts(const std::string& key) const {
  const Json& value = Get(key);
  if (!value.is_array()) Fail(key, "a list of strings");
  std::vector<std::string> texts;
  for (const Json& item : value) {
    if (!item.is_string()) Fail(key, "a list of strings");
    texts.push_back(item.get<std::string>());
  }
  return texts;
}

std::vector<std::vector<double>> JsonObject::Matrix(const std::string& key) const {
  const Json& value = Get(key);
  if (!value.is_array()) Fail(key, "a list of rows of numbers");
  std::vector<std::vector<double>> rows;
  for (const Json& row : value) {
    if (!row.is_array()) Fail(key, "a list of rows of numbers");
    rows.emplace_back();
    for (const Json& item : row) {
      if (!item.is_number() || !std::isfinite(item.get<double>()))
        Fail(key, "a matrix of finite numbers");
      rows.back().push_back(item.get<double>());
    }
  }
  return rows;
}

JsonObject JsonObject::Child(const std::string& key) const {
  JsonObject child(Get(key), where_ + ": " + key);
  return child;
}

std::vector<JsonObject> JsonObject::Children(const std::string& key) const {
  const Json& value = Get(key);
  if (!value.is_array()) Fail(key, "a list of objects");
  std::vector<JsonObject> children;
  for (std::size_t i = 0; i < value.size(); ++i) {
    children.emplace_back(value[i], fmt::format("{}: {}[{}]", where_, key, i));
    children.back().document_ = where_;
  }
  return children;
}

std::vector<std::string> JsonObject::Keys() const {
  std::vector<std::string> keys;
  for (const auto& item : value_->items()) keys.push_back(item.key());
  return keys;
}

void JsonObject::RejectOthers() const {
  for (const auto& item : value_->items()) {
    if (known_.count(item.key())) continue;
    const std::string nearest =
        NearestKey(item.key(), std::vector<std::string>(known_.begin(), known_.end()));
    throw DataError(fmt::format(
        "{}: the key \"{}\" is unknown{}", where_, item.key(),
        nearest.empty() ? "; remove it" : fmt::format("; did you mean \"{}\"?", nearest)));
  }
}

Intrinsics ParseIntrinsics(const JsonObject& object) {
  Intrinsics intrinsics;
  intrinsics.width = object.Int("width");
  intrinsics.height = object.Int("height");
  intrinsics.fx = object.Number("fx");
  intrinsics.fy = object.Number("fy");
  intrinsics.cx = object.Number("cx");
  intrinsics.cy = object.Number("cy");
  if (object.Has("distortion")) intrinsics.distortion = object.Numbers("distortion");
  object.RejectOthers();
  intrinsics.Validate(object.where());
  return intrinsics;
}

}  // namespace volalign
