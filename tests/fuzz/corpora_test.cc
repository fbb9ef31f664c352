// The inputs that fuzzing found (tests/long/fuzz.sh), once more: each is read, or refused in one
// line.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <set>
#include <stdexcept>
#include <string>

#include "core/base/error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/fuzz/targets.h"

namespace volalign::corpora_test {
namespace {

namespace fs = std::filesystem;

constexpr char kCorpora[] = "tests/fuzz/corpus";

class Corpora : public testing::TestWithParam<FuzzTarget> {};

TEST_P(Corpora, AreReadOrRefusedInOneLine) {
  const TempFolder inputs;
  const std::string unpack = std::string("tar -xf ") + kCorpora + "/" + GetParam().name +
                             ".tar -C " + inputs.path().string();
  ASSERT_EQ(std::system(unpack.c_str()), 0);
  int read = 0, refused = 0;
  for (const fs::directory_entry& file : fs::directory_iterator(inputs.path())) {
    SCOPED_TRACE(file.path().string());
    const std::string message = ReadFuzzInput(GetParam(), ReadFile(file.path()));
    EXPECT_EQ(std::count_if(message.begin(), message.end(),
                            [](char c) { return static_cast<unsigned char>(c) < 32 || c == 127; }),
              0)
        << message;
    ++(message.empty() ? read : refused);
  }
  // A network that can be read has more than the 64 KiB of an input.
  if (GetParam().name != std::string("onnx")) {
    EXPECT_GT(read, 0);
  }
  EXPECT_GT(refused, 0);
}

INSTANTIATE_TEST_SUITE_P(All, Corpora, testing::ValuesIn(FuzzTargets()),
                         [](const auto& target) { return std::string(target.param.name); });

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
