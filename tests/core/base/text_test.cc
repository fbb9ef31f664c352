#include "core/base/text.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <stdexcept>
#include <string>
#include <system_error>

#include "core/base/error.h"
#include "core/base/sentence.h"
#include "tests/core/base/expect_error.h"

namespace volalign::text_test {
namespace {

using Parts = std::vector<std::string>;

TEST(Text, Splits) {
  EXPECT_EQ(Split("a,,b,", ','), (Parts{"a", "", "b", ""}));
  EXPECT_EQ(Split("", ','), Parts{""});
}

TEST(Text, IndentsLinesThatHoldSomething) {
  EXPECT_EQ(Indented("a:\n\n  b: 1", "  "), "  a:\n\n    b: 1\n");
  EXPECT_EQ(Indented("", "  "), "");
}

TEST(Text, Quotes) {
  EXPECT_EQ(CsvQuoted("a \"b\", c"), "\"a \"\"b\"\", c\"");
  // Cells that a spreadsheet would take for formulas, and come back as they were.
  EXPECT_EQ(CsvQuoted("=1+1"), "\"'=1+1\"");
  for (const char* number :
       {"-30", "+1e-3", "-", "@home", "=cmd|' /C calc'!A0", "'=1", "''+a", "'", "Left", ""}) {
    const std::string quoted = CsvQuoted(number);
    EXPECT_EQ(CsvText(quoted.substr(1, quoted.size() - 2)), number);
  }
  for (const char* plain : {"-30", "+1e-3", "Left", "'tis", ""})
    EXPECT_EQ(CsvQuoted(plain), "\"" + std::string(plain) + "\"");
  EXPECT_EQ(Lower("KA03_Depth"), "ka03_depth");
}

TEST(Text, WritesMarkdownInShortLines) {
  EXPECT_EQ(MarkdownParagraph("a  b\nc"), "a b c\n");
  const std::string word(52, 'x'), longer(161, 'y');
  EXPECT_EQ(MarkdownParagraph(word + " " + word + " " + word + " z", "- "),
            "- " + word + " " + word + " " + word.substr(0, 52) + "\n  z\n");
  EXPECT_EQ(MarkdownParagraph("a " + longer + " b"), "a\n" + longer + "\nb\n");
  // These would begin an item, a heading, a quotation or a table at the beginning of a line.
  for (const char* mark : {"-", "#", ">", "2.", "|", "+", "*", "=="})
    EXPECT_EQ(MarkdownParagraph(longer + " " + mark), longer + " " + mark + "\n");
}

TEST(Text, TellsControlCharacters) {
  EXPECT_EQ(Printable("a\x1b[31m\nb\x7f"), "a\\x1b[31m\\x0ab\\x7f");
  EXPECT_EQ(Printable("\xc2\x9b"
                      "1m"),
            "\\x9b1m");
  EXPECT_EQ(Printable("K\xc3\xbc"
                      "che \xe2\x82\xac"),
            "K\xc3\xbc"
            "che \xe2\x82\xac");
  EXPECT_TRUE(HasControlCharacters("a\tb"));
  EXPECT_FALSE(
      HasControlCharacters("K\xc3\xbc"
                           "che"));
}

TEST(Printable, IsUtf8WhateverTheBytesAre) {
  EXPECT_EQ(Printable("K\xfc"
                      "che"),
            "K\\xfc"
            "che");
  // A letter in more bytes than it needs, half a pair of UTF-16, beyond Unicode, one that is cut.
  for (const char* bytes : {"\xc0\x80", "\xed\xa0\x80", "\xf4\x90\x80\x80", "\xe2\x82", "\xff"}) {
    EXPECT_FALSE(IsUtf8(bytes));
    EXPECT_EQ(Printable(bytes).find_first_not_of("\\x0123456789abcdef"), std::string::npos);
  }
  EXPECT_TRUE(IsUtf8("\xf0\x9f\x93\xa6 \xe2\x82\xac"));
  EXPECT_EQ(Printable("\xf0\x9f\x93\xa6"), "\xf0\x9f\x93\xa6");
  EXPECT_EQ(Printable("A\xe2\x80\xaegnp"), "A\\u202egnp");  // right to left
  EXPECT_EQ(Printable("a\xe2\x80\xa8"
                      "b\xe2\x80\x8b"),
            "a\\u2028b\\u200b");
  ExpectError<DataError>([] { RequireUtf8("\xff", "argument 3,"); },
                         {"argument 3, \"\\xff\" is not UTF-8", "rename"});
}

TEST(Error, IsOneShortLineWhateverItQuotes) {
  EXPECT_STREQ(Error("a\nb\xff\n").what(), "a\\x0ab\\xff");
  const std::string said = DataError("x.json: " + std::string(1000000, 'a') + "; rename it").what();
  EXPECT_LT(said.size(), 1600u);
  EXPECT_EQ(said.rfind("x.json: a", 0), 0u);
  EXPECT_NE(said.find("a ... a"), std::string::npos);
  EXPECT_EQ(said.substr(said.size() - 11), "; rename it");
  std::string euros;
  for (int i = 0; i < 1000; ++i) euros += "\xe2\x82\xac";
  EXPECT_TRUE(IsUtf8(Error(euros).what()));
  EXPECT_TRUE(IsUtf8(Error("a" + euros).what()));
}

TEST(SentenceOf, SaysWhatTheSystemMeans) {
  std::error_code loop = std::make_error_code(std::errc::too_many_symbolic_link_levels);
  EXPECT_EQ(SentenceOf(std::filesystem::filesystem_error("status", "a/b", loop)),
            "a/b: " + loop.message());
  EXPECT_NE(
      SentenceOf(std::system_error(std::make_error_code(std::errc::resource_unavailable_try_again)))
          .find("no more threads"),
      std::string::npos);
  EXPECT_EQ(SentenceOf(std::runtime_error("a\nframe 1")), "a");
}

TEST(Wrapped, BreaksLongLinesAtBlanks) {
  EXPECT_EQ(Wrapped("one two three\nfour\n", 8), "one two\n  three\nfour\n");
  EXPECT_EQ(Wrapped("abcdefghijkl mn op", 8), "abcdefghijkl\n  mn op");
}

TEST(Shortened, KeepsMessagesShortAndPlain) {
  EXPECT_EQ(Shortened("a\nb"), "a\\x0ab");
  EXPECT_EQ(Shortened(std::string(200, 'a')), std::string(200, 'a'));
  EXPECT_EQ(Shortened(std::string(1000000, 'a')), std::string(200, 'a') + "...");
  EXPECT_EQ(Shortened("K\xc3\xbc"
                      "che",
                      2),
            "K...");
}

TEST(RequirePlainName, RefusesWhatATerminalOrATableWouldMisread) {
  EXPECT_NO_THROW(RequirePlainName(std::string(kMostNameBytes, 'a'), "x"));
  EXPECT_NO_THROW(RequirePlainName("images/left 1.png", "x"));
  ExpectError<DataError>([] { RequirePlainName(std::string(kMostNameBytes + 1, 'a'), "x.json"); },
                         {"x.json", "100 bytes"});
  ExpectError<DataError>([] { RequirePlainName("A\n0 9 9 9", "x.json"); }, {"A\\x0a0 9"});
  for (const char* name : {"A\xe2\x80\xaegnp", "\xff\xfe"}) EXPECT_FALSE(IsPlainName(name));
  EXPECT_NO_THROW(RequirePlainText("CL8 -3 <script>", "serial"));
  ExpectError<DataError>([] { RequirePlainText("\x1b[31m", "serial"); }, {"serial = \"\\x1b[31m"});
  EXPECT_THROW(RequirePlainText(std::string(201, 'a'), "serial"), DataError);
}

}  // namespace
}  // namespace volalign::text_test
