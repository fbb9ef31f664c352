#include "infer/formats/depth_file.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdint>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
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
  using namespace formats_internal;
  const std::string name = path.string();
  const std::string bytes = ReadFile(path, kMaxImageBytes);
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
  CleanDepth(name, &depth);
  return depth;
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
