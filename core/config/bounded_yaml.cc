#include "core/config/bounded_yaml.h"

#include <fmt/format.h>
#include <yaml-cpp/depthguard.h>
#include <yaml-cpp/yaml.h>

#include "core/base/file_limits.h"

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

YAML::Node LoadYaml(const std::string& text) {
  if (text.size() > kMaxTextBytes) {
    throw YAML::ParserException(
        YAML::Mark::null_mark(),
        fmt::format("more than the {} bytes that are read of YAML", kMaxTextBytes));
  }
  YAML::Node root;
  try {
    root = YAML::Load(text);
  } catch (const YAML::DeepRecursion& deeper) {  // than yaml-cpp itself goes
    throw TooDeep(deeper.mark);
  }
  std::size_t nodes = 0;
  Count(root, 0, &nodes);
  return root;
}

}  // namespace volalign
