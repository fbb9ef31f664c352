#include "core/formats/image_io.h"

#include <fmt/format.h>
#include <png.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <csetjmp>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <system_error>
#include <type_traits>
#include <unordered_map>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"

namespace volalign {

namespace {

// Limits far above any depth sensor. Larger files are refused before memory is allocated.
constexpr int kMaxSide = 1 << 15;
constexpr std::size_t kMaxPixels = std::size_t{1} << 26;

struct Pixels {
  int width = 0, height = 0, bit_depth = 0, channels = 0;
  std::vector<std::uint8_t> bytes;  // rows without padding; 16-bit samples in machine order
};

struct ReadState {
  const std::string* bytes;
  std::size_t at = 0;
  std::string error;
};

void OnReadError(png_structp png, png_const_charp message) {
  static_cast<ReadState*>(png_get_error_ptr(png))->error = message;
  longjmp(png_jmpbuf(png), 1);
}

void OnWarning(png_structp, png_const_charp) {}

void ReadBytes(png_structp png, png_bytep out, png_size_t size) {
  auto* state = static_cast<ReadState*>(png_get_io_ptr(png));
  if (state->at + size > state->bytes->size()) png_error(png, "the file is truncated");
  std::memcpy(out, state->bytes->data() + state->at, size);
  state->at += size;
}

/// libpng returns by longjmp: no object with a destructor may live between setjmp and the calls.
bool DecodeRows(png_structp png, png_infop info, std::size_t file_size, Pixels* pixels,
                std::vector<png_bytep>* rows) {
  if (setjmp(png_jmpbuf(png))) return false;
  png_read_info(png, info);
  pixels->width = static_cast<int>(png_get_image_width(png, info));
  pixels->height = static_cast<int>(png_get_image_height(png, info));
  pixels->bit_depth = png_get_bit_depth(png, info);
  pixels->channels = png_get_channels(png, info);
  if (png_get_color_type(png, info) == PNG_COLOR_TYPE_PALETTE)
    png_error(png, "a palette image is not expected");
  if (pixels->bit_depth < 8)
    png_error(png, "images with fewer than 8 bits per sample are not supported");
  if (pixels->bit_depth == 16) png_set_swap(png);
  if (pixels->width > kMaxSide || pixels->height > kMaxSide)
    png_error(png, "the image is too large");
  png_set_interlace_handling(png);
  png_read_update_info(png, info);
  const std::size_t row = png_get_rowbytes(png, info);
  // Deflate packs at most 1032 to 1: a small file that announces a huge image is truncated.
  if (row * static_cast<std::size_t>(pixels->height) / 1100 > file_size)
    png_error(png, "the file is truncated");
  if (static_cast<std::size_t>(pixels->width) * static_cast<std::size_t>(pixels->height) >
      kMaxPixels)
    png_error(png, "the image is too large");
  pixels->bytes.resize(row * static_cast<std::size_t>(pixels->height));
  rows->resize(static_cast<std::size_t>(pixels->height));
  for (std::size_t v = 0; v < rows->size(); ++v) (*rows)[v] = pixels->bytes.data() + v * row;
  png_read_image(png, rows->data());
  png_read_end(png, nullptr);
  return true;
}

Pixels DecodePng(const std::string& bytes, const std::string& name) {
  ReadState state{&bytes, 0, ""};
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &state, OnReadError, OnWarning);
  png_infop info = png ? png_create_info_struct(png) : nullptr;
  if (!info) throw Error("libpng could not be initialised");
  png_set_read_fn(png, &state, ReadBytes);
  Pixels pixels;
  std::vector<png_bytep> rows;
  const bool decoded = DecodeRows(png, info, bytes.size(), &pixels, &rows);
  png_destroy_read_struct(&png, &info, nullptr);
  if (!decoded) throw DataError(fmt::format("{}: not a readable PNG: {}", name, state.error));
  return pixels;
}

void AppendBytes(png_structp png, png_bytep data, png_size_t size) {
  static_cast<std::string*>(png_get_io_ptr(png))->append(reinterpret_cast<char*>(data), size);
}

/// Pixels as libpng has them.
struct Encoding {
  const void* data;
  int width, height, bit_depth, channels, colour_type;
  PngEffort effort;
  std::vector<Rgb> palette = {};
};

bool EncodeRows(png_structp png, png_infop info, const Encoding& of, std::vector<png_bytep>* rows) {
  if (setjmp(png_jmpbuf(png))) return false;
  if (of.effort == PngEffort::kFast) {
    constexpr int kRunLengths = 3;  // zlib's Z_RLE
    png_set_compression_level(png, 1);
    png_set_compression_strategy(png, kRunLengths);
    png_set_filter(png, PNG_FILTER_TYPE_BASE, PNG_FILTER_UP);
  } else if (of.effort == PngEffort::kFlat) {
    png_set_compression_level(png, 3);
    png_set_filter(png, PNG_FILTER_TYPE_BASE, PNG_FILTER_NONE);
  }
  png_set_IHDR(png, info, static_cast<png_uint_32>(of.width), static_cast<png_uint_32>(of.height),
               of.bit_depth, of.colour_type, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
               PNG_FILTER_TYPE_DEFAULT);
  static_assert(sizeof(Rgb) == sizeof(png_color), "palettes are handed to libpng as they are");
  if (!of.palette.empty())
    png_set_PLTE(png, info, reinterpret_cast<png_const_colorp>(of.palette.data()),
                 static_cast<int>(of.palette.size()));
  png_write_info(png, info);
  if (of.bit_depth == 16) png_set_swap(png);
  png_write_image(png, rows->data());
  png_write_end(png, nullptr);
  return true;
}

std::string Encode(const Encoding& of) {
  if (of.width <= 0 || of.height <= 0) throw Error("an empty image cannot be written as PNG");
  const std::size_t row = static_cast<std::size_t>(of.width * of.channels * of.bit_depth / 8);
  std::vector<png_bytep> rows(static_cast<std::size_t>(of.height));
  auto* base = const_cast<png_bytep>(static_cast<const std::uint8_t*>(of.data));
  for (std::size_t v = 0; v < rows.size(); ++v) rows[v] = base + v * row;
  ReadState state{nullptr, 0, ""};
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &state, OnReadError, OnWarning);
  png_infop info = png ? png_create_info_struct(png) : nullptr;
  if (!info) throw Error("libpng could not be initialised");
  std::string bytes;
  png_set_write_fn(png, &bytes, AppendBytes, nullptr);
  const bool encoded = EncodeRows(png, info, of, &rows);
  png_destroy_write_struct(&png, &info);
  if (!encoded) throw Error(fmt::format("PNG encoding failed: {}", state.error));
  return bytes;
}

