#include "core/config/bounded_yaml.h"

#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/config/config.h"
#include "tests/core/base/expect_error.h"

namespace volalign::bounded_yaml_test {
namespace {

/// Ten keys, of which each has ten aliases of the one before it: 10^10 values in 499 bytes.
std::string Laughs(const std::string& begin, const std::string& item, const std::string& end) {
  std::string text = "a0: &a0 1\n";
  for (int level = 1; level <= 10; ++level) {
    text += "a" + std::to_string(level) + ": &a" + std::to_string(level) + " " + begin;
    for (int i = 0; i < 10; ++i) {
      if (i > 0) text += ", ";
      text +=
          (item.empty() ? "" : item + std::to_string(i) + ": ") + "*a" + std::to_string(level - 1);
    }
    text += end + "\n";
  }
  return text;
}

std::string Nested(int levels) {
  return std::string(static_cast<std::size_t>(levels), '[') +
         std::string(static_cast<std::size_t>(levels), ']');
}

TEST(LoadYaml, CountsWhatAliasesStandFor) {
  ExpectError<YAML::ParserException>([] { LoadYaml(Laughs("[", "", "]")); }, {"1000000", "alias"});
  ExpectError<YAML::ParserException>([] { LoadYaml(Laughs("{", "k", "}")); }, {"1000000", "alias"});
  EXPECT_EQ(LoadYaml("a: &a [1, 2]\nb: *a")["b"][1].as<int>(), 2);
}

TEST(LoadYaml, LimitsDepthAndSize) {
  EXPECT_EQ(LoadYaml(Nested(kMaxYamlDepth)).size(), 1u);
  for (const int levels : {kMaxYamlDepth + 2, 200'000})
    ExpectError<YAML::ParserException>([&] { LoadYaml(Nested(levels)); }, {"64 levels"});
  ExpectError<YAML::ParserException>([] { LoadYaml("a: &a [*a]"); }, {"64 levels"});
  ExpectError<YAML::ParserException>([] { LoadYaml(std::string(kMaxTextBytes + 1, ' ')); },
                                     {"bytes"});
}

TEST(LoadYaml, ReadsOneDocumentAndSaysSo) {
  EXPECT_EQ(LoadYaml("---\na: 1\n...\n")["a"].as<int>(), 1);
  EXPECT_TRUE(LoadYaml("").IsNull());
  ExpectError<YAML::ParserException>([] { LoadYaml("a: 1\n---\na: 2\n"); },
                                     {"line 3", "second document"});
  EXPECT_EQ(LoadYaml("a: 1\n---\na: 2\n", YamlDocuments::kFirst)["a"].as<int>(), 1);
}

TEST(YamlProblem, SaysWhatABadConversionIs) {
  try {
    LoadYaml("a: [0 500]")["a"].as<std::vector<double>>();
    ADD_FAILURE() << "nothing was thrown";
  } catch (const YAML::Exception& error) {
    EXPECT_NE(YamlProblem(error).find("commas between its items"), std::string::npos);
  }
}

// A recipe, a rig or options: 10^10 keys of a few hundred bytes.
TEST(ConfigSource, EndsWithAliasedMaps) {
  ExpectError<ConfigError>([] { ConfigSource::FromString(Laughs("{", "k", "}"), "a.yaml"); },
                           {"a.yaml:", "1000000"});
}

}  // namespace
}  // namespace volalign::bounded_yaml_test
