#pragma once

#include <vector>

#include "core/image.h"

namespace volalign {

/// The project's palette: black for background, distinct colours for labels; boxes share a hue
/// family.
Rgb LabelColour(int label);
RgbImage ColourLabels(const LabelImage& labels);
/// Perceptual colour map (Turbo, Mikhailov 2019) from near (red) to far (blue); no measurement is
/// black.
RgbImage ColourDepth(const DepthImage& depth, double near_m, double far_m);
/// Labels over shaded depth, for people. Throws Error on unequal sizes.
RgbImage OverlayLabels(const DepthImage& depth, const LabelImage& labels);
/// Grid of pictures, `columns` a row, separated by 2 px; cells take the largest picture's size.
RgbImage Montage(const std::vector<RgbImage>& pictures, int columns);

}  // namespace volalign
