#pragma once

#include <array>
#include <functional>
#include <string>

#include "core/base/image.h"

namespace volalign {

/// Text in pictures: a font of fixed width, 6 x 13 pixels per character. Text is UTF-8; characters
/// beyond Latin-1 are drawn as a box.
inline constexpr int kTextWidth = 6;
inline constexpr int kTextHeight = 13;

/// Colours of pictures with text around them: the ground, words, and less important words.
inline constexpr Rgb kPaper{24, 26, 30}, kInk{235, 235, 235}, kFaint{165, 168, 174};

/// Number of characters of a text. It has more bytes than that if some are not ASCII.
int CountCharacters(const std::string& text);

/// Draws the text's pixels with its upper left corner at (left, top). Parts outside of the picture
/// are left out.
void DrawText(RgbImage* picture, int left, int top, const std::string& text, Rgb colour);

/// The text, or its beginning and "..", if it has more than `most` characters.
std::string Ellipsized(const std::string& text, int most);

/// The picture below a line with this caption, shortened to its width.
RgbImage Captioned(const RgbImage& picture, const std::string& caption);

/// A colour scale, `colour` from 0 to 1, with a number at either end and one in the middle.
void DrawScale(RgbImage* picture, int left, int top, int width,
               const std::function<Rgb(double)>& colour, const std::array<std::string, 3>& numbers);
inline constexpr int kScaleHeight = 8 + 2 + kTextHeight;

/// Fills the part of a rectangle that lies in the picture.
void FillRectangle(RgbImage* picture, int left, int top, int width, int height, Rgb colour);

}  // namespace volalign
