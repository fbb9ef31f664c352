// TIFF by libtiff: nothing in a file makes it open another one.

#include <fmt/format.h>
#include <tiffio.h>

#include <algorithm>
#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/base/text.h"
#include "infer/formats/depth_file.h"

namespace volalign::formats_internal {

namespace {

/// Handlers of one open file. They return 1, so that the process's own handlers are not called.
int OnError(TIFF*, void* last_error, const char* module, const char* format, va_list arguments) {
  char text[512];
  std::vsnprintf(text, sizeof(text), format, arguments);
  *static_cast<std::string*>(last_error) = fmt::format("{}: {}", module ? module : "", text);
  return 1;
}
int OnWarning(TIFF*, void*, const char*, const char*, va_list) { return 1; }

[[noreturn]] void FailUnreadable(const std::string& name, const std::string& last_error) {
  throw DataError(fmt::format("{}: not a readable TIFF: {}", name, Shortened(last_error)));
}

struct Layout {
  std::uint32_t width = 0, height = 0;
  std::uint16_t bits = 1, samples = 1, format = SAMPLEFORMAT_UINT;
};

Layout ReadLayout(TIFF* tiff, const std::string& name) {
  Layout layout;
  TIFFGetField(tiff, TIFFTAG_IMAGEWIDTH, &layout.width);
  TIFFGetField(tiff, TIFFTAG_IMAGELENGTH, &layout.height);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_BITSPERSAMPLE, &layout.bits);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLESPERPIXEL, &layout.samples);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLEFORMAT, &layout.format);
  RequireSize(layout.width, layout.height, name);
  const bool is_float =
      layout.format == SAMPLEFORMAT_IEEEFP && (layout.bits == 32 || layout.bits == 64);
  const bool is_integer =
      (layout.format == SAMPLEFORMAT_UINT || layout.format == SAMPLEFORMAT_INT) &&
      (layout.bits == 8 || layout.bits == 16 || layout.bits == 32);
  if (layout.samples != 1 || !(is_float || is_integer)) {
    throw DataError(fmt::format(
        "{}: a depth TIFF has 1 channel of 16 or 32-bit integers or 32-bit floats; this one has {} "
        "of {} bits, sample format {}",
        name, layout.samples, layout.bits, layout.format));
  }
  return layout;
}

SampleType TypeOf(const Layout& layout) {
  const char kind = layout.format == SAMPLEFORMAT_IEEEFP ? 'f'
                    : layout.format == SAMPLEFORMAT_INT  ? 'i'
                                                         : 'u';
  return {kind, layout.bits / 8u, /*big_endian=*/false};  // libtiff gives the machine's order
}

/// Reads tile by tile, or line by line.
void ReadBlocks(TIFF* tiff, const Layout& layout, const std::string& name,
                const std::string& last_error, Image<float>* values) {
  const bool tiled = TIFFIsTiled(tiff) != 0;
  std::uint32_t width = layout.width, height = 1;
  if (tiled) {
    TIFFGetField(tiff, TIFFTAG_TILEWIDTH, &width);
    TIFFGetField(tiff, TIFFTAG_TILELENGTH, &height);
    RequireSize(width, height, name);
  }
  const SampleType type = TypeOf(layout);
  const auto stated = static_cast<std::size_t>(tiled ? TIFFTileSize(tiff) : TIFFScanlineSize(tiff));
  std::vector<char> block(std::max(stated, type.size * width * height));
  for (std::uint32_t y = 0; y < layout.height; y += height) {
    for (std::uint32_t x = 0; x < layout.width; x += width) {
      if (tiled ? TIFFReadTile(tiff, block.data(), x, y, 0, 0) < 0
                : TIFFReadScanline(tiff, block.data(), y, 0) < 0)
        FailUnreadable(name, last_error);
      for (std::uint32_t v = y; v < std::min(y + height, layout.height); ++v) {
        for (std::uint32_t u = x; u < std::min(x + width, layout.width); ++u) {
          (*values)(static_cast<int>(u), static_cast<int>(v)) = DecodeSample(
              type, block.data() + type.size * (static_cast<std::size_t>(v - y) * width + u - x));
        }
      }
    }
  }
}

}  // namespace

StoredDepth ReadTiff(const std::filesystem::path& path) {
  const std::string name = path.string();
  std::string last_error;
  const std::unique_ptr<TIFFOpenOptions, void (*)(TIFFOpenOptions*)> options(TIFFOpenOptionsAlloc(),
                                                                             TIFFOpenOptionsFree);
  TIFFOpenOptionsSetErrorHandlerExtR(options.get(), OnError, &last_error);
  TIFFOpenOptionsSetWarningHandlerExtR(options.get(), OnWarning, nullptr);
  // "m": no memory mapping, which a file that is cut off meanwhile would end.
  const std::unique_ptr<TIFF, void (*)(TIFF*)> tiff(TIFFOpenExt(name.c_str(), "rm", options.get()),
                                                    [](TIFF* open) {
                                                      if (open) TIFFClose(open);
                                                    });
  if (!tiff) FailUnreadable(name, last_error);
  const Layout layout = ReadLayout(tiff.get(), name);
  StoredDepth depth;
  depth.whole_numbers = layout.format != SAMPLEFORMAT_IEEEFP;
  depth.values = Image<float>(static_cast<int>(layout.width), static_cast<int>(layout.height));
  ReadBlocks(tiff.get(), layout, name, last_error, &depth.values);
  return depth;
}

}  // namespace volalign::formats_internal
