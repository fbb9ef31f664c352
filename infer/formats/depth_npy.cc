// NumPy's NPY, versions 1 to 3 (numpy/lib/format.py describes the format).

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <string_view>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/config/archive.h"
#include "core/config/bounded_yaml.h"
#include "infer/formats/depth_file.h"

namespace volalign::formats_internal {

namespace {

struct NpyHeader {
  SampleType type;
  bool fortran_order = false;
  int rows = 0, columns = 0;
  std::size_t data_at = 0;
};

bool IsOneOf(char letter, std::string_view letters) {
  return letters.find(letter) != std::string_view::npos;
}

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
  // A Python dictionary of these three is YAML, but for the brackets of the shape.
  std::string dictionary = bytes.substr(8 + length_bytes, length);
  std::replace(dictionary.begin(), dictionary.end(), '(', '[');
  std::replace(dictionary.begin(), dictionary.end(), ')', ']');
  const auto require = [&](bool found, const std::string& what) {
    if (found) return;
    throw DataError(fmt::format("{}: bad NPY header: {} expected, header is {}", name, what,
                                Shortened(dictionary)));
  };
  const nlohmann::json root = YamlTree(dictionary, name + ": bad NPY header", YamlDocuments::kOne);
  require(root.is_object() && root.size() == 3 && root.contains("descr") &&
              root.contains("fortran_order") && root.contains("shape"),
          "a dictionary of 'descr', 'fortran_order' and 'shape', each once,");
  const std::string type = ScalarText(root["descr"]), order = ScalarText(root["fortran_order"]);
  require(type.size() == 3 && IsOneOf(type[0], "<>|=") && IsOneOf(type[1], "uif") &&
              IsOneOf(type[2], "1248") && type.substr(1) != "f1",
          "'descr' of an array of plain integers or floats (such as '<u2' or '<f4')");
  header.type = {type[1], static_cast<std::size_t>(type[2] - '0'), type[0] == '>'};
  require(order == "True" || order == "False", "'fortran_order'");
  header.fortran_order = order == "True";
  const nlohmann::json& shape = root["shape"];
  require(shape.is_array() && shape.size() == 2, "'shape' of two dimensions (height, width)");
  const ValuePlace place{name + ": shape"};
  ReadValue(shape[0], place, &header.rows);
  ReadValue(shape[1], place, &header.columns);
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
