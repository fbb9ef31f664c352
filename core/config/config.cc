#include "core/config/config.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <functional>
#include <system_error>
#include <tuple>

#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "core/base/text.h"
#include "core/config/bounded_yaml.h"

namespace volalign {

using Json = nlohmann::json;

Constraint Above(double low) {
  return {fmt::format("> {}", low), [low](double x) { return x > low; }, nullptr};
}

Constraint AtLeast(double low) {
  return {fmt::format(">= {}", low), [low](double x) { return x >= low; }, nullptr};
}

Constraint Between(double low, double high) {
  return {fmt::format("in [{}, {}]", low, high),
          [low, high](double x) { return x >= low && x <= high; }, nullptr};
}

Constraint OneOf(std::vector<std::string> words) {
  return {fmt::format("in {{{}}}", fmt::join(words, ", ")), nullptr,
          [words](const std::string& word) {
            return std::find(words.begin(), words.end(), word) != words.end();
          }};
}

Constraint Required() {
  Constraint required;
  required.required = true;
  return required;
}
Constraint FormerlyNamed(std::string name) { return {"", nullptr, nullptr, std::move(name)}; }
Constraint Removed(std::string name, std::string instead,
                   std::optional<std::vector<std::string>> harmless) {
  return {"", nullptr, nullptr, "", std::move(name), std::move(instead), std::move(harmless)};
}

Constraint Fixed(std::string name, double value) {
  const std::string text = ScalarText(value);
  return Removed(std::move(name), "it is " + text + " now; leave the key out",
                 std::vector<std::string>{text});
}

namespace {

YAML::Node Load(const std::string& yaml, const std::string& name) {
  try {
    return LoadYaml(yaml);
  } catch (const YAML::Exception& e) {
    throw ConfigError(fmt::format("{}:{}: {}", name, e.mark.line + 1, e.msg));
  }
}

std::string LineOf(const YAML::Node& node, const std::string& name) {
  return fmt::format("{}:{}", name, node.Mark().line + 1);
}

std::string Joined(const std::string& group, const std::string& key) {
  return group.empty() ? key : group + "." + key;
}

/// The steps of a path; that of an index begins with a bracket: "sensors", "[0", "name".
std::vector<std::string> Steps(const std::string& key) {
  std::string text;
  for (const char c : key) text += c == '[' ? ".[" : c == ']' ? "" : std::string(1, c);
  return key.empty() ? std::vector<std::string>() : Split(text, '.');
}

/// The value of a step below another one; a new one in an object or at the end of a list. Null if
/// it cannot be there.
Json* Step(const std::string& step, Json* at) {
  const bool is_index = step.rfind('[', 0) == 0;
  if (at->is_null()) *at = is_index ? Json::array() : Json::object();
  if (!is_index) return at->is_object() ? &(*at)[step] : nullptr;
  std::size_t i = 0;
  const char* const end = step.data() + step.size();
  const auto [rest, error] = std::from_chars(step.data() + 1, end, i);
  if (!at->is_array() || error != std::errc() || rest != end || i > at->size()) return nullptr;
  if (i == at->size()) at->push_back(Json());
  return &(*at)[i];
}

/// Fills `tree` with a YAML value and `places` with where it stands and what is below it.
/// `place_of`: where a node stands.
void Convert(const YAML::Node& node, const std::string& key, const std::string& where,
             const std::function<std::string(const YAML::Node&)>& place_of, Json* tree,
             Json* places) {
  (*places)[""] = where;
  if (node.IsScalar()) {
    *tree = node.Scalar();
  } else if (node.IsSequence()) {
    *tree = Json::array();
    Json of_scalar;  // is that of the list
    for (const YAML::Node& item : node) {
      const std::string index = fmt::format("[{}", tree->size());
      Convert(item, key + index + "]", place_of(item), place_of, &tree->emplace_back(),
              item.IsScalar() ? &of_scalar : &(*places)[index]);
    }
  } else if (node.IsMap()) {
    *tree = Json::object();
    for (const auto& item : node) {
      const std::string at = place_of(item.first);
      const std::string name = item.first.IsScalar() ? item.first.Scalar() : "";
      const std::vector<std::string> steps = Split(name, '.');
      if (std::count(steps.begin(), steps.end(), "") > 0 || name.find('[') != std::string::npos)
        throw ConfigError(at + ": a key has to be a word");
      const std::string full = Joined(key, name);
      Json *value = tree, *place = places;
      for (const std::string& step : steps) {
        value = Step(step, value);
        if (value == nullptr) break;
        place = &(*place)[step];
        (*place)[""] = at;
      }
      if (value == nullptr || !value->is_null())
        throw ConfigError(fmt::format("key '{}' stands twice ({})", Shortened(full), at));
      Convert(item.second, full, at, place_of, value, place);
    }
  } else {
    throw ConfigError(fmt::format("key '{}' has no value ({})", Shortened(key), where));
  }
}

/// Maps are merged key by key; anything else replaces what was there.
void Merge(const Json& from, const Json& from_places, Json* to, Json* to_places) {
  if (!from.is_object() || !to->is_object()) {
    *to = from;
    *to_places = from_places;
    return;
  }
  (*to_places)[""] = from_places[""];
  for (const auto& [name, value] : from.items())
    Merge(value, from_places[name], &(*to)[name], &(*to_places)[name]);
}

}  // namespace

void ConfigSource::Fill(const YAML::Node& node, const std::string& file, const std::string& where) {
  const auto line = [&](const YAML::Node& at) { return LineOf(at, file); };
  Convert(node, "", where, line, &tree_, &places_);
}

ConfigSource ConfigSource::FromString(const std::string& yaml, const std::string& name) {
  ConfigSource source;
  source.places_[""] = name;
  const YAML::Node root = Load(yaml, name);
  if (root.IsNull()) return source;
  if (!root.IsMap()) throw ConfigError(name + ": a config is a map of `key: value`");
  source.Fill(root, name, name);
  return source;
}

std::vector<ConfigSource> ConfigSource::ListFromString(const std::string& yaml,
                                                       const std::string& name) {
  std::vector<ConfigSource> sources;
  const auto require = [&](bool holds, const YAML::Node& at) {
    if (holds) return;
    throw ConfigError(LineOf(at, name) + ": a list of maps, each `- key: value`, is expected");
  };
  const YAML::Node root = Load(yaml, name);
  require(root.IsNull() || root.IsSequence(), root);
  for (const YAML::Node& item : root) {
    require(item.IsMap(), item);
    sources.emplace_back().Fill(item, name, LineOf(item, name));
  }
  return sources;
}

ConfigSource ConfigSource::FromFile(const std::string& path) {
  std::vector<std::string> chain;
  const std::function<ConfigSource(const std::string&)> read = [&](const std::string& file) {
    std::error_code error;
    const std::string canonical = std::filesystem::weakly_canonical(file, error).string();
    if (std::find(chain.begin(), chain.end(), canonical) != chain.end()) {
      throw ConfigError(fmt::format("{}: `inherits` comes back to this file", file));
    }
    chain.push_back(canonical);
    ConfigSource own = FromString(ReadFile(file, kMaxTextBytes), file), merged;
    merged.places_[""] = file;
    if (const Json* const inherits = own.Find("inherits")) {
      const std::vector<std::string> bases = LeafTexts(*inherits);
      if (bases.empty())
        throw ConfigError(fmt::format("inherits names no file ({})", own.WhereOf("inherits")));
      for (const std::string& base : bases) {
        std::string beside = (std::filesystem::path(file).parent_path() / base).string();
        if (const std::string there = FindInputFile(base);
            there != base && !std::filesystem::exists(beside, error))
          beside = there;
        const ConfigSource inherited = read(beside);
        Merge(inherited.tree_, inherited.places_, &merged.tree_, &merged.places_);
      }
      own.tree_.erase("inherits");
    }
    Merge(own.tree_, own.places_, &merged.tree_, &merged.places_);
    chain.pop_back();
    return merged;
  };
  return read(FindInputFile(path));
}

void ConfigSource::Set(const std::string& assignment, const std::string& where) {
  const std::size_t equals = assignment.find('=');
  if (equals == std::string::npos || equals == 0) {
    throw ConfigError(fmt::format("{0} {1}: KEY=VALUE is expected, as in {0} optimizer.lr=1e-3",
                                  where, assignment));
  }
  const std::string key = assignment.substr(0, equals);
  YAML::Node value;
  try {
    value = LoadYaml(assignment.substr(equals + 1));
  } catch (const YAML::Exception& e) {
    throw ConfigError(fmt::format("{} {}: {}", where, assignment, e.msg));
  }
  if (value.IsNull()) throw ConfigError(fmt::format("{} {}: there is no value", where, assignment));
  Json tree, places;
  Convert(
      value, key, where, [&](const YAML::Node&) { return where; }, &tree, &places);
  Put(key, tree, places);
}

void ConfigSource::Put(const std::string& key, const Json& tree, const Json& places) {
  Json *to = &tree_, *to_places = &places_;
  for (const std::string& step : Steps(key)) {
    Json* const below = step.empty() ? nullptr : Step(step, to);
    if (below == nullptr) {
      throw ConfigError(
          fmt::format("{}: there is no '{}' to set: {} ({})", Shortened(key),
                      Shortened(step.substr(step[0] == '[')),
                      to->is_array() ? fmt::format("the next item of its list is [{}]", to->size())
                                     : "groups have keys, and lists have items in brackets",
                      places.value("", "")));
    }
    to = below;
    to_places = &(*to_places)[step];
    if (!to_places->contains("")) (*to_places)[""] = places[""];
  }
  Merge(tree, places, to, to_places);
}

ConfigSource ConfigSource::Only(const std::vector<std::string>& beginnings) const {
  ConfigSource only;
  for (const auto& [key, leaf] : Leaves()) {
    const auto begins = [name = key](const std::string& text) { return name.rfind(text, 0) == 0; };
    if (std::any_of(beginnings.begin(), beginnings.end(), begins))
      only.Put(key, leaf, {{"", WhereOf(key)}});
  }
  return only;
}

const Json* ConfigSource::Find(const std::string& key) const {
  Json::json_pointer pointer;
  for (const std::string& step : Steps(key)) pointer /= step.substr(step.rfind('[', 0) == 0);
  return tree_.contains(pointer) ? &tree_.at(pointer) : nullptr;
}

std::string ConfigSource::WhereOf(const std::string& key) const {
  const Json* at = &places_;
  for (const std::string& step : Steps(key)) {
    if (!at->contains(step)) break;
    at = &(*at)[step];
  }
  return at->value("", "");
}

std::vector<std::pair<std::string, Json>> ConfigSource::Leaves() const { return LeavesOf(tree_); }

std::vector<std::pair<std::string, Json>> LeavesOf(const Json& tree, const std::string& key) {
  std::vector<std::pair<std::string, Json>> leaves;
  const auto append = [&](const Json& value, const std::string& name) {
    for (auto& leaf : LeavesOf(value, name)) leaves.push_back(std::move(leaf));
  };
  const auto is_scalar = [](const Json& item) { return item.is_primitive(); };
  if (tree.is_object()) {
    for (const auto& [name, value] : tree.items()) append(value, Joined(key, name));
  } else if (tree.is_array() && !std::all_of(tree.begin(), tree.end(), is_scalar)) {
    for (std::size_t i = 0; i < tree.size(); ++i) append(tree[i], fmt::format("{}[{}]", key, i));
  } else {
    leaves.emplace_back(key, tree);
  }
  return leaves;
}

std::vector<std::string> LeafTexts(const Json& leaf) {
  std::vector<std::string> texts;
  if (!leaf.is_array()) return {ScalarText(leaf)};
  for (const Json& item : leaf) texts.push_back(ScalarText(item));
  return texts;
}

std::string FlowText(const Json& leaf) {
  const std::string joined = fmt::format("{}", fmt::join(LeafTexts(leaf), ", "));
  return leaf.is_array() ? "[" + joined + "]" : joined;
}

namespace {

std::size_t EditDistance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j < row.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j < row.size(); ++j) {
      const std::size_t change = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, change});
    }
  }
  return row.back();
}

}  // namespace

