#pragma once

#include <array>
#include <functional>
#include <string>

#include "core/base/image.h"

namespace volalign {

/// Writing in pictures: a font of fixed width, 6 x 13 pixels a character. Text is UTF-8; characters
/// beyond Latin-1 are drawn as a box.
inline constexpr int kTextWidth = 6;
inline constexpr int kTextHeight = 13;

/// Of pictures with text around them: the ground, words, and words of less weight.
inline constexpr Rgb kPaper{24, 26, 30}, kInk{235, 235, 235}, kFaint{165, 168, 174};

/// Characters of a text, which are fewer than its bytes where some are not ASCII.
int CountCharacters(const std::string& text);

/// Draws the text's pixels with its upper left corner at (left, top); what lies outside the picture
/// is left out.
void DrawText(RgbImage* picture, int left, int top, const std::string& text, Rgb colour);

/// The text, or its beginning and "..", where it has more than `most` characters.
std::string Shortened(const std::string& text, int most);

/// The picture below a line with these words, shortened to its width.
RgbImage Captioned(const RgbImage& picture, const std::string& caption);

/// A colour scale, `colour` from 0 to 1, with a number at either end and one in the middle.
void DrawScale(RgbImage* picture, int left, int top, int width,
               const std::function<Rgb(double)>& colour, const std::array<std::string, 3>& numbers);
inline constexpr int kScaleHeight = 8 + 2 + kTextHeight;

/// Fills a rectangle, as far as it lies in the picture.
void FillRectangle(RgbImage* picture, int left, int top, int width, int height, Rgb colour);

}  // namespace volalign
