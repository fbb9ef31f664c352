#include "core/nn/safetensors.h"

#include <ATen/ops/empty.h>
#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/json/json_archive.h"

namespace volalign {
namespace {

constexpr std::size_t kLengthBytes = 8, kAlignment = 8, kMostDimensions = 16;
constexpr std::uint64_t kMaxHeaderBytes = std::uint64_t{16} << 20;
constexpr char kTexts[] = "__metadata__";

struct ElementType {
  const char* name;
  at::ScalarType type;
};
constexpr ElementType kTypes[] = {{"F64", at::kDouble},    {"F32", at::kFloat}, {"F16", at::kHalf},
                                  {"BF16", at::kBFloat16}, {"I64", at::kLong},  {"I32", at::kInt},
                                  {"U8", at::kByte},       {"BOOL", at::kBool}};

/// The type for which `is` is true, or nullptr.
template <class Is>
const ElementType* FindType(const Is& is) {
  const auto* const found = std::find_if(std::begin(kTypes), std::end(kTypes), is);
  return found == std::end(kTypes) ? nullptr : found;
}

struct Entry {
  std::uint64_t begin = 0, end = 0;  // of its values
  std::string name;
  at::ScalarType type = at::kFloat;
  std::vector<std::int64_t> shape;
};

const nlohmann::json& List(const ObjectReader& object, const char* key, std::size_t most) {
  const nlohmann::json& list = object.Get(key);
  if (!list.is_array() || list.size() > most)
    throw DataError(fmt::format("{} is no list of {} numbers at most", object.Place(key), most));
  return list;
}

Entry ReadEntry(const ObjectReader& object, const std::string& name, std::uint64_t most_bytes) {
  Entry entry;
  entry.name = name;
  const std::string dtype = object.Text("dtype");
  const ElementType* const type = FindType([&](const ElementType& t) { return dtype == t.name; });
  if (type == nullptr)
    throw DataError(fmt::format("{} = '{}' is not known", object.Place("dtype"), Shortened(dtype)));
  entry.type = type->type;
  // The other sizes of an empty tensor are limited as well: LibTorch multiplies them.
  std::uint64_t count = 1, steps = 1;
  for (const nlohmann::json& number : List(object, "shape", kMostDimensions)) {
    std::uint64_t size = 0;
    ReadValue(number, {object.Place("shape")}, &size);
    if (size > 1 && steps > most_bytes / size)
      throw DataError(fmt::format("{} is larger than the file", object.Place("shape")));
    count *= size;
    steps *= std::max<std::uint64_t>(size, 1);
    entry.shape.push_back(static_cast<std::int64_t>(size));
  }
  std::vector<std::uint64_t> offsets;
  for (const nlohmann::json& number : List(object, "data_offsets", 2))
    ReadValue(number, {object.Place("data_offsets")}, &offsets.emplace_back());
  if (offsets.size() != 2 || offsets[1] < offsets[0] || offsets[1] > most_bytes ||
      offsets[1] - offsets[0] != count * at::elementSize(entry.type))
    throw DataError(fmt::format("{} do not fit the shape or the file, which may be truncated",
                                object.Place("data_offsets")));
  entry.begin = offsets[0];
  entry.end = offsets[1];
  object.RejectOthers();
  return entry;
}

}  // namespace

std::string WriteSafetensors(const Safetensors& content) {
  std::vector<std::pair<std::string, at::Tensor>> ordered(content.tensors.begin(),
                                                          content.tensors.end());
  std::stable_sort(ordered.begin(), ordered.end(), [](const auto& a, const auto& b) {
    return a.second.element_size() > b.second.element_size();
  });
  nlohmann::json header;
  header[kTexts] = content.texts;
  std::uint64_t end = 0;
  for (const auto& [name, tensor] : ordered) {
    const at::ScalarType element = tensor.scalar_type();
    const ElementType* const type =
        FindType([&](const ElementType& t) { return element == t.type; });
    if (type == nullptr)
      throw Error(fmt::format("tensor '{}' has the type {}, which is not written", name,
                              at::toString(element)));
    const std::uint64_t begin = end;
    end += tensor.nbytes();
    header[name] = {
        {"dtype", type->name}, {"shape", tensor.sizes().vec()}, {"data_offsets", {begin, end}}};
  }
  std::string text = header.dump();
  text.append((kAlignment - text.size() % kAlignment) % kAlignment, ' ');
  std::string bytes;
  bytes.reserve(kLengthBytes + text.size() + end);
  for (std::size_t i = 0; i < kLengthBytes; ++i)
    bytes.push_back(static_cast<char>(static_cast<std::uint64_t>(text.size()) >> (8 * i) & 0xff));
  bytes += text;
  for (const auto& [name, tensor] : ordered)
    bytes.append(static_cast<const char*>(tensor.data_ptr()), tensor.nbytes());
  return bytes;
}

Safetensors ReadSafetensors(std::string_view bytes) {
  if (bytes.size() < kLengthBytes) throw DataError("it is truncated");
  std::uint64_t length = 0;
  for (std::size_t i = kLengthBytes; i-- > 0;)
    length = length << 8 | static_cast<unsigned char>(bytes[i]);
  bytes.remove_prefix(kLengthBytes);
  if (length > kMaxHeaderBytes || length > bytes.size())
    throw DataError("it is no safetensors file, or a truncated one");
  const nlohmann::json header = ParseStrictJson(std::string(bytes.substr(0, length)), "its header");
  bytes.remove_prefix(length);
  const ObjectReader root(header, "its header");
  Safetensors content;
  std::vector<Entry> entries;
  for (const std::string& name : root.Keys()) {
    const ObjectReader object = root.Child(name);
    if (name != kTexts) {
      entries.push_back(ReadEntry(object, name, bytes.size()));
      continue;
    }
    for (const std::string& key : object.Keys()) content.texts[key] = object.Text(key);
  }
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
    return std::pair(a.begin, a.end) < std::pair(b.begin, b.end);
  });
  std::uint64_t end = 0;
  for (const Entry& entry : entries) {
    if (entry.begin != end)
      throw DataError(
          fmt::format("tensor '{}' overlaps another one, or leaves a gap", Shortened(entry.name)));
    end = entry.end;
  }
  if (end != bytes.size()) throw DataError("it has bytes that belong to no tensor");
  for (const Entry& entry : entries) {
    at::Tensor& tensor = content.tensors[entry.name];
    tensor = at::empty(entry.shape, at::TensorOptions().dtype(entry.type));
    if (entry.end > entry.begin)
      std::memcpy(tensor.data_ptr(), bytes.data() + entry.begin, entry.end - entry.begin);
  }
  return content;
}

}  // namespace volalign
