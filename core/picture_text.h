#pragma once

#include <string>

#include "core/image.h"

namespace volalign {

/// Writing in pictures: a font of fixed width, 6 x 13 pixels a character. Text is UTF-8; characters
/// beyond Latin-1 are drawn as a box.
inline constexpr int kTextWidth = 6;
inline constexpr int kTextHeight = 13;

/// Characters of a text, which are fewer than its bytes where some are not ASCII.
int CountCharacters(const std::string& text);

/// Draws the text's pixels with its upper left corner at (left, top); what lies outside the picture
/// is left out.
void DrawText(RgbImage* picture, int left, int top, const std::string& text, Rgb colour);

/// The text, or its beginning and "..", where it has more than `most` characters.
std::string Shortened(const std::string& text, int most);

/// Fills a rectangle, as far as it lies in the picture.
void FillRectangle(RgbImage* picture, int left, int top, int width, int height, Rgb colour);

}  // namespace volalign
