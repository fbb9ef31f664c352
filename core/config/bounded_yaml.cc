#include "core/config/bounded_yaml.h"

#include <fmt/format.h>
#include <yaml-cpp/depthguard.h>
#include <yaml-cpp/yaml.h>

#include <vector>

#include "core/base/error.h"
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

nlohmann::json TreeOf(const YAML::Node& node) {
  nlohmann::json tree;
  if (node.IsScalar()) {
    tree = node.Scalar();
    const bool quoted = node.Tag() == "!";
    if (const auto number = NumberOf(node.Scalar()); number && !quoted) tree = *number;
  } else if (node.IsSequence()) {
    tree = nlohmann::json::array();
    for (const YAML::Node& item : node) tree.push_back(TreeOf(item));
  } else if (node.IsMap()) {
    tree = nlohmann::json::object();
    for (const auto& item : node) {
      if (!tree.emplace(item.first.Scalar(), TreeOf(item.second)).second)
        throw YAML::ParserException(item.first.Mark(), "a key stands twice, or two are no words");
    }
  }
  return tree;
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

nlohmann::json YamlTree(const std::string& text, const std::string& name, YamlDocuments documents) {
  try {
    return TreeOf(LoadYaml(text, documents));
  } catch (const YAML::Exception& error) {
    const std::string line =
        error.mark.is_null() ? "" : fmt::format(" line {}:", error.mark.line + 1);
    throw DataError(fmt::format("{}:{} {}", name, line, error.msg));
  }
}

}  // namespace volalign
