#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace YAML {
class Exception;
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
/// and, beyond a limit, the limit. All YAML of volalign is read by it.
YAML::Node LoadYaml(const std::string& text, YamlDocuments documents = YamlDocuments::kOne);

/// The number of a node. yaml-cpp itself would read it by the process's locale. Throws
/// YAML::BadConversion with the line unless it is finite.
double YamlNumber(const YAML::Node& node);
/// The numbers of a list. Throws as YamlNumber.
std::vector<double> YamlNumbers(const YAML::Node& list);

/// A description of the fault without the line. For a value of another kind, yaml-cpp says "bad
/// conversion", for a missing key "invalid node".
std::string YamlProblem(const YAML::Exception& error);
/// The same of the file `name`, with the line if it is known.
std::string YamlProblemIn(const std::string& name, const YAML::Exception& error);

}  // namespace volalign
