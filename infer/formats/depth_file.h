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

/// Reads a depth file by its content, whatever its name. PNG is 16-bit grey, PGM is P2 or P5. TIFF
/// has one channel of 8, 16 or 32-bit integers or 32 or 64-bit floats. OpenEXR has one channel, or
/// one named Z or Y, with or without a layer's name before it, or equal R, G and B. NPY is a
/// two-dimensional array, in C or Fortran order and either byte order. Values that are not finite,
/// and negative ones, are no measurement and become 0. Throws IoError. Throws DataError for
/// anything else, for a truncated file, and if all measured values are negative (an axis that
/// points backwards).
/// `budget`, if given, counts its bytes.
StoredDepth ReadStoredDepth(const std::filesystem::path& path, ReadBudget* budget = nullptr);

/// The size of its values in memory, bytes.
std::uint64_t BytesOf(const StoredDepth& depth);

/// Does an image's or a topic's name call it something else than depth? The last word with a
/// meaning, except those behind "to", then is infrared, color, labels and so on.
bool IsNamedOtherwise(const std::string& name);
/// Is one of the name's words, of letters alone, one of `words`?
bool HasWord(const std::string& name, std::initializer_list<std::string_view> words);

/// Sets values that are no measurement, as above, to 0. Throws DataError, which begins with `name`,
/// if all measured values are negative.
void CleanDepth(const std::string& name, StoredDepth* depth);

/// The formats of depth files, for messages.
inline constexpr char kDepthFormats[] = "PNG (16-bit grey), PGM (P2, P5), TIFF, OpenEXR or NPY";
/// Endings of the names of such files, in lower case, by which they are found in a folder.
inline constexpr const char* kDepthEndings[] = {".png", ".pgm", ".tif", ".tiff", ".exr", ".npy"};

namespace formats_internal {

/// No depth sensor comes near these. Larger sizes are refused before memory is taken.
inline constexpr int kMaxSide = 1 << 15;
inline constexpr std::size_t kMaxPixels = std::size_t{1} << 26;

/// Throws DataError unless a depth image may have this size.
void RequireSize(long long width, long long height, const std::string& name);

/// A number of a file: unsigned ('u') or signed ('i') of 1, 2, 4 or 8 bytes, or a float ('f') of 2,
/// 4 or 8.
struct SampleType {
  char kind = 'u';
  std::size_t size = 2;  ///< bytes
  bool big_endian = false;
};
float DecodeSample(const SampleType& type, const char* bytes);

/// Depth of whole numbers.
StoredDepth FromImage16(const Image16& image);

/// Read files whose values are as stored. `bytes`: the whole file. `name` begins every message.
StoredDepth DecodeNpy(const std::string& bytes, const std::string& name);
StoredDepth ReadTiff(const std::filesystem::path& path);
StoredDepth ReadExr(const std::filesystem::path& path, const std::string& bytes);

}  // namespace formats_internal

}  // namespace volalign
