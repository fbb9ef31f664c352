#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>

namespace YAML {
class Node;
}  // namespace YAML

namespace volalign {

/// Limits far above all documents of volalign and of the programs whose files it reads. An alias
/// (*name) counts each time. Otherwise, with an alias inside another, a few hundred bytes would be
/// billions of nodes, and one inside its own anchor would never end.
inline constexpr std::size_t kMaxYamlNodes = 1'000'000;
inline constexpr int kMaxYamlDepth = 64;

/// For a text with several documents (---): kOne refuses it, so that none is ignored. kFirst takes
/// the first one, for streams of other programs.
enum class YamlDocuments { kOne, kFirst };

/// YAML::Load within these limits and kMaxTextBytes. Throws YAML::ParserException with the line
/// and, beyond a limit, the limit. All YAML is read by it.
YAML::Node LoadYaml(const std::string& text, YamlDocuments documents = YamlDocuments::kOne);

/// A document of another program as a tree: maps are objects, sequences arrays, and scalars
/// strings, but for finite numbers outside of quotes. Throws DataError with `name` and, if it is
/// known, the line, also for a key that stands twice.
nlohmann::json YamlTree(const std::string& text, const std::string& name,
                        YamlDocuments documents = YamlDocuments::kFirst);

}  // namespace volalign
