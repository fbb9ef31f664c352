#include "core/config/config.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <functional>
#include <mutex>
#include <set>
#include <system_error>

#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "core/base/number.h"
#include "core/base/text.h"
#include "core/config/bounded_yaml.h"

namespace volalign {

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

namespace config_internal {

std::string NumberText(double value) {
  if (std::isnan(value)) return ".nan";
  if (std::isinf(value)) return value > 0 ? ".inf" : "-.inf";
  return fmt::format("{}", value);
}

namespace {
[[noreturn]] void BadType(const std::string& text, const char* type, const std::string& key,
                          const std::string& where) {
  throw ConfigError(
      fmt::format("{} = '{}' is not {} ({})", Shortened(key), Shortened(text), type, where));
}
}  // namespace

bool ParseBool(const std::string& text, const std::string& key, const std::string& where) {
  if (text == "true" || text == "yes" || text == "on") return true;
  if (text == "false" || text == "no" || text == "off") return false;
  BadType(text, "true or false", key, where);
}

std::int64_t ParseInt(const std::string& text, const std::string& key, const std::string& where) {
  std::int64_t value = 0;
  const char* end = text.data() + text.size();
  const auto result = std::from_chars(text.data(), end, value);
  if (result.ec == std::errc() && result.ptr == end) return value;
  // 3.2e6 is a whole number too.
  const double real = ParseDouble(text, key, where);
  if (real != std::floor(real) || std::abs(real) > 9e15)
    BadType(text, "a whole number", key, where);
  return static_cast<std::int64_t>(real);
}

double ParseDouble(const std::string& text, const std::string& key, const std::string& where) {
  if (const std::optional<double> value = NumberOf(text)) return *value;
  BadType(text, "a finite number", key, where);
}

void CheckRange(std::int64_t value, std::int64_t low, std::uint64_t high, const std::string& key,
                const std::string& where) {
  if (value < low || (value > 0 && static_cast<std::uint64_t>(value) > high)) {
    throw ConfigError(
        fmt::format("{} = {} does not fit into [{}, {}] ({})", key, value, low, high, where));
  }
}

void Check(const std::string& text, std::optional<double> number,
           const std::vector<Constraint>& constraints, const std::string& key,
           const std::string& where) {
  for (const Constraint& constraint : constraints) {
    if (number ? !constraint.number || constraint.number(*number)
               : !constraint.word || constraint.word(text))
      continue;
    throw ConfigError(fmt::format("{} = {} violates {} {} ({})", key, Shortened(text), key,
                                  constraint.text, where));
  }
}

}  // namespace config_internal

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
  const std::string text = config_internal::NumberText(value);
  return Removed(std::move(name), "it is " + text + " now; leave the key out",
                 std::vector<std::string>{text});
}

namespace {

using Leaves = std::map<std::string, ConfigSource::Leaf>;

class Flattener {
 public:
  /// Without `lines`, `name` is the place of every key.
  Flattener(const std::string& name, Leaves* leaves, bool lines = true)
      : name_(name), lines_(lines), leaves_(leaves) {}

  void Map(const YAML::Node& node, const std::string& prefix) {
    std::set<std::string> seen;
    for (const auto& item : node) {
      const std::string where = Where(item.first);
      if (!item.first.IsScalar()) throw ConfigError(where + ": a key has to be a word");
      const std::string key = prefix + item.first.Scalar();
      if (!seen.insert(key).second) FailTwice(key, where);
      Value(item.second, key, where);
    }
  }

  void Value(const YAML::Node& value, const std::string& key, const std::string& where) {
    if (value.IsScalar()) {
      Insert(key, {{value.Scalar()}, false, where});
    } else if (value.IsMap()) {
      Map(value, key + ".");
    } else if (value.IsSequence()) {
      ConfigSource::Leaf leaf{{}, true, where};
      std::size_t index = 0;
      for (const YAML::Node& element : value) {
        if (element.IsScalar()) {
          leaf.values.push_back(element.Scalar());
        } else {
          Value(element, fmt::format("{}[{}]", key, index), Where(element));
        }
        ++index;
      }
      if (index == leaf.values.size()) {
        Insert(key, std::move(leaf));
      } else if (!leaf.values.empty()) {
        throw ConfigError(
            fmt::format("{}: the list mixes single values with maps or lists ({})", key, where));
      }
    } else {
      throw ConfigError(fmt::format("key '{}' has no value ({})", Shortened(key), where));
    }
  }