std::string NearestKey(const std::string& key, const std::vector<std::string>& known) {
  constexpr std::size_t kLongestKey = 200;  // the time grows with the length
  if (key.size() > kLongestKey) return "";
  const auto last_part = [](const std::string& k) { return k.substr(k.rfind('.') + 1); };
  const std::string name = last_part(key);
  const bool grouped = name.size() < key.size();
  std::string best;
  // By the last part, or else by one of its words; then by the whole key.
  std::tuple<std::size_t, bool, std::size_t> least;
  for (const std::string& candidate : known) {
    const std::string other = last_part(candidate);
    if (other == name) return candidate;
    const std::size_t whole = EditDistance(name, other);
    std::size_t distance = whole;
    for (const std::string& word : Split(other, '_'))
      distance = std::min(distance, EditDistance(name, word));
    if (distance > name.size() / 2) continue;
    const std::tuple<std::size_t, bool, std::size_t> far{
        distance, distance < whole, grouped ? EditDistance(key, candidate) : 0};
    if (best.empty() || far < least) {
      least = far;
      best = candidate;
    } else if (far == least) {
      best += "' or '" + candidate;
    }
  }
  return best;
}

std::vector<ConfigDifference> FindDifferences(const std::string& before, const std::string& now) {
  const ConfigSource old = ConfigSource::FromString(before, "before");
  std::vector<ConfigDifference> differences;
  for (const auto& [key, leaf] : ConfigSource::FromString(now, "now").Leaves()) {
    const Json* const was = old.Find(key);
    if (was != nullptr && *was == leaf) continue;
    const auto text = [](const Json& of) {
      return fmt::format("{}", fmt::join(LeafTexts(of), ", "));
    };
    differences.push_back({key, was != nullptr ? text(*was) : "nothing", text(leaf)});
  }
  return differences;
}

