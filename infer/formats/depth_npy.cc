// NumPy's NPY, versions 1 to 3 (numpy/lib/format.py describes the format).

#include <fmt/format.h>

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
  SampleType type;
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
      header.type.kind = scanner.TakeOneOf("uif");
      const char size = scanner.TakeOneOf("1248");
      has_type = quoted && order && header.type.kind && size && scanner.Take("'");
      require(has_type, "'descr' of an array of plain integers or floats (such as '<u2' or '<f4')");
      header.type.big_endian = order == '>';
      header.type.size = static_cast<std::size_t>(size - '0');
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
  if (header.type.kind == 'f' && header.type.size < 2)
    throw DataError(name + ": bad NPY header: f1");
  return header;
}

}  // namespace

StoredDepth DecodeNpy(const std::string& bytes, const std::string& name) {
  const NpyHeader header = ParseHeader(bytes, name);
  RequireSize(header.columns, header.rows, name);
  const int width = header.columns, height = header.rows;
  const std::size_t count = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  if (bytes.size() - header.data_at < count * header.type.size) {
    throw DataError(fmt::format("{}: truncated NPY: {} bytes hold no {}x{} values of {} bytes",
                                name, bytes.size() - header.data_at, width, height,
                                header.type.size));
  }
  StoredDepth depth;
  depth.whole_numbers = header.type.kind != 'f';
  depth.values = Image<float>(width, height);
  const char* at = bytes.data() + header.data_at;
  for (std::size_t i = 0; i < count; ++i, at += header.type.size) {
    const float value = DecodeSample(header.type, at);
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
