#pragma once

#include <cstddef>
#include <string>

namespace YAML {
class Exception;
class Node;
}  // namespace YAML

namespace volalign {

/// No document of volalign's, nor of the programs that it reads files of, comes near these. What
/// an alias (*name) stands for counts each time: a few hundred bytes of aliases of aliases are
/// billions of nodes, and an alias inside its own anchor has no end.
inline constexpr std::size_t kMaxYamlNodes = 1'000'000;
inline constexpr int kMaxYamlDepth = 64;

/// Of a text with several documents (---): an error, since nothing would be said of the others; or
/// the first one, of streams that other programs write.
enum class YamlDocuments { kOne, kFirst };

/// YAML::Load within these limits and kMaxTextBytes. Throws YAML::ParserException, as that does,
/// with the line and, beyond a limit, the limit. The one way to YAML in volalign.
YAML::Node LoadYaml(const std::string& text, YamlDocuments documents = YamlDocuments::kOne);

/// What is wrong, in words, without the line: yaml-cpp says of a value of another kind "bad
/// conversion".
std::string YamlProblem(const YAML::Exception& error);

}  // namespace volalign