Image16 DecodePgm(const std::string& bytes, const std::string& name) {
  const auto fail = [&](const std::string& why) { throw DataError(name + ": " + why); };
  constexpr std::string_view kEnds = " \t\n\v\f\r#", kSpace = kEnds.substr(0, 6);
  const bool ascii = bytes[1] == '2';
  std::size_t at = 2;
  // The next number, behind white space and # comments.
  const auto number = [&](const char* what) -> long {
    at = bytes.find_first_not_of(kSpace, at);
    while (at < bytes.size() && bytes[at] == '#')
      at = bytes.find_first_not_of(kSpace, bytes.find('\n', at));
    if (at >= bytes.size()) fail(fmt::format("truncated PGM: {} is missing", what));
    unsigned value = 0;
    const char* const begin = bytes.data();
    const auto [rest, error] = std::from_chars(begin + at, begin + bytes.size(), value);
    at = static_cast<std::size_t>(rest - begin);
    if (error != std::errc() || (at < bytes.size() && kEnds.find(bytes[at]) == kEnds.npos))
      fail(fmt::format("bad PGM: byte {} is not part of a number ({})", at, what));
    return value;
  };
  const long width = number("width"), height = number("height"), maximum = number("maximum");
  if (width == 0 || height == 0 || width > kMaxSide || height > kMaxSide)
    fail(fmt::format("bad PGM: size {}x{}", width, height));
  if (maximum == 0 || maximum > 65535)
    fail(fmt::format("bad PGM: maximum {} violates 0 < maximum < 65536", maximum));
  if (!ascii && at < bytes.size() && kSpace.find(bytes[at]) == kSpace.npos)
    fail("bad PGM: no white space ends the header");
  if (!ascii) ++at;  // a single one
  const auto count = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  const std::size_t sample = !ascii && maximum > 255 ? 2 : 1;
  const std::size_t left = bytes.size() - std::min(bytes.size(), at);
  if (left < count * sample)
    fail(fmt::format("truncated PGM: {} bytes hold no {}x{} pixels of {} bytes", left, width,
                     height, sample));
  if (count > kMaxPixels)
    fail(fmt::format("bad PGM: {}x{} are more than {} pixels", width, height, kMaxPixels));
  Image16 image(static_cast<int>(width), static_cast<int>(height));
  const auto* const pixels = reinterpret_cast<const std::uint8_t*>(bytes.data()) + at;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint8_t* const p = pixels + i * sample;
    const long value = ascii ? number("a pixel") : sample == 2 ? p[0] << 8 | p[1] : p[0];
    if (value > maximum)
      fail(fmt::format("bad PGM: pixel {} has {} > maximum {}", i, value, maximum));
    image[i] = static_cast<std::uint16_t>(value);
  }
  return image;
}

