#pragma once

#include <ATen/core/Tensor.h>

#include <map>
#include <string>
#include <string_view>

namespace volalign {

/// What a file of `torch.save` holds where it is a dictionary of texts and of dictionaries of
/// tensors.
struct TensorArchive {
  std::map<std::string, std::string> texts;
  std::map<std::string, std::map<std::string, at::Tensor>> tensors;  ///< on the CPU, contiguous
};

/// Reads the bytes of such a file: a zip archive without compression with the pickle data.pkl and a
/// record for each tensor. Of pickle, a language for programs, it knows the few instructions that
/// make dictionaries, tuples, texts, numbers and tensors, and the four functions by which tensors
/// are written; it calls nothing, so that no content runs code. Memory is a small multiple of the
/// file's size. Throws DataError, with what is wrong but without the file's name, for anything
/// else: a damaged archive, another instruction or function, more than 4 MiB of pickle, tuples
/// deeper than 16 levels, tensors that share memory or are not contiguous.
TensorArchive ReadTensorArchive(std::string_view bytes);

}  // namespace volalign
