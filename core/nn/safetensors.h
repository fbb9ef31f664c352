#pragma once

#include <ATen/core/Tensor.h>

#include <map>
#include <string>
#include <string_view>

namespace volalign {

/// The content of a safetensors file: the header's length, 8 bytes, little-endian; the header,
/// JSON, with `dtype`, `shape` and `data_offsets` of each tensor and texts under `__metadata__`;
/// the values.
struct Safetensors {
  std::map<std::string, std::string> texts;
  std::map<std::string, at::Tensor> tensors;  ///< on the CPU, contiguous
};

/// The bytes of such a file. Wider elements come first, so that each tensor begins at a multiple of
/// its element's size. The same content gives the same bytes. Throws Error for an element type that
/// the format or this reader does not have.
std::string WriteSafetensors(const Safetensors& content);

/// Reads them. Memory is a small multiple of their number. Throws DataError, with what is wrong but
/// without the file's name, for anything else: a header of more than 16 MiB, tensors that overlap,
/// leave a gap or have more than 16 dimensions.
Safetensors ReadSafetensors(std::string_view bytes);

}  // namespace volalign
