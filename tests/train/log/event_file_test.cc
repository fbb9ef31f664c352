#include "train/log/event_file.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "core/base/file_util.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::event_file_test {
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

}  // namespace
}  // namespace volalign::event_file_test