/// Decodes a PNG with these bits and one channel, which `kind` has. Throws DataError for others.
template <class Pixel>
Image<Pixel> PixelsOf(const std::string& bytes, const std::string& name, const char* kind) {
  constexpr int kBits = 8 * sizeof(Pixel);
  const Pixels pixels = DecodePng(bytes, name);
  if (pixels.bit_depth != kBits || pixels.channels != 1) {
    throw DataError(
        fmt::format("{}: {} has {} bits and 1 channel; this one has {} bits and {} channels{}",
                    name, kind, kBits, pixels.bit_depth, pixels.channels,
                    pixels.channels >= 3 ? "; is it the colour picture?" : ""));
  }
  Image<Pixel> image(pixels.width, pixels.height);
  std::memcpy(image.data(), pixels.bytes.data(), pixels.bytes.size());
  return image;
}

}  // namespace

Image16 ReadDepthFile(const std::filesystem::path& path) {
  return DecodeDepth(ReadFile(path, kMaxImageBytes), path.string());
}

Image16 DecodeDepth(const std::string& bytes, const std::string& name) {
  if (bytes.size() > 2 && bytes[0] == 'P' && (bytes[1] == '2' || bytes[1] == '5')) {
    return DecodePgm(bytes, name);
  }
  if (bytes.compare(0, 4, "\x89PNG") != 0) {
    throw DataError(fmt::format(
        "{}: neither a PNG nor a PGM (P2, P5) image; depth is expected as one of these", name));
  }
  return PixelsOf<std::uint16_t>(bytes, name, "a depth PNG");
}

LabelImage ReadPng8(const std::filesystem::path& path) {
  const std::string bytes = ReadFile(path, kMaxImageBytes);
  return PixelsOf<std::uint8_t>(bytes, path.string(), "a label PNG");
}

template <class Pixel>
std::string EncodePng(const Image<Pixel>& image, PngEffort effort) {
  constexpr bool kIsColour = std::is_same_v<Pixel, Rgb>;
  constexpr int kChannels = kIsColour ? 3 : 1;
  return Encode({image.data(), image.width(), image.height(), 8 * sizeof(Pixel) / kChannels,
                 kChannels, kIsColour ? PNG_COLOR_TYPE_RGB : PNG_COLOR_TYPE_GRAY, effort});
}

template <class Pixel>
void WritePng(const std::filesystem::path& path, const Image<Pixel>& image) {
  if (image.empty())
    throw Error(fmt::format("{}: an empty image cannot be written", path.string()));
  WriteFileAtomically(path, EncodePng(image));
}

std::string EncodePalettePng(const RgbImage& picture) {
  constexpr std::size_t kMostColours = 256;
  const int width = picture.width(), height = picture.height();
  std::unordered_map<std::uint32_t, std::uint8_t> known;
  std::vector<Rgb> palette;
  std::vector<std::uint8_t> indices;
  indices.reserve(picture.size());
  for (const Rgb& colour : picture) {
    const auto [at, is_new] = known.try_emplace(colour.r << 16 | colour.g << 8 | colour.b,
                                                static_cast<std::uint8_t>(palette.size()));
    if (is_new && palette.size() == kMostColours)
      return Encode({picture.data(), width, height, 8, 3, PNG_COLOR_TYPE_RGB, PngEffort::kFlat});
    if (is_new) palette.push_back(colour);
    indices.push_back(at->second);
  }
  return Encode({indices.data(), width, height, 8, 1, PNG_COLOR_TYPE_PALETTE, PngEffort::kFlat,
                 std::move(palette)});
}

template std::string EncodePng(const Image16&, PngEffort);
template std::string EncodePng(const LabelImage&, PngEffort);
template std::string EncodePng(const RgbImage&, PngEffort);
template void WritePng(const std::filesystem::path&, const Image16&);
template void WritePng(const std::filesystem::path&, const LabelImage&);
template void WritePng(const std::filesystem::path&, const RgbImage&);

DepthImage ToMetres(const Image16& raw, double depth_scale) {
  DepthImage depth(raw.width(), raw.height());
  for (std::size_t i = 0; i < raw.size(); ++i) {
    depth[i] = static_cast<float>(raw[i] * depth_scale);
  }
  return depth;
}

Image16 FromMetres(const DepthImage& depth, double depth_scale) {
  Image16 raw(depth.width(), depth.height());
  for (std::size_t i = 0; i < depth.size(); ++i) {
    const double steps = std::round(static_cast<double>(depth[i]) / depth_scale);
    raw[i] = steps >= 0 && steps <= 65535 ? static_cast<std::uint16_t>(steps) : 0;
  }
  return raw;
}

}  // namespace volalign
