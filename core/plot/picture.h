#pragma once

#include <vector>

#include "core/base/image.h"

namespace volalign {

/// The project's palette: black for background, distinct colours for labels. Labels of one box have
/// similar hues.
Rgb LabelColour(int label);
RgbImage ColourLabels(const LabelImage& labels);
/// Viridis, which colour-blind people see alike, from 0 (near: yellow) to 1 (far: violet).
Rgb DepthColour(double t);
/// From -1 (blue) over 0 (light grey) to 1 (orange).
Rgb SignedColour(double t);
/// Depths from near to far as DepthColour; no measurement is black.
RgbImage ColourDepth(const DepthImage& depth, double near_m, double far_m);
/// Shading of a surface by its depth's slope, 0.56 to 1; 0 without depth.
Image<float> ShadeDepth(const DepthImage& depth);
/// Grey, darker with distance.
Rgb SurroundingsColour(double z, double shade);
/// Labels over shaded depth, for people. Throws Error on unequal sizes.
RgbImage OverlayLabels(const DepthImage& depth, const LabelImage& labels);
/// Pictures side by side, in their order, separated by 2 px. Rows are at most as
/// wide as `widest` times the widest picture.
RgbImage Shelves(const std::vector<RgbImage>& pictures, int widest);

}  // namespace volalign
