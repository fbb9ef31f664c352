#pragma once

#include <filesystem>
#include <string>

#include "core/base/image.h"

namespace volalign {

/// Reads a 16-bit depth file, whose format its content shows: PNG (16-bit grey), PGM ASCII (P2) or
/// PGM binary (P5, 8 or 16 bits). Throws IoError if the file cannot be opened, is no regular file
/// or has over 512 MiB. Throws DataError if it is truncated, of another kind, of over 2^26 pixels
/// or has values above its maximum.
Image16 ReadDepthFile(const std::filesystem::path& path);
/// The same for the content of a file; `name` begins every message.
Image16 DecodeDepth(const std::string& bytes, const std::string& name);

/// Reads an 8-bit grey PNG (label maps). Throws IoError or DataError.
LabelImage ReadPng8(const std::filesystem::path& path);

/// Smallest size; encoding some ten times faster for a tenth more bytes (data sets); or without
/// filters, which do nothing for pictures of few colours and cost a third of the time.
enum class PngEffort { kSmall, kFast, kFlat };
/// Encodes an Image16, LabelImage or RgbImage in memory.
template <class Pixel>
std::string EncodePng(const Image<Pixel>& image, PngEffort effort = PngEffort::kSmall);

/// Encodes in memory and replaces `path` atomically (see WriteFileAtomically).
template <class Pixel>
void WritePng(const std::filesystem::path& path, const Image<Pixel>& image);

/// A PNG with a palette, a third of the size of one without. A picture with over 256 colours has no
/// palette. Throws Error for an empty picture.
std::string EncodePalettePng(const RgbImage& picture);

/// Metres = raw * depth_scale.
DepthImage ToMetres(const Image16& raw, double depth_scale);
/// Rounds to the nearest step; values that do not fit into 16 bits become 0 ("no measurement").
Image16 FromMetres(const DepthImage& depth, double depth_scale);

}  // namespace volalign
