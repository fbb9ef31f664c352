#include "core/config/bounded_yaml.h"

#include <fmt/format.h>
#include <yaml-cpp/depthguard.h>
#include <yaml-cpp/yaml.h>

#include <optional>
#include <vector>

#include "core/base/file_limits.h"
#include "core/base/number.h"

namespace volalign {

namespace {

YAML::ParserException TooDeep(const YAML::Mark& mark) {
  return {mark, fmt::format("nested deeper than the {} levels that are read", kMaxYamlDepth)};
}

void Count(const YAML::Node& node, int depth, std::size_t* nodes) {
  if (depth > kMaxYamlDepth) throw TooDeep(node.Mark());
  if (++*nodes > kMaxYamlNodes) {
    throw YAML::ParserException(
        node.Mark(), fmt::format("more than the {} values that are read, with those that aliases "
                                 "(*name) stand for",
                                 kMaxYamlNodes));
  }
  if (node.IsSequence()) {
    for (const YAML::Node& item : node) Count(item, depth + 1, nodes);
  } else if (node.IsMap()) {
    for (const auto& item : node) {
      Count(item.first, depth + 1, nodes);
      Count(item.second, depth + 1, nodes);
    }
  }
}

}  // namespace

YAML::Node LoadYaml(const std::string& text, YamlDocuments documents) {
  if (text.size() > kMaxTextBytes) {
    throw YAML::ParserException(
        YAML::Mark::null_mark(),
        fmt::format("more than the {} bytes that are read of YAML", kMaxTextBytes));
  }
  std::vector<YAML::Node> read;
  try {
    if (documents == YamlDocuments::kFirst) {
      read.push_back(YAML::Load(text));
    } else {
      read = YAML::LoadAll(text);
    }
  } catch (const YAML::DeepRecursion& deeper) {  // than yaml-cpp itself goes
    throw TooDeep(deeper.mark);
  }
  if (read.size() > 1) {
    throw YAML::ParserException(
        read[1].Mark(), "a second document begins here (---), and one is read; remove the others");
  }
  const YAML::Node root = read.empty() ? YAML::Node() : read.front();
  std::size_t nodes = 0;
  Count(root, 0, &nodes);
  return root;
}

double YamlNumber(const YAML::Node& node) {
  const std::optional<double> number = NumberOf(node.Scalar());
  if (!number) throw YAML::BadConversion(node.Mark());
  return *number;
}

std::vector<double> YamlNumbers(const YAML::Node& list) {
  if (!list.IsSequence()) throw YAML::BadConversion(list.Mark());
  std::vector<double> numbers;
  for (const YAML::Node& item : list) numbers.push_back(YamlNumber(item));
  return numbers;
}

std::string YamlProblem(const YAML::Exception& error) {
  if (dynamic_cast<const YAML::InvalidNode*>(&error) != nullptr) {
    const std::size_t key = error.msg.find('"');
    return key == std::string::npos ? "a key is missing"
                                    : fmt::format("the key {} is missing", error.msg.substr(key));
  }
  if (dynamic_cast<const YAML::BadConversion*>(&error) == nullptr) return error.msg;
  return "a value is of another kind than is expected: a number, a text, or a list in [], with "
         "commas "
         "between its items";
}

std::string YamlProblemIn(const std::string& name, const YAML::Exception& error) {
  if (error.mark.is_null()) return fmt::format("{}: {}", name, YamlProblem(error));
  return fmt::format("{}: line {}: {}", name, error.mark.line + 1, YamlProblem(error));
}

}  // namespace volalign
