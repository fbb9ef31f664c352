#include "infer/formats/depth_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
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

StoredDepth FromImage16(const Image16& image) {
  StoredDepth depth;
  depth.whole_numbers = true;
  depth.values = Image<float>(image.width(), image.height());
  for (std::size_t i = 0; i < image.size(); ++i) depth.values[i] = image[i];
  return depth;
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

StoredDepth ReadStoredDepth(const std::filesystem::path& path) {
  ReadBudget budget;
  return ReadStoredDepth(path, &budget);
}

StoredDepth ReadStoredDepth(const std::filesystem::path& path, ReadBudget* budget) {
  using namespace formats_internal;
  const std::string name = path.string();
  const std::string bytes = ReadFile(path, kMaxImageBytes);
  budget->Open(path);
  StoredDepth depth;
  if (BeginsWith(bytes, "\x93NUMPY")) {
    depth = DecodeNpy(bytes, name);
  } else if (IsTiff(bytes)) {
    depth = DecodeTiff(bytes, name);
  } else if (BeginsWith(bytes, "\x76\x2f\x31\x01")) {
    depth = DecodeExr(bytes, name);
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

}  // namespace formats_internal

}  // namespace volalign
