#pragma once

#include <sys/types.h>

#include <filesystem>
#include <optional>
#include <string>

namespace volalign {

/// The parts of a name that ends as WriteFileAtomically's temporary ones do: .tmp-PID-N, formerly
/// .tmp-PID.
struct TemporaryFile {
  std::string of;  ///< the name of the final file
  pid_t writer = 0;
};

/// Parses such a name. Nothing for any other name.
std::optional<TemporaryFile> ReadTemporary(const std::string& name);

/// Removes the temporary files of `file` that killed processes left. Their writer is gone, and none
/// on another machine has them locked, as WriteFileAtomically does while it writes.
void RemoveAbandoned(const std::filesystem::path& file);

}  // namespace volalign
