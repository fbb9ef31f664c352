#include "train/event_file.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include "core/file_util.h"
#include "tests/core/temp_folder.h"
#include "train/tensorboard_sink.h"

namespace volalign {
namespace {

TEST(Crc32c, HasTheKnownValues) {
  // RFC 3720, appendix B.4.
  EXPECT_EQ(Crc32c(std::string(32, '\0')), 0x8a9136aaU);
  EXPECT_EQ(Crc32c(std::string(32, '\xff')), 0x62a8ab43U);
  EXPECT_EQ(Crc32c("123456789"), 0xe3069283U);
  EXPECT_EQ(Crc32c(""), 0U);
}

/// The events of a file, by their framing alone.
std::vector<std::string> Records(const std::string& bytes) {
  std::vector<std::string> records;
  for (std::size_t at = 0; at < bytes.size();) {
    std::uint64_t length = 0;
    std::memcpy(&length, bytes.data() + at, 8);
    EXPECT_LE(at + 16 + length, bytes.size());
    records.push_back(bytes.substr(at + 12, length));
    at += 16 + length;
  }
  return records;
}

TEST(EventFile, WritesTheBytesOfTheProtocol) {
  const TempFolder folder;
  EventFile file(folder.path());
  file.Scalars(300, {{"a", 1.5}});
  const std::vector<std::string> records = Records(ReadFile(file.path()));
  ASSERT_EQ(records.size(), 2u);
  // Field 1, a double (the time), then by hand: field 3, "brain.Event:2".
  EXPECT_EQ(records[0].substr(9),
            "\x1a\x0d"
            "brain.Event:2");
  // Field 2: varint 300 = ac 02. Field 5, 10 bytes: field 1, 8 bytes: field 1 "a", field 2 1.5f.
  EXPECT_EQ(records[1].substr(9), std::string("\x10\xac\x02\x2a\x0a\x0a\x08\x0a\x01"
                                              "a\x15\x00\x00\xc0\x3f",
                                              15));
}

TEST(EventFile, LaterFilesSortAfterEarlierOnes) {
  const TempFolder folder;
  std::string before;
  for (int i = 0; i < 12; ++i) {
    const std::string name = EventFile(folder.path()).path().filename().string();
    EXPECT_LT(before, name);
    before = name;
  }
}

/// TensorBoard's own reader, where there is one: tests/train/tensorboard.sh installs it.
TEST(EventFile, IsReadByTensorBoard) {
  const std::filesystem::path python = "build/tensorboard/bin/python";
  if (!std::filesystem::exists(python)) {
    GTEST_SKIP() << python << " is missing: tests/train/tensorboard.sh installs TensorBoard there";
  }
  const TempFolder folder;
  ValidationResult result;
  result.miou = 0.25;
  LabelExample example{DepthImage(4, 3), LabelImage(4, 3), LabelImage(4, 3)};
  result.examples = {example, example};
  {
    TensorBoardSink sink(folder.path(), "run:\n  seed: 1\n", 0);
    for (std::int64_t samples = 10; samples <= 50; samples += 10) {
      TrainRow row;
      row.samples = samples;
      row.mean.loss = 100 + static_cast<double>(samples);
      sink.Train(row);
      sink.Validation({samples, samples, result});
    }
  }
  // Killed, and resumed from sample 30: what came after it is void.
  TensorBoardSink sink(folder.path(), "run:\n  seed: 1\n", 30);
  TrainRow row;
  row.samples = 40;
  row.mean.loss = 7;
  sink.Train(row);
  const int status = std::system(fmt::format("{} tests/train/tensorboard_check.py {} 2>&1",
                                             python.string(), folder.path().string())
                                     .c_str());
  EXPECT_EQ(status, 0);
}

}  // namespace
}  // namespace volalign
