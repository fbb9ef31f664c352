#pragma once

#include <ATen/core/Tensor.h>

#include <map>
#include <string>
#include <string_view>

namespace volalign {

/// The content of a safetensors file. First, the header's length, 8 bytes, little-endian. Then the
/// header, JSON, with `dtype`, `shape` and `data_offsets` of each tensor and texts under
/// `__metadata__`. Last, the values.
struct Safetensors {
  std::map<std::string, std::string> texts;
  std::map<std::string, at::Tensor> tensors;  ///< on the CPU, contiguous
};

/// The bytes of such a file. Wider elements come first, so each tensor begins at a multiple of its
/// element's size. The same content gives the same bytes. Throws Error for an element type that the
/// format or this reader does not have.
std::string WriteSafetensors(const Safetensors& content);

/// Reads these bytes. Memory is a small multiple of their number. Throws DataError for anything
/// else, with the fault but without the file's name. Faults are also a header of more than 16 MiB,
/// and tensors that overlap, leave a gap or have more than 16 dimensions.
Safetensors ReadSafetensors(std::string_view bytes);

}  // namespace volalign
