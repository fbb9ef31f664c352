#include "core/plot/picture_text.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace volalign::picture_text_test {
namespace {

/// The picture as text: '#' where it has ink.
std::vector<std::string> Ink(const RgbImage& picture) {
  std::vector<std::string> rows;
  for (int v = 0; v < picture.height(); ++v) {
    rows.emplace_back();
    for (int u = 0; u < picture.width(); ++u) rows.back() += picture(u, v).r > 0 ? '#' : '.';
  }
  return rows;
}

std::vector<std::string> Drawn(const std::string& text) {
  RgbImage picture(kTextWidth * CountCharacters(text), kTextHeight);
  DrawText(&picture, 0, 0, text, {255, 255, 255});
  return Ink(picture);
}

TEST(DrawText, LettersAreWhatTheyAre) {
  const std::vector<std::string> expected = {
      "............", "............", "..#...#####.", ".#.#..#.....", "#...#.#.....",
      "#...#.#.....", "#...#.####..", "#####.#.....", "#...#.#.....", "#...#.#.....",
      "#...#.#####.", "............", "............"};
  EXPECT_EQ(Drawn("AE"), expected);
}

TEST(DrawText, IsLatin1AndABoxForAllElse) {
  const std::vector<std::string> box = Drawn("\xff");  // no UTF-8
  EXPECT_EQ(Drawn("\xe2\x82\xac"), box);               // beyond Latin-1
  for (const char* letter : {"!", "~", "\xc2\xa1", "\xc3\xa9", "\xc3\xbf"})
    EXPECT_NE(Drawn(letter), box) << letter;
  EXPECT_NE(Drawn("\xc3\xa9"), Drawn("e"));
}

TEST(DrawText, WhatLiesOutsideIsLeftOut) {
  RgbImage picture(8, 8);
  DrawText(&picture, -3, -3, "MMM", {255, 255, 255});
  DrawText(&picture, 5, 6, "MMM", {255, 255, 255});
  FillRectangle(&picture, 6, 6, 100, 100, {9, 9, 9});
  FillRectangle(&picture, -5, -5, 3, 3, {9, 9, 9});
  EXPECT_EQ(picture(7, 7), (Rgb{9, 9, 9}));
  EXPECT_FALSE(picture(0, 0) == (Rgb{9, 9, 9}));
}

TEST(Shortened, EndsWithDotsOnlyWhereItIsTooLong) {
  EXPECT_EQ(Shortened("abcdef", 6), "abcdef");
  EXPECT_EQ(Shortened("abcdefg", 6), "abcd..");
  EXPECT_EQ(Shortened("\xc3\xa9\xc3\xa9\xc3\xa9\xc3\xa9", 3), "\xc3\xa9..");
  EXPECT_EQ(CountCharacters("\xc3\xa9t\xc3\xa9"), 3);
}

}  // namespace
}  // namespace volalign::picture_text_test
