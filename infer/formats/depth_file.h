#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <string>
#include <string_view>

#include "core/base/image.h"
#include "infer/formats/read_budget.h"

namespace volalign {

/// Depth as a file stores it, in the file's own units: metres = value * depth_scale.
struct StoredDepth {
  Image<float> values;         ///< 0 is "no measurement"
  bool whole_numbers = false;  ///< stored as integers, hence rounded to whole units
};

/// Reads a depth file by its content, whatever its name: PNG (16-bit grey), PGM (P2, P5), TIFF (one
/// channel; 8, 16 or 32-bit integers, 32 or 64-bit floats), OpenEXR (one channel, or the one named
/// Z or Y, with or without a layer's name before it, or R where R, G and B are equal), NPY (a
/// two-dimensional array, C or Fortran order, either byte order). Values that are not finite, and
/// negative ones, are no measurement and become 0. Throws IoError, or DataError for anything else,
/// for a truncated file, and where all measured values are negative (an axis that points
/// backwards).
StoredDepth ReadStoredDepth(const std::filesystem::path& path);
/// The same, counted by `budget` before its pixels are unpacked.
StoredDepth ReadStoredDepth(const std::filesystem::path& path, ReadBudget* budget);

/// Of its values in memory.
std::uint64_t BytesOf(const StoredDepth& depth);

/// Whether an image's or a topic's name calls it something else than depth: the last of its words
/// that tells, those behind "to" apart, is infrared, color, labels and so on.
bool IsNamedOtherwise(const std::string& name);
/// Whether one of the name's words, of letters alone, is one of `words`.
bool HasWord(const std::string& name, std::initializer_list<std::string_view> words);

/// Makes values that are no measurement, as above, 0. Throws DataError, which begins with `name`,
/// where all measured values are negative.
void CleanDepth(const std::string& name, StoredDepth* depth);

/// What of a file this module can read, for messages.
inline constexpr char kDepthFormats[] = "PNG (16-bit grey), PGM (P2, P5), TIFF, OpenEXR or NPY";
/// How the names of such files end, in lower case, by which a folder's are told from others.
inline constexpr const char* kDepthEndings[] = {".png", ".pgm", ".tif", ".tiff", ".exr", ".npy"};

namespace formats_internal {

/// No depth sensor comes near these; what claims more is refused before memory is taken.
inline constexpr int kMaxSide = 1 << 15;
inline constexpr std::size_t kMaxPixels = std::size_t{1} << 26;

/// Throws DataError unless a depth image may have this size.
void RequireSize(long long width, long long height, const std::string& name);

/// Of whole files in memory; `name` begins every message. Values are as stored.
StoredDepth DecodeNpy(const std::string& bytes, const std::string& name);
StoredDepth DecodeTiff(const std::string& bytes, const std::string& name);
StoredDepth DecodeExr(const std::string& bytes, const std::string& name);

}  // namespace formats_internal

}  // namespace volalign
