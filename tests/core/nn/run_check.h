#pragma once

// Cases for the scripts that run an exported network without any of our code.

#include <ATen/core/Tensor.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

namespace volalign::testing_nn {

/// Writes FOLDER/NAME_AxBxCxD.f32, the values of a tensor [A,B,C,D] float32.
inline void WriteValues(const std::filesystem::path& folder, const std::string& name,
                        const at::Tensor& tensor) {
  const at::Tensor plain = tensor.contiguous();
  const std::string file =
      fmt::format("{}_{}.f32", name, fmt::join(plain.sizes().begin(), plain.sizes().end(), "x"));
  std::ofstream(folder / file, std::ios::binary)
      .write(static_cast<const char*>(plain.data_ptr()),
             static_cast<std::streamsize>(plain.nbytes()));
}

/// Exit status of `python SCRIPT FOLDER`.
inline int RunCheck(const std::string& python, const std::string& script,
                    const std::filesystem::path& folder) {
  const int status = std::system((python + " " + script + " " + folder.string()).c_str());
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

}  // namespace volalign::testing_nn
