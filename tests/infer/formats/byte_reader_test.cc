#include "infer/formats/byte_reader.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <string_view>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"

namespace volalign::formats_internal {
namespace {

using std::string_view_literals::operator""sv;  // NOLINT(misc-unused-using-decls): it is used

TEST(ByteReader, TakesLittleEndianValuesInOrder) {
  const std::string name = "a.mcap";
  ByteReader reader(
      "\x02\x01\xff\x00\x00\x00\x80\x03\x00\x00\x00"
      "abcde"sv,
      name);
  EXPECT_EQ(reader.Value<std::uint16_t>(), 0x0102);
  EXPECT_EQ(reader.Value<std::uint8_t>(), 0xff);
  EXPECT_EQ(reader.Value<std::int32_t>(), std::int32_t{-0x7fffffff} - 1);
  EXPECT_EQ(reader.left(), 9u);
  EXPECT_EQ(reader.Block(), "abc");
  EXPECT_EQ(reader.Take(2), "de");
  EXPECT_EQ(reader.Take(0), "");
  EXPECT_EQ(reader.left(), 0u);
}

TEST(ByteReader, GivesNothingBeyondTheEnd) {
  const std::string name = "a.mcap";
  for (const std::string_view bytes : {""sv, "\x01\x00\x00"sv,
                                       "\x05\x00\x00\x00"
                                       "abcd"sv,
                                       "\xff\xff\xff\xff"
                                       "a"sv}) {
    ByteReader reader(bytes, name);
    ExpectError<DataError>([&] { reader.Block(); }, {"a.mcap: damaged", "are there"});
  }
  // What was refused is still there.
  ByteReader reader("abc"sv, name);
  ExpectError<DataError>([&] { reader.Take(SIZE_MAX); }, {"3 are there"});
  ExpectError<DataError>([&] { reader.Value<double>(); }, {"8 bytes are announced"});
  EXPECT_EQ(reader.Take(3), "abc");
}

}  // namespace
}  // namespace volalign::formats_internal