 private:
  std::string Where(const YAML::Node& at) const {
    return lines_ ? fmt::format("{}:{}", name_, at.Mark().line + 1) : name_;
  }
  [[noreturn]] static void FailTwice(const std::string& key, const std::string& where) {
    throw ConfigError(fmt::format("key '{}' stands twice ({})", Shortened(key), where));
  }
  void Insert(const std::string& key, ConfigSource::Leaf leaf) {
    const std::string where = leaf.where;
    if (!leaves_->emplace(key, std::move(leaf)).second) FailTwice(key, where);
  }

  const std::string& name_;
  const bool lines_;
  Leaves* leaves_;
};

/// Erases a list: its own leaf, and those of its items that `over` has not.
void EraseList(const std::string& key, const Leaves& over, Leaves* leaves) {
  leaves->erase(key);
  const std::string items = key + "[";
  for (auto it = leaves->lower_bound(items);
       it != leaves->end() && it->first.compare(0, items.size(), items) == 0;)
    it = over.count(it->first) ? std::next(it) : leaves->erase(it);
}

YAML::Node Load(const std::string& yaml, const std::string& name) {
  try {
    return LoadYaml(yaml);
  } catch (const YAML::Exception& e) {
    throw ConfigError(fmt::format("{}:{}: {}", name, e.mark.line + 1, YamlProblem(e)));
  }
}

}  // namespace

ConfigSource ConfigSource::FromString(const std::string& yaml, const std::string& name) {
  ConfigSource source;
  source.name_ = name;
  const YAML::Node root = Load(yaml, name);
  if (root.IsNull()) return source;
  if (!root.IsMap()) throw ConfigError(name + ": a config is a map of `key: value`");
  Flattener(name, &source.leaves_).Map(root, "");
  return source;
}

