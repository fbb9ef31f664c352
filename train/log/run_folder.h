#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "core/base/folder.h"

namespace volalign {

/// The folder of a run and the names of its files (docs/training.md). One process at a time trains
/// in it. The object locks the folder; the lock ends with the process in any case.
class RunFolder {
 public:
  /// Makes a missing folder. Waits up to 10 s for a process that trains in it, which may have been
  /// killed just now. Throws IoError.
  explicit RunFolder(std::filesystem::path dir);

  const std::filesystem::path& dir() const { return dir_; }
  std::filesystem::path config() const { return dir_ / "config.yaml"; }
  std::filesystem::path metrics() const { return dir_ / "metrics.jsonl"; }
  std::filesystem::path tensorboard() const { return dir_ / "tensorboard"; }
  std::filesystem::path model() const { return dir_ / "model.safetensors"; }
  std::filesystem::path best() const { return dir_ / "best.safetensors"; }
  /// The state after so many samples.
  std::filesystem::path State(std::int64_t samples) const;

  /// Numbers of samples of the states, largest first.
  std::vector<std::int64_t> States() const;
  /// Removes all states except the `count` newest.
  void KeepStates(int count) const;
  /// Removes the states after `samples`, as the run continues from there, and unfinished files of a
  /// killed run.
  void BeginAfter(std::int64_t samples) const;

 private:
  std::filesystem::path dir_;
  FolderLock lock_;
};

}  // namespace volalign
