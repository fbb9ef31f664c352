#include "core/config/archive.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <charconv>
#include <cmath>
#include <mutex>

#include "core/base/error.h"
#include "core/base/number.h"
#include "core/base/text.h"
#include "core/config/config.h"

namespace volalign {

using Json = nlohmann::json;

ValuePlace ValuePlace::At(const std::string& key) const {
  if (config == nullptr) return {name + ": " + key, nullptr};
  return {name.empty() ? key : name + "." + key, config};
}

ValuePlace ValuePlace::At(std::size_t index) const {
  return {fmt::format("{}[{}]", name, index), config};
}

namespace {

/// Is the value, or the list of which it is an item, in the source?
bool IsGiven(const ValuePlace& place) {
  std::string name = place.name;
  while (place.config->source.Find(name) == nullptr) {
    if (name.empty() || name.back() != ']') return false;
    name.resize(name.rfind('['));
  }
  return true;
}

std::string Message(const ValuePlace& place, const std::string& shown, const std::string& problem) {
  const std::string text = fmt::format("{} = {} {}", Shortened(place.name), shown, problem);
  if (place.config == nullptr) return text;
  return fmt::format("{} ({})", text,
                     IsGiven(place) ? place.config->source.WhereOf(place.name) : "default");
}

}  // namespace

void ValuePlace::Fail(const std::string& shown, const std::string& problem) const {
  const std::string message = Message(*this, shown, problem);
  if (config == nullptr) throw DataError(message);
  throw ConfigError(message);
}

namespace {

/// JSON as a person writes it in YAML: without quotes, and with blanks.
std::string ShownFlow(const std::string& json) {
  std::string flow;
  for (const char c : json) {
    if (c != '"') flow += c;
    if (c == ',' || c == ':') flow += ' ';
  }
  return flow;
}

}  // namespace

void ValuePlace::Fail(const Json& value, const std::string& problem) const {
  std::string shown = ShownJson(value);
  if (config != nullptr && value.is_string()) {
    shown = "'" + Shortened(ScalarText(value)) + "'";
  } else if (config != nullptr) {
    shown = ShownFlow(shown);
  }
  Fail(shown, problem);
}

std::string ShownJson(const Json& value) {
  return Shortened(value.dump(-1, ' ', false, Json::error_handler_t::replace));
}

std::string ScalarText(const Json& value) {
  if (value.is_string()) return value.get<std::string>();
  return value.is_number_float() ? fmt::format("{}", value.get<double>())
                                 : value.dump(-1, ' ', false, Json::error_handler_t::replace);
}

void ConfigKeys::RejectUnknown() const {
  const std::vector<std::string> names(known.begin(), known.end());
  for (const auto& [key, leaf] : source.Leaves()) {
    if (known.count(key)) continue;
    std::string hint;
    const std::string list = key.substr(0, key.find('['));
    if (const std::string nearest = NearestKey(known.count(list) > 0 ? key : list, names);
        !nearest.empty()) {
      hint = fmt::format("; did you mean '{}'?", nearest);
    } else if (const std::size_t dot = key.rfind('.'); dot != std::string::npos) {
      const std::string group = key.substr(0, dot);
      std::vector<std::string> members;
      for (const std::string& other : names) {
        if (other.rfind('.') == dot && other.compare(0, dot, group) == 0)
          members.push_back(other.substr(dot + 1));
      }
      if (!members.empty()) hint = fmt::format("; {} has {}", group, fmt::join(members, ", "));
    }
    throw ConfigError(
        fmt::format("unknown key '{}' ({}){}", Shortened(key), source.WhereOf(key), hint));
  }
  if (!missing.empty()) throw ConfigError(missing);
}

namespace {

/// A scalar of YAML.
std::string TextOf(const Json& json, const ValuePlace& place) {
  if (json.is_string()) return json.get<std::string>();
  place.Fail(json, "is not a single value");
}

/// A number of YAML; null if the text is none.
Json NumberIn(const std::string& text) {
  const char* const end = text.data() + text.size();
  std::int64_t whole = 0;
  if (const auto [rest, error] = std::from_chars(text.data(), end, whole);
      error == std::errc() && rest == end)
    return whole;
  std::uint64_t large = 0;
  if (const auto [rest, error] = std::from_chars(text.data(), end, large);
      error == std::errc() && rest == end)
    return large;
  const std::optional<double> real = NumberOf(text);
  return real ? Json(*real) : Json();
}

}  // namespace

void ReadValue(const Json& json, const ValuePlace& place, bool* value) {
  if (place.config == nullptr && json.is_boolean()) {
    *value = json.get<bool>();
    return;
  }
  const std::string text = place.config == nullptr ? "" : TextOf(json, place);
  *value = text == "true" || text == "yes" || text == "on";
  if (!*value && text != "false" && text != "no" && text != "off")
    place.Fail(json, "is not true or false");
}

void ReadValue(const Json& json, const ValuePlace& place, double* value) {
  const Json number = place.config == nullptr ? json : NumberIn(TextOf(json, place));
  if (!number.is_number() || !std::isfinite(number.get<double>()))
    place.Fail(json, "is not a finite number");
  *value = number.get<double>();
}

void ReadValue(const Json& json, const ValuePlace& place, std::string* value) {
  if (place.config == nullptr && !json.is_string()) place.Fail(json, "is not a string");
  *value = TextOf(json, place);
}

std::uint64_t ReadWhole(const Json& json, const ValuePlace& place, std::int64_t low,
                        std::uint64_t high) {
  constexpr double kExact = 9e15;
  Json number = place.config == nullptr ? json : NumberIn(TextOf(json, place));
  if (number.is_number_float()) {
    const double real = number.get<double>();
    if (real == std::floor(real) && std::abs(real) < kExact)
      number = static_cast<std::int64_t>(real);
  }
  if (!number.is_number_integer()) place.Fail(json, "is not a whole number");
  const bool negative = !number.is_number_unsigned() && number.get<std::int64_t>() < 0;
  if (negative ? number.get<std::int64_t>() < low : number.get<std::uint64_t>() > high)
    place.Fail(json, fmt::format("is not a whole number in [{}, {}]", low, high));
  return number.get<std::uint64_t>();
}

namespace archive_internal {

double Finite(double value, const std::string& place) {
  if (!std::isfinite(value)) {
    throw Error(fmt::format("{} = {} is not finite and was not written", place, value));
  }
  return value;
}

void Check(const std::string& text, std::optional<double> number,
           const std::vector<Constraint>& constraints, const ValuePlace& place) {
  for (const Constraint& constraint : constraints) {
    if (number ? !constraint.number || constraint.number(*number)
               : !constraint.word || constraint.word(text))
      continue;
    const std::string problem = fmt::format("violates {} {}", place.name, constraint.text);
    ConfigKeys* const config = place.config;
    if (config == nullptr || !config->complete || IsGiven(place))
      place.Fail(Shortened(text), problem);
    if (config->missing.empty()) config->missing = Message(place, Shortened(text), problem);
  }
}

const Json& Items(const Json& json, const ValuePlace& place, Json* one, std::size_t count,
                  const char* what) {
  const bool single = place.config != nullptr && json.is_string();
  if (single) *one = Json::array({json});
  const Json& items = single ? *one : json;
  if (!items.is_array()) place.Fail(json, "is not a list");
  if (count == kAny || items.size() == count) return items;
  if (place.config != nullptr)
    place.Fail(json, fmt::format("has {} {}; {} are expected, with commas between them",
                                 items.size(), what, count));
  throw DataError(fmt::format("{} has {} {}, not {}", place.name, items.size(), what, count));
}

const Json& NoKeys() {
  static const Json none = Json::object();
  return none;
}

void KnowAll(const Json& value, const ValuePlace& place) {
  if (place.config == nullptr) return;
  for (const auto& leaf : LeavesOf(value, place.name)) place.config->known.insert(leaf.first);
}

void FailNotOneOf(const Json& json, const std::vector<std::string>& known,
                  const ValuePlace& place) {
  place.Fail(json, fmt::format("is none of {}", fmt::join(known, ", ")));
}

}  // namespace archive_internal

ObjectReader::ObjectReader(const Json& value, ValuePlace place)
    : value_(&value), place_(std::move(place)), document_(place_.name) {
  if (value.is_object()) return;
  if (place_.config != nullptr) place_.Fail(value, "is not a map, as in {name: a}");
  throw DataError(
      fmt::format("{}: a JSON object {{...}} is expected, not {}", where(), value.type_name()));
}

const std::string& ObjectReader::Renamed(const std::string& part) const {
  place_.name = document_ + ": " + part;
  return where();
}

bool ObjectReader::Has(const std::string& key) const {
  known_.insert(key);
  return value_->contains(key);
}

const Json& ObjectReader::Get(const std::string& key) const {
  if (!Has(key)) throw DataError(fmt::format("{}: the key \"{}\" is missing", where(), key));
  return (*value_)[key];
}

std::vector<ObjectReader> ObjectReader::Children(const std::string& key) const {
  const Json& value = Get(key);
  if (!value.is_array()) place_.At(key).Fail(value, "is not a list");
  std::vector<ObjectReader> children;
  for (std::size_t i = 0; i < value.size(); ++i) {
    children.emplace_back(value[i], place_.At(key).At(i));
    children.back().document_ = where();
  }
  return children;
}

std::vector<std::string> ObjectReader::Keys() const {
  std::vector<std::string> keys;
  for (const auto& item : value_->items()) keys.push_back(item.key());
  return keys;
}

void ObjectReader::RejectOthers(std::initializer_list<const char*> known) const {
  if (place_.config != nullptr) return;
  known_.insert(known.begin(), known.end());
  for (const auto& item : value_->items()) {
    if (known_.count(item.key())) continue;
    const std::string nearest =
        NearestKey(item.key(), std::vector<std::string>(known_.begin(), known_.end()));
    throw DataError(fmt::format(
        "{}: the key \"{}\" is unknown{}", where(), Shortened(item.key()),
        nearest.empty() ? "; remove it" : fmt::format("; did you mean \"{}\"?", nearest)));
  }
}

void ObjectReader::Constant(const std::string& key, const std::string& text) const {
  if (Text(key) == text) return;
  throw DataError(fmt::format("{} \"{}\" is unknown; this version reads \"{}\"", Place(key),
                              Shortened(Text(key)), text));
}

void ObjectReader::OneOrList(const std::string& key, std::vector<std::string>& texts) const {
  texts.clear();
  if (!Has(key)) return;
  if (Get(key).is_string()) {
    texts = {Text(key)};
  } else {
    (*this)(key, texts);
  }
}

std::optional<std::string> ObjectReader::NameOf(const std::string& key,
                                                const std::vector<Constraint>& checks) const {
  ConfigKeys* const config = place_.config;
  const std::string is = Place(key);
  for (const Constraint& check : checks) {
    if (check.required && config == nullptr) Get(key);
    if (config == nullptr) continue;
    if (check.required && config->complete && !Has(key)) {
      config->known.insert(is);
      if (config->missing.empty())
        config->missing = fmt::format("key '{}' is missing ({})", is, config->source.WhereOf(is));
      return std::nullopt;
    }
    const std::string& name = check.removed_name.empty() ? check.former_name : check.removed_name;
    Json::json_pointer below;  // "lens.min_sigmas" is in a group that may be gone, too
    for (const std::string& step : Split(name, '.')) below /= step;
    if (name.empty() || !value_->contains(below)) continue;
    const std::string was = Place(name), where = config->source.WhereOf(was);
    if (!check.removed_name.empty()) {
      if (!check.harmless || LeafTexts(value_->at(below)) != *check.harmless)
        throw ConfigError(fmt::format("{} ({}) is no longer a key: {}", was, where, check.instead));
      config->known.insert(was);
      continue;
    }
    if (Has(key))
      throw ConfigError(fmt::format("{} ({}) is the former name of {} ({}): leave one of them out",
                                    was, where, is, config->source.WhereOf(is)));
    // A configuration in a file is read again from its saved copy, so warn once.
    static std::mutex mutex;
    static std::set<std::string> warned;
    const std::lock_guard<std::mutex> lock(mutex);
    if (warned.insert(was + " " + is).second)
      fmt::print(stderr, "warning: {} ({}) is now called {}\n", was, where, is);
    return name;
  }
  return key;
}

void ObjectWriter::OneOrList(const std::string& key, const std::vector<std::string>& texts) {
  if (texts.size() == 1) json_[key] = texts.front();
  if (texts.size() > 1) json_[key] = texts;
}

}  // namespace volalign