std::vector<ConfigSource> ConfigSource::ListFromString(const std::string& yaml,
                                                       const std::string& name) {
  std::vector<ConfigSource> sources;
  const auto require = [&](bool holds, const YAML::Node& at) {
    if (holds) return;
    throw ConfigError(fmt::format("{}:{}: a list of maps, each `- key: value`, is expected", name,
                                  at.Mark().line + 1));
  };
  const YAML::Node root = Load(yaml, name);
  require(root.IsNull() || root.IsSequence(), root);
  for (const YAML::Node& item : root) {
    require(item.IsMap(), item);
    sources.emplace_back().name_ = fmt::format("{}:{}", name, item.Mark().line + 1);
    Flattener(name, &sources.back().leaves_).Map(item, "");
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
    merged.name_ = file;
    if (const auto inherits = own.leaves_.extract("inherits"); !inherits.empty()) {
      const Leaf& bases = inherits.mapped();
      if (bases.values.empty())
        throw ConfigError(fmt::format("inherits names no file ({})", bases.where));
      for (const std::string& base : bases.values) {
        std::string beside = (std::filesystem::path(file).parent_path() / base).string();
        if (const std::string there = FindInputFile(base);
            there != base && !std::filesystem::exists(beside, error))
          beside = there;
        merged.Merge(read(beside));
      }
    }
    merged.Merge(own);
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
  Leaves given;
  YAML::Node value;
  try {
    value = LoadYaml(assignment.substr(equals + 1));
  } catch (const YAML::Exception& e) {
    throw ConfigError(fmt::format("{} {}: {}", where, assignment, YamlProblem(e)));
  }
  if (value.IsNull()) throw ConfigError(fmt::format("{} {}: there is no value", where, assignment));
  Flattener(where, &given, /*lines=*/false).Value(value, key, where);
  // A list replaces earlier values. An item of the list replaces its being empty.
  if (value.IsSequence()) {
    EraseList(key, {}, &leaves_);
  } else if (key.find('[') != std::string::npos) {
    leaves_.erase(key.substr(0, key.find('[')));
  }
  for (const auto& [name, leaf] : given) leaves_[name] = leaf;
}

ConfigSource ConfigSource::Only(const std::vector<std::string>& beginnings) const {
  ConfigSource only;
  for (const auto& leaf : leaves_) {
    const auto begins = [&](const std::string& text) { return leaf.first.rfind(text, 0) == 0; };
    if (std::any_of(beginnings.begin(), beginnings.end(), begins)) only.leaves_.insert(leaf);
  }
  return only;
}

void ConfigSource::Merge(const ConfigSource& over) {
  for (const auto& [key, leaf] : over.leaves_) {
    // A list of maps replaces the inherited list as a whole; so does an empty list.
    std::size_t bracket = key.find("[0].");
    if (bracket == std::string::npos && leaf.is_sequence) bracket = key.size();
    if (bracket != std::string::npos) EraseList(key.substr(0, bracket), over.leaves_, &leaves_);
    leaves_[key] = leaf;
  }
}

const std::pair<const std::string, ConfigSource::Leaf>* ConfigSource::Find(
    const std::string& key) const {
  for (auto leaf = leaves_.lower_bound(key);
       leaf != leaves_.end() && leaf->first.compare(0, key.size(), key) == 0; ++leaf) {
    const char next = leaf->first.c_str()[key.size()];
    if (key.empty() || next == '\0' || next == '.' || next == '[') return &*leaf;
  }
  return nullptr;
}

std::string ConfigSource::WhereOf(std::string key) const {
  for (;;) {
    if (const auto* leaf = Find(key)) return leaf->second.where;
    if (key.empty()) return name_;
    const std::size_t end = key.find_last_of(".[");
    key.resize(end == std::string::npos ? 0 : end);
  }
}

std::optional<std::string> ConfigReader::NameInSource(const std::string& name,
                                                      const std::vector<Constraint>& checks) {
  for (const Constraint& check : checks) {
    if (check.required && complete_ && source_.Find(prefix_ + name) == nullptr) {
      known_.insert(prefix_ + name);
      if (missing_.empty())
        missing_ = fmt::format("key '{}{}' is missing ({})", prefix_, name,
                               source_.WhereOf(prefix_ + name));
      return std::nullopt;
    }
    if (!check.removed_name.empty()) {
      const auto* removed = source_.Find(prefix_ + check.removed_name);
      if (removed == nullptr) continue;
      if (check.harmless == removed->second.values) {
        known_.insert(removed->first);
        continue;
      }
      throw ConfigError(fmt::format("{}{} ({}) is no longer a key: {}", prefix_, check.removed_name,
                                    removed->second.where, check.instead));
    }
    if (check.former_name.empty()) continue;
    const auto* former = source_.Find(prefix_ + check.former_name);
    if (former == nullptr) continue;
    const std::string was = prefix_ + check.former_name, is = prefix_ + name;
    if (const auto* present = source_.Find(is)) {
      throw ConfigError(fmt::format("{} ({}) is the former name of {} ({}): leave one of them out",
                                    was, former->second.where, is, present->second.where));
    }
    // A configuration in a file is read again from its saved copy, so warn once.
    static std::mutex mutex;
    static std::set<std::string> warned;
    const std::lock_guard<std::mutex> lock(mutex);
    if (warned.insert(was + " " + is).second)
      fmt::print(stderr, "warning: {} ({}) is now called {}\n", was, former->second.where, is);
    return check.former_name;
  }
  return name;
}

const ConfigSource::Leaf* ConfigReader::Find(const std::string& key, bool sequence) {
  known_.insert(key);
  const auto found = source_.leaves_.find(key);
  if (found == source_.leaves_.end()) {
    if (const auto nested = source_.leaves_.find(key + "[0]"); nested != source_.leaves_.end()) {
      throw ConfigError(
          fmt::format("{}: a nested list is not expected ({})", key, nested->second.where));
    }
    return nullptr;
  }
  // A single value for a list is a list of one.
  if (found->second.is_sequence && !sequence) {
    throw ConfigError(
        fmt::format("{} wants a single value, not a list ({})", key, found->second.where));
  }
  return &found->second;
}

bool ConfigReader::IsEmptyList(const std::string& key) {
  known_.insert(key);
  const auto found = source_.leaves_.find(key);
  if (found == source_.leaves_.end()) return false;
  if (!found->second.is_sequence || !found->second.values.empty()) {
    throw ConfigError(
        fmt::format("{} wants a list of maps, as in [{{name: a}}] ({})", key, found->second.where));
  }
  return true;
}

void ConfigReader::RequireSize(const ConfigSource::Leaf& leaf, std::size_t size,
                               const std::string& key) {
  if (leaf.values.size() != size) {
    throw ConfigError(
        fmt::format("{} = [{}] has {} values; {} are expected, with commas between them ({})", key,
                    Shortened(fmt::format("{}", fmt::join(leaf.values, ", "))), leaf.values.size(),
                    size, leaf.where));
  }
}

int ConfigReader::CountItems(const std::string& key) const {
  const std::string prefix = key + "[";
  std::uint64_t count = 0;
  while (source_.Find(fmt::format("{}{}]", prefix, count))) ++count;
  for (auto it = source_.leaves_.lower_bound(prefix);
       it != source_.leaves_.end() && it->first.compare(0, prefix.size(), prefix) == 0; ++it) {
    std::uint64_t index = count;
    const char* const end = it->first.data() + it->first.size();
    const auto [rest, error] = std::from_chars(it->first.data() + prefix.size(), end, index);
    if (error != std::errc() || rest == end || *rest != ']' || index >= count) {
      throw ConfigError(
          fmt::format("indices of {} have to be 0, 1, 2, ... without gaps: {}[{}] is missing ({})",
                      it->first, key, count, it->second.where));
    }
  }
  return static_cast<int>(count);
}

void ConfigReader::RejectUnknown() const {
  const std::vector<std::string> known(known_.begin(), known_.end());
  for (const auto& [key, leaf] : source_.leaves_) {
    if (known_.count(key)) continue;
    std::string hint;
    if (const std::string nearest = NearestKey(key, known); !nearest.empty()) {
      hint = fmt::format("; did you mean '{}'?", nearest);
    } else if (const std::size_t dot = key.rfind('.'); dot != std::string::npos) {
      const std::string group = key.substr(0, dot);
      std::vector<std::string> members;
      for (const std::string& other : known) {
        if (other.rfind('.') == dot && other.compare(0, dot, group) == 0)
          members.push_back(other.substr(dot + 1));
      }
      if (!members.empty()) hint = fmt::format("; {} has {}", group, fmt::join(members, ", "));
    }
    throw ConfigError(fmt::format("unknown key '{}' ({}){}", Shortened(key), leaf.where, hint));
  }
  if (!missing_.empty()) throw ConfigError(missing_);
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
  const ConfigSource current = ConfigSource::FromString(now, "now");
  std::vector<ConfigDifference> differences;
  for (const auto& [key, leaf] : current.leaves()) {
    const auto found = old.leaves().find(key);
    const bool known = found != old.leaves().end();
    if (known && found->second.values == leaf.values) continue;
    differences.push_back(
        {key, known ? fmt::format("{}", fmt::join(found->second.values, ", ")) : "nothing",
         fmt::format("{}", fmt::join(leaf.values, ", "))});
  }
  return differences;
}

std::string ConfigWriter::Word(const std::string& word) const {
  if (form_ == Form::kMarkdown) return word;
  YAML::Emitter emitter;
  emitter << YAML::DoubleQuoted << word;
  return emitter.c_str();
}

void ConfigWriter::Line(const std::string& text) {
  text_ += begin_ + text + "\n";
  std::replace(begin_.begin(), begin_.end(), '-', ' ');
}

void ConfigWriter::Leaf(const std::string& name, const std::string& value, const char* doc,
                        const std::vector<Constraint>& checks) {
  if (form_ == Form::kYaml) return Line(name + ": " + value);
  std::string limits;
  for (const Constraint& check : checks) {
    if (!check.text.empty()) limits += (limits.empty() ? "; " : ", ") + check.text;
  }
  const std::string shown = value.empty() ? "empty" : "`" + value + "`";
  text_ +=
      MarkdownParagraph(fmt::format("`{}{}` ({}{}): {}", begin_, name, shown, limits, doc), "- ");
}

}  // namespace volalign
