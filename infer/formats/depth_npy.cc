// NumPy's NPY, versions 1 to 3 (numpy/lib/format.py describes the format).

#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>

#include "core/base/error.h"
#include "core/base/text.h"
#include "infer/formats/depth_file.h"
#include "infer/formats/text_scanner.h"

namespace volalign::formats_internal {

namespace {

constexpr std::size_t kMostDimensionDigits = 9;  // of a dimension

struct NpyHeader {
  bool big_endian = false;
  char kind = 0;         // u, i or f
  std::size_t size = 0;  // bytes of a value
  bool fortran_order = false;
  int rows = 0, columns = 0;
  std::size_t data_at = 0;
};

NpyHeader ParseHeader(const std::string& bytes, const std::string& name) {
  if (bytes.size() < 12) throw DataError(name + ": truncated NPY");
  const auto byte = [&](std::size_t i) {
    return static_cast<std::size_t>(static_cast<unsigned char>(bytes[i]));
  };
  const std::size_t length_bytes = byte(6) == 1 ? 2 : 4;
  std::size_t length = 0;
  for (std::size_t i = 0; i < length_bytes; ++i) length |= byte(8 + i) << (8 * i);
  NpyHeader header;
  header.data_at = 8 + length_bytes + length;
  if (header.data_at > bytes.size() || length > 65536) throw DataError(name + ": truncated NPY");
  std::string dictionary = bytes.substr(8 + length_bytes, length);
  dictionary.erase(dictionary.find_last_not_of(" \n") + 1);  // padding

  const auto require = [&](bool found, const char* what) {
    if (found) return;
    throw DataError(fmt::format("{}: bad NPY header: {} expected, header is {}", name, what,
                                Shortened(dictionary)));
  };
  // A Python dictionary with these three keys, as numpy writes it.
  TextScanner scanner(dictionary);
  const auto take = [&](std::string_view word) {
    scanner.SkipBlanks();
    return scanner.Take(word);
  };
  bool has_type = false, has_order = false, has_shape = false;
  require(take("{"), "a dictionary");
  while (!take("}")) {
    if (!has_type && take("'descr'") && take(":")) {
      const bool quoted = take("'");
      const char order = scanner.TakeOneOf("<>|=");
      header.kind = scanner.TakeOneOf("uif");
      const char size = scanner.TakeOneOf("1248");
      has_type = quoted && order && header.kind && size && scanner.Take("'");
      require(has_type, "'descr' of an array of plain integers or floats (such as '<u2' or '<f4')");
      header.big_endian = order == '>';
      header.size = static_cast<std::size_t>(size - '0');
    } else if (!has_order && take("'fortran_order'") && take(":")) {
      header.fortran_order = take("True");
      has_order = header.fortran_order || take("False");
      require(has_order, "'fortran_order'");
    } else if (!has_shape && take("'shape'") && take(":")) {
      const bool opened = take("(");
      scanner.SkipBlanks();
      header.rows = scanner.TakeNumber(kMostDimensionDigits);
      const bool two = take(",");
      scanner.SkipBlanks();
      header.columns = scanner.TakeNumber(kMostDimensionDigits);
      take(",");
      has_shape = opened && two && header.rows >= 0 && header.columns >= 0 && take(")");
      require(has_shape, "'shape' of two dimensions (height, width)");
    } else {
      require(false, "'descr', 'fortran_order' and 'shape', each once");
    }
    require(take(",") || scanner.rest().substr(0, 1) == "}", "a comma");
  }
  require(has_type && has_order && has_shape && scanner.rest().empty(),
          "'descr', 'fortran_order' and 'shape', each once");
  if (header.kind == 'f' && header.size < 2) throw DataError(name + ": bad NPY header: f1");
  return header;
}

float HalfToFloat(std::uint16_t half) {
  const int exponent = half >> 10 & 31, mantissa = half & 1023;
  const float sign = half >> 15 ? -1.0f : 1.0f;
  if (exponent == 31) return mantissa ? std::nanf("") : sign * HUGE_VALF;
  if (exponent == 0) return sign * std::ldexp(static_cast<float>(mantissa), -24);
  return sign * std::ldexp(static_cast<float>(mantissa + 1024), exponent - 25);
}

float Decode(const NpyHeader& header, const char* bytes) {
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < header.size; ++i) {
    const auto byte = static_cast<std::uint8_t>(bytes[header.big_endian ? header.size - 1 - i : i]);
    bits |= std::uint64_t{byte} << (8 * i);
  }
  if (header.kind == 'u') return static_cast<float>(bits);
  if (header.kind == 'i') {
    const std::size_t unused = 64 - 8 * header.size;
    return static_cast<float>(static_cast<std::int64_t>(bits << unused) >> unused);
  }
  if (header.size == 2) return HalfToFloat(static_cast<std::uint16_t>(bits));
  if (header.size == 8) {
    double value;
    std::memcpy(&value, &bits, sizeof(value));
    return static_cast<float>(value);
  }
  const auto low = static_cast<std::uint32_t>(bits);
  float value;
  std::memcpy(&value, &low, sizeof(value));
  return value;
}

}  // namespace

StoredDepth DecodeNpy(const std::string& bytes, const std::string& name) {
  const NpyHeader header = ParseHeader(bytes, name);
  RequireSize(header.columns, header.rows, name);
  const int width = header.columns, height = header.rows;
  const std::size_t count = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  if (bytes.size() - header.data_at < count * header.size) {
    throw DataError(fmt::format("{}: truncated NPY: {} bytes hold no {}x{} values of {} bytes",
                                name, bytes.size() - header.data_at, width, height, header.size));
  }
  StoredDepth depth;
  depth.whole_numbers = header.kind != 'f';
  depth.values = Image<float>(width, height);
  const char* at = bytes.data() + header.data_at;
  for (std::size_t i = 0; i < count; ++i, at += header.size) {
    const float value = Decode(header, at);
    if (header.fortran_order) {
      depth.values(static_cast<int>(i / static_cast<std::size_t>(height)),
                   static_cast<int>(i % static_cast<std::size_t>(height))) = value;
    } else {
      depth.values[i] = value;
    }
  }
  return depth;
}

}  // namespace volalign::formats_internal
