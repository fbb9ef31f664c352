#include "core/nn/export_safetensors.h"

#include <ATen/core/Tensor.h>

#include <algorithm>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "core/base/file_util.h"
#include "core/nn/checkpoint.h"

namespace volalign {

void ExportSafetensors(const std::filesystem::path& checkpoint, const std::filesystem::path& output,
                       bool half) {
  const LoadedModel model = LoadCheckpoint(checkpoint);
  nlohmann::ordered_json header;
  header["__metadata__"] = {{"format", "volalign.safetensors/1"},
                            {"volalign.json", MetaToJson(model.meta)},
                            {"orientation", OrientationOf(model.meta)},
                            {"structure_sha256", model.meta.structure.Hash()}};
  std::string values;
  const std::map<std::string, at::Tensor> tensors =
      NetworkTensors(model.net, half, checkpoint.string());
  std::vector<std::pair<std::string, at::Tensor>> ordered(tensors.begin(), tensors.end());
  // Wider elements first, so that each tensor begins at a multiple of its own.
  std::stable_sort(ordered.begin(), ordered.end(), [](const auto& a, const auto& b) {
    return a.second.element_size() > b.second.element_size();
  });
  for (const auto& [name, tensor] : ordered) {
    const at::Tensor plain = tensor.detach().contiguous();
    const std::size_t begin = values.size();
    values.append(static_cast<const char*>(plain.data_ptr()), plain.nbytes());
    header[name] = {{"dtype", plain.scalar_type() == at::kHalf ? "F16" : "F32"},
                    {"shape", plain.sizes().vec()},
                    {"data_offsets", {begin, values.size()}}};
  }
  std::string text = header.dump();
  // Values begin at a multiple of 8 bytes.
  text.append((8 - text.size() % 8) % 8, ' ');
  std::string length;
  for (int i = 0; i < 8; ++i)
    length.push_back(static_cast<char>(static_cast<std::uint64_t>(text.size()) >> (8 * i) & 0xff));
  WriteFileAtomically(output, length + text + values);
}

}  // namespace volalign
