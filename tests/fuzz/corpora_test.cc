// The inputs of fuzzing (tests/long/fuzz.sh), once more: each is read, or refused in one line; also
// where it is cut, or a key of it is misspelt.

#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <filesystem>
#include <iterator>
#include <map>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/fuzz/targets.h"

namespace volalign::corpora_test {
namespace {

namespace fs = std::filesystem;

constexpr char kCorpora[] = "tests/fuzz/corpus";

std::vector<FuzzTarget> Named(const std::set<std::string>& names) {
  std::vector<FuzzTarget> targets;
  for (const FuzzTarget& target : FuzzTargets()) {
    if (names.count(target.name) > 0) targets.push_back(target);
  }
  return targets;
}

/// The inputs of an archive by their names: those that fuzzing found have forty digits.
std::map<std::string, std::string> InputsOf(const FuzzTarget& target) {
  const TempFolder folder;
  const std::string unpack =
      std::string("tar -xf ") + kCorpora + "/" + target.name + ".tar -C " + folder.path().string();
  EXPECT_EQ(std::system(unpack.c_str()), 0);
  std::map<std::string, std::string> inputs;
  for (const fs::directory_entry& file : fs::directory_iterator(folder.path()))
    inputs[file.path().filename().string()] = ReadFile(file.path());
  return inputs;
}

class Corpora : public testing::TestWithParam<FuzzTarget> {
 protected:
  /// What refuses the bytes, one line; empty where they are read.
  static std::string MessageOf(const std::string& bytes) {
    const std::string message = ReadFuzzInput(GetParam(), bytes);
    EXPECT_EQ(std::count_if(message.begin(), message.end(),
                            [](char c) { return static_cast<unsigned char>(c) < 32 || c == 127; }),
              0)
        << message;
    return message;
  }

  /// The inputs made by hand that are read.
  static std::map<std::string, std::string> Good() {
    std::map<std::string, std::string> inputs = InputsOf(GetParam());
    for (auto input = inputs.begin(); input != inputs.end();) {
      const bool good = input->first.size() < 40 && MessageOf(input->second).empty();
      input = good ? std::next(input) : inputs.erase(input);
    }
    return inputs;
  }
};

TEST_P(Corpora, AreReadOrRefusedInOneLine) {
  int read = 0, refused = 0;
  for (const auto& [name, bytes] : InputsOf(GetParam())) {
    SCOPED_TRACE(name);
    ++(MessageOf(bytes).empty() ? read : refused);
  }
  // A network that can be read has more than the 64 KiB of an input.
  EXPECT_TRUE(read > 0 || GetParam().name == std::string("onnx"));
  EXPECT_GT(refused, 0);
}

/// Whose files say where they end. Others have lines, messages or frames, of which some are read.
const std::set<std::string> kWhole = {"capture",    "cwipc",       "exr",  "extrinsics",
                                      "image",      "metadata",    "npy",  "open3d",
                                      "poses_json", "safetensors", "tiff", "unity"};

// Wherever they are cut; the last five bytes may say no more than that nothing follows.
TEST_P(Corpora, AreReadOrRefusedWhereTheyAreCut) {
  const bool whole = kWhole.count(GetParam().name) > 0;
  for (const auto& [name, bytes] : Good()) {
    constexpr std::size_t kCuts = 60;
    for (std::size_t cut = 0; cut < kCuts; ++cut) {
      const std::size_t size = bytes.size() * cut / kCuts;
      const bool refused = !MessageOf(bytes.substr(0, size)).empty();
      EXPECT_TRUE(refused || !whole || size + 5 >= bytes.size()) << name << " of " << size;
    }
  }
}

/// Where each key ends: before a colon, and in JSON before its quote. Comments of YAML have none.
std::vector<std::size_t> KeyEnds(const std::string& text) {
  std::vector<std::size_t> ends;
  const bool json = text[0] == '{';
  bool comment = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    comment = text[i] != '\n' && (comment || (!json && text[i] == '#'));
    const std::size_t end = json ? i - 1 : i;
    if (text[i] == ':' && !comment && i > 1 && (!json || text[end] == '"')) ends.push_back(end);
  }
  return ends;
}

class OwnFormats : public Corpora {};

// A misspelt key is named, or that which is missing then.
TEST_P(OwnFormats, NameTheKeyThatIsMisspelt) {
  // Sensors are no keys, and a kind of sensor is known by these two.
  const std::set<std::string> others = {"KA03_Depth", "KAX1_Depth", "kind", "like"};
  for (const auto& [name, text] : Good()) {
    const std::size_t stages = text.find('{', text.find("\"timings_s\""));  // no keys, either
    for (const std::size_t end : KeyEnds(text)) {
      const std::size_t begin = text.find_last_of(" {,\"\n", end - 1) + 1;
      const std::string key = text.substr(begin, end - begin);
      if (others.count(key) > 0 || (end > stages && end < text.find('}', stages))) continue;
      std::string changed = text;
      const std::string message = MessageOf(changed.insert(end, "x"));
      EXPECT_TRUE(Has(message, key)) << name;
      const bool unknown = Has(message, key + "x\"") || Has(message, key + "x'");
      EXPECT_TRUE(!unknown || Has(message, "did you mean")) << message;
    }
  }
}

const auto kNameOf = [](const auto& target) { return std::string(target.param.name); };
INSTANTIATE_TEST_SUITE_P(All, Corpora, testing::ValuesIn(FuzzTargets()), kNameOf);
INSTANTIATE_TEST_SUITE_P(All, OwnFormats,
                         testing::ValuesIn(Named({"capture", "extrinsics", "metadata", "options",
                                                  "pool", "rig", "structure"})),
                         kNameOf);

TEST(ReadFuzzInput, WantsTheSameMessageTwice) {
  const FuzzTarget changing = {"changing", [](const std::string&) {
                                 static int reading = 0;
                                 throw DataError(std::to_string(++reading));
                               }};
  EXPECT_THROW(ReadFuzzInput(changing, ""), std::logic_error);
  const FuzzTarget steady = {"steady", [](const std::string&) { throw DataError("bad"); }};
  EXPECT_EQ(ReadFuzzInput(steady, ""), "bad");
}

// An archive that no target reads would be tested by nobody.
TEST(CorpusArchives, AreThoseOfTheTargets) {
  std::set<std::string> archives, names;
  for (const fs::directory_entry& archive : fs::directory_iterator(kCorpora))
    archives.insert(archive.path().filename().string());
  for (const FuzzTarget& target : FuzzTargets()) names.insert(std::string(target.name) + ".tar");
  EXPECT_EQ(archives, names);
}

}  // namespace
}  // namespace volalign::corpora_test
