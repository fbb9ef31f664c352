#include "core/base/text.h"

#include <gtest/gtest.h>

#include <string>

#include "core/base/error.h"
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
}

}  // namespace
}  // namespace volalign::text_test
