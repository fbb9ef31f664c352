#include "core/formats/palette_png.h"

#include <fmt/format.h>
#include <png.h>

#include <cstdint>
#include <cstring>
#include <unordered_map>
#include <vector>

#include "core/base/error.h"

namespace volalign {

namespace {

constexpr std::size_t kMostColours = 256;

struct Indexed {
  std::vector<std::uint8_t> indices;
  std::vector<Rgb> palette;
};

/// False if the picture has too many colours.
bool ToIndices(const RgbImage& picture, Indexed* indexed) {
  std::unordered_map<std::uint32_t, std::uint8_t> known;
  indexed->indices.reserve(picture.size());
  for (const Rgb& colour : picture) {
    const std::uint32_t key = colour.r << 16 | colour.g << 8 | colour.b;
    const auto found = known.find(key);
    if (found != known.end()) {
      indexed->indices.push_back(found->second);
      continue;
    }
    if (known.size() == kMostColours) return false;
    const auto index = static_cast<std::uint8_t>(known.size());
    known.emplace(key, index);
    indexed->palette.push_back(colour);
    indexed->indices.push_back(index);
  }
  return true;
}

}  // namespace

std::string EncodePalettePng(const RgbImage& picture) {
  if (picture.empty()) throw Error("an empty image cannot be written as PNG");
  static_assert(sizeof(Rgb) == 3, "pixels and palettes are handed to libpng as they are");
  Indexed indexed;
  const bool few = ToIndices(picture, &indexed);
  png_image image;
  std::memset(&image, 0, sizeof(image));
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(picture.width());
  image.height = static_cast<png_uint_32>(picture.height());
  // Without filters: they do nothing for pictures of few colours and cost a third of the time.
  image.flags = PNG_IMAGE_FLAG_FAST;
  image.format = few ? PNG_FORMAT_RGB_COLORMAP : PNG_FORMAT_RGB;
  image.colormap_entries = static_cast<png_uint_32>(indexed.palette.size());
  const void* pixels = few ? static_cast<const void*>(indexed.indices.data()) : picture.data();
  const void* palette = few ? indexed.palette.data() : nullptr;
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(image);
  std::string bytes(size, '\0');
  if (!png_image_write_to_memory(&image, bytes.data(), &size, 0, pixels, 0, palette))
    throw Error(fmt::format("PNG encoding failed: {}", image.message));
  bytes.resize(size);
  return bytes;
}

}  // namespace volalign
