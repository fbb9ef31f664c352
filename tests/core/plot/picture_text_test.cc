#include "core/plot/picture_text.h"

#include <gtest/gtest.h>

#include <algorithm>
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

TEST(DrawText, EveryCharacterDiffersFromEveryOther) {
  std::vector<std::vector<std::string>> glyphs;
  for (char c = 33; c < 127; ++c) glyphs.push_back(Drawn(std::string(1, c)));
  std::sort(glyphs.begin(), glyphs.end());
  EXPECT_EQ(std::adjacent_find(glyphs.begin(), glyphs.end()), glyphs.end());
  EXPECT_NE(Drawn("\xc3\xa9"), Drawn("e"));         // é
  EXPECT_NE(Drawn("\xc3\xbf"), Drawn("\xc3\xbe"));  // ÿ, the last one, and þ
  EXPECT_EQ(Drawn("\xe2\x82\xac"), Drawn("\xff"));  // beyond Latin-1, and no UTF-8: the box
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
