#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "core/base/folder.h"

namespace volalign {

/// The folder of a run and the names of its files (docs/training.md). One process at a time trains
/// in it: the folder is locked while the object lives, and free again when the process ends,
/// however it ends.
class RunFolder {
 public:
  /// Makes the folder where there is none. Waits up to 10 s for a process that trains in it, which
  /// may just have been killed. Throws IoError.
  explicit RunFolder(std::filesystem::path dir);

  const std::filesystem::path& dir() const { return dir_; }
  std::filesystem::path config() const { return dir_ / "config.yaml"; }
  std::filesystem::path metrics() const { return dir_ / "metrics.jsonl"; }
  std::filesystem::path tensorboard() const { return dir_ / "tensorboard"; }
  std::filesystem::path model() const { return dir_ / "model.safetensors"; }
  std::filesystem::path best() const { return dir_ / "best.safetensors"; }
  /// Of the state after so many samples.
  std::filesystem::path State(std::int64_t samples) const;

  /// Numbers of samples after which there are states, largest first.
  std::vector<std::int64_t> States() const;
  /// Removes all states but the `count` newest.
  void KeepStates(int count) const;
  /// Removes the states after `samples`, from which the run was not continued, and unfinished files
  /// that a killed run left.
  void BeginAfter(std::int64_t samples) const;

 private:
  std::filesystem::path dir_;
  FolderLock lock_;
};

}  // namespace volalign
