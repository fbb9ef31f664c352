#include "core/plot/picture.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

#include "core/plot/picture_text.h"
#include "core/plot/svg.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"

namespace volalign::picture_test {
namespace {

int LargestDifference(Rgb a, Rgb b) {
  return std::max({std::abs(a.r - b.r), std::abs(a.g - b.g), std::abs(a.b - b.b)});
}

TEST(LabelColour, TheStructures21LabelsAreTold) {
  EXPECT_EQ(LabelColour(0), (Rgb{0, 0, 0}));
  for (int a = 0; a < 21; ++a) {
    for (int b = 0; b < a; ++b)
      EXPECT_GE(LargestDifference(LabelColour(a), LabelColour(b)), 20) << a << " and " << b;
  }
}

TEST(LabelColour, EveryLabelDiffersFromBackgroundAndFromItsBoxs) {
  for (int label = 1; label <= 255; ++label) {
    EXPECT_GE(LargestDifference(LabelColour(label), LabelColour(0)), 100);
    const int box = (label - 1) / 5 * 5 + 1;
    for (int other = box; other < label; ++other)
      EXPECT_GE(LargestDifference(LabelColour(label), LabelColour(other)), 20);
  }
}

TEST(ColourLabels, ColoursPixelByPixel) {
  LabelImage labels(5, 3);
  for (std::size_t i = 0; i < labels.size(); ++i) labels[i] = static_cast<std::uint8_t>(i);
  const RgbImage picture = ColourLabels(labels);
  ASSERT_EQ(picture.width(), 5);
  ASSERT_EQ(picture.height(), 3);
  for (const auto [u, v] : Pixels(5, 3)) EXPECT_EQ(picture(u, v), LabelColour(labels(u, v)));
  for (int turns = 1; turns < 4; ++turns)
    EXPECT_EQ(ColourLabels(Turn(labels, turns)), Turn(picture, turns));
}

// Entries 255, 134 and 13 of the published table of 256 viridis colours (S. van der Walt and N.
// Smith; d3-scale-chromatic has it as 440154 440256 ... 481467 ... fde725).
TEST(ColourDepth, NearIsYellowFarIsViolet) {
  DepthImage depth(6, 1);
  depth[0] = 1;
  depth[1] = 2;
  depth[2] = 3;
  depth[3] = 0;
  depth[4] = 0.2f;
  depth[5] = 9;
  const RgbImage picture = ColourDepth(depth, 1, 3);
  const auto near = [](Rgb colour, double r, double g, double b) {
    EXPECT_NEAR(colour.r, 255 * r, 4);
    EXPECT_NEAR(colour.g, 255 * g, 4);
    EXPECT_NEAR(colour.b, 255 * b, 4);
  };
  near(picture[0], 0.993248, 0.906157, 0.143936);
  near(picture[1], 0.122606, 0.585371, 0.546557);
  near(picture[2], 72 / 255.0, 20 / 255.0, 103 / 255.0);
  EXPECT_EQ(picture[3], (Rgb{0, 0, 0}));
  EXPECT_EQ(picture[4], picture[0]);  // clamped
  EXPECT_EQ(picture[5], picture[2]);
}

TEST(SignedColour, IsBlueBelowZeroAndOrangeAbove) {
  EXPECT_GT(SignedColour(-1).b, SignedColour(-1).r + 100);
  EXPECT_GT(SignedColour(1).r, SignedColour(1).b + 100);
  EXPECT_LT(std::abs(SignedColour(0).r - SignedColour(0).b), 8);
  EXPECT_EQ(SignedColour(-3), SignedColour(-1));
  EXPECT_EQ(SignedColour(3), SignedColour(1));
  EXPECT_FALSE(SignedColour(0.1) == SignedColour(-0.1));
}

TEST(OverlayLabels, LabelsKeepTheirHueAndNoDepthIsBlack) {
  DepthImage depth(8, 6, 2.0f);
  LabelImage labels(8, 6, 3);
  depth(4, 4) = 0;
  labels(2, 2) = 0;
  const RgbImage picture = OverlayLabels(depth, labels);
  EXPECT_EQ(picture(4, 4), (Rgb{0, 0, 0}));
  // A flat plane is shaded evenly: the label's colour times one factor.
  const Rgb colour = LabelColour(3);
  EXPECT_NEAR(picture(1, 1).r, 0.78 * colour.r, 1.01);
  EXPECT_NEAR(picture(1, 1).g, 0.78 * colour.g, 1.01);
  EXPECT_NEAR(picture(1, 1).b, 0.78 * colour.b, 1.01);
  EXPECT_EQ(picture(2, 2).r, picture(2, 2).g);  // unlabelled surface is grey
  EXPECT_EQ(picture(2, 2).r, picture(2, 2).b);
  ExpectError<Error>([&] { OverlayLabels(depth, LabelImage(6, 8)); }, {"sizes"});
}

TEST(Shelves, FillsRowsWithPicturesOfDifferentSizes) {
  const std::vector<RgbImage> pictures = {
      RgbImage(3, 4, Rgb{10, 0, 0}), RgbImage(10, 4, Rgb{20, 0, 0}), RgbImage(3, 4, Rgb{30, 0, 0}),
      RgbImage(10, 6, Rgb{40, 0, 0}), RgbImage(10, 4, Rgb{50, 0, 0})};
  const RgbImage sheet = Shelves(pictures, 2);
  // Twice the widest is 22: three pictures, then two.
  ASSERT_EQ(sheet.width(), 10 + 2 + 10);
  ASSERT_EQ(sheet.height(), 4 + 2 + 6);
  EXPECT_EQ(sheet(3 + 2 + 10 + 2, 0), pictures[2](0, 0));
  EXPECT_EQ(sheet(0, 4 + 2), pictures[3](0, 0));
  EXPECT_EQ(sheet(9, 11), pictures[3](0, 0));
  EXPECT_EQ(sheet(10 + 2, 4 + 2), pictures[4](0, 0));
  const Rgb background = sheet(3, 0);
  long empty = 0;
  for (const Rgb& colour : sheet) empty += colour == background;
  EXPECT_EQ(empty, 22 * 12 - (2 * 3 * 4 + 2 * 10 * 4 + 10 * 6));
  EXPECT_EQ(Shelves({pictures[0]}, 2), pictures[0]);
  EXPECT_TRUE(Shelves({}, 2).empty());
}

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

TEST(Ellipsized, EndsWithDotsOnlyWhereItIsTooLong) {
  EXPECT_EQ(Ellipsized("abcdef", 6), "abcdef");
  EXPECT_EQ(Ellipsized("abcdefg", 6), "abcd..");
  EXPECT_EQ(Ellipsized("\xc3\xa9\xc3\xa9\xc3\xa9\xc3\xa9", 3), "\xc3\xa9..");
  EXPECT_EQ(CountCharacters("\xc3\xa9t\xc3\xa9"), 3);
}

TEST(Svg, EscapesTextsAndTitles) {
  Svg svg(1, 1);
  svg.Text({0, 0}, "a<b & c>d");
  svg.Polygon({{0, 0}}, "", "</polygon>");
  const std::string text = svg.Finished();
  EXPECT_TRUE(
      Has(text, ">a&lt;b &amp; c&gt;d</text>", "<title>&lt;/polygon&gt;</title></polygon>"));
}

}  // namespace
}  // namespace volalign::picture_test
