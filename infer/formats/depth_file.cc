#include "infer/formats/depth_file.h"

#include <fmt/format.h>
#include <half.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <set>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/text.h"
#include "core/formats/image_io.h"

namespace volalign {

namespace {

bool BeginsWith(const std::string& bytes, const std::string& magic) {
  return bytes.compare(0, magic.size(), magic) == 0;
}

bool IsTiff(const std::string& bytes) {
  using namespace std::string_literals;
  return BeginsWith(bytes, "II*\0"s) || BeginsWith(bytes, "MM\0*"s) ||
         BeginsWith(bytes, "II+\0"s) || BeginsWith(bytes, "MM\0+"s);
}

/// The words of letters alone, in lower case.
std::vector<std::string> WordsOf(const std::string& name) {
  std::string letters = Lower(name);
  for (char& c : letters) {
    if (c < 'a' || c > 'z') c = ' ';
  }
  std::vector<std::string> words = Split(letters, ' ');
  words.erase(std::remove(words.begin(), words.end(), ""), words.end());
  return words;
}

}  // namespace

void CleanDepth(const std::string& name, StoredDepth* depth) {
  bool any_positive = false, any_negative = false;
  for (float& value : depth->values) {
    if (!std::isfinite(value)) value = 0;
    any_positive = any_positive || value > 0;
    any_negative = any_negative || value < 0;
    if (value < 0) value = 0;
  }
  if (any_negative && !any_positive) {
    throw DataError(fmt::format(
        "{}: every value is negative; depth is the distance along the optical axis, and positive",
        name));
  }
}

StoredDepth ReadStoredDepth(const std::filesystem::path& path, ReadBudget* budget) {
  using namespace formats_internal;
  const std::string name = path.string();
  const std::string bytes = ReadFile(path, kMaxImageBytes);
  ReadBudget own;
  if (!budget) budget = &own;
  budget->Open(path);
  StoredDepth depth;
  if (BeginsWith(bytes, "\x93NUMPY")) {
    depth = DecodeNpy(bytes, name);
  } else if (IsTiff(bytes)) {
    depth = ReadTiff(path);
  } else if (BeginsWith(bytes, "\x76\x2f\x31\x01")) {
    depth = ReadExr(path, bytes);
  } else if (BeginsWith(bytes, "\x89PNG") || BeginsWith(bytes, "P2") || BeginsWith(bytes, "P5")) {
    depth = FromImage16(DecodeDepth(bytes, name));
  } else {
    throw DataError(fmt::format("{}: no depth image; expected {}", name, kDepthFormats));
  }
  budget->Unpack(BytesOf(depth), name);
  CleanDepth(name, &depth);
  return depth;
}

std::uint64_t BytesOf(const StoredDepth& depth) { return sizeof(float) * depth.values.size(); }

bool HasWord(const std::string& name, std::initializer_list<std::string_view> words) {
  const std::vector<std::string> parts = WordsOf(name);
  return std::any_of(parts.begin(), parts.end(), [&](const std::string& part) {
    return std::find(words.begin(), words.end(), part) != words.end();
  });
}

bool IsNamedOtherwise(const std::string& name) {
  static const std::set<std::string> others = {
      "ir",    "infrared",  "infra",      "color",  "colour",  "rgb",
      "bgr",   "amplitude", "confidence", "label",  "labels",  "mask",
      "masks", "sheet",     "preview",    "normal", "normals", "disparity"};
  bool otherwise = false, is_target = false;
  for (const std::string& word : WordsOf(name)) {
    if (!is_target && word.rfind("depth", 0) == 0) otherwise = false;
    if (!is_target && others.count(word) > 0) otherwise = true;
    is_target = word == "to";  // aligned_depth_to_color
  }
  return otherwise;
}

namespace formats_internal {

void RequireSize(long long width, long long height, const std::string& name) {
  if (width <= 0 || height <= 0 || width > kMaxSide || height > kMaxSide ||
      static_cast<std::size_t>(width) * static_cast<std::size_t>(height) > kMaxPixels) {
    throw DataError(fmt::format("{}: {}x{} is no size of a depth image", name, width, height));
  }
}

float DecodeSample(const SampleType& type, const char* bytes) {
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < type.size; ++i) {
    const auto byte = static_cast<std::uint8_t>(bytes[type.big_endian ? type.size - 1 - i : i]);
    bits |= std::uint64_t{byte} << (8 * i);
  }
  const auto as = [&](auto value) {
    std::memcpy(&value, &bits, sizeof(value));
    return static_cast<float>(value);
  };
  if (type.kind == 'u') return static_cast<float>(bits);
  if (type.kind == 'i') {
    const std::size_t unused = 64 - 8 * type.size;
    return static_cast<float>(static_cast<std::int64_t>(bits << unused) >> unused);
  }
  if (type.size == 2) {
    Imath::half value;
    value.setBits(static_cast<std::uint16_t>(bits));
    return value;
  }
  return type.size == 4 ? as(float()) : as(double());
}

StoredDepth FromImage16(const Image16& image) {
  StoredDepth depth{Image<float>(image.width(), image.height()), /*whole_numbers=*/true};
  std::copy(image.begin(), image.end(), depth.values.begin());
  return depth;
}

}  // namespace formats_internal

}  // namespace volalign