namespace {

void Emit(const nlohmann::ordered_json& tree, YAML::Emitter* out) {
  if (tree.is_object()) {
    *out << YAML::BeginMap;
    for (const auto& [key, value] : tree.items()) {
      *out << YAML::Key << key << YAML::Value;
      Emit(value, out);
    }
    *out << YAML::EndMap;
  } else if (tree.is_array()) {
    if (tree.empty() || !tree.front().is_object()) *out << YAML::Flow;
    *out << YAML::BeginSeq;
    for (const auto& item : tree) Emit(item, out);
    *out << YAML::EndSeq;
  } else if (tree.is_string()) {
    *out << YAML::DoubleQuoted << tree.get<std::string>();
  } else {
    *out << ScalarText(tree);
  }
}

}  // namespace

std::string YamlText(const nlohmann::ordered_json& tree) {
  YAML::Emitter out;
  Emit(tree, &out);
  return std::string(out.c_str()) + "\n";
}

void KeyLister::Leaf(const std::string& name, const Json& value, const char* meaning,
                     const std::vector<Constraint>& checks) {
  std::string limits;
  for (const Constraint& check : checks) {
    if (!check.text.empty()) limits += (limits.empty() ? "; " : ", ") + check.text;
  }
  const std::string text = FlowText(value), shown = text.empty() ? "empty" : "`" + text + "`";
  text_ += fmt::format("- `{}{}` ({}{}): {}\n", prefix_, name, shown, limits, meaning);
}

}  // namespace volalign
