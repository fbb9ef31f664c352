#pragma once

#include <chrono>
#include <filesystem>
#include <set>
#include <string>

#include "core/base/interrupt.h"

namespace volalign {

/// Makes the folder and its missing parents, and syncs the folders that contain them. Throws
/// IoError.
void MakeFolder(const std::filesystem::path& folder);

/// Makes the folder's names durable, so that a power failure does not change them, on file systems
/// that can do so. Throws IoError.
void SyncFolder(const std::filesystem::path& folder);

/// Locks a folder against other processes' FolderLocks while it lives. The lock ends with the
/// process in any case. Does nothing on a file system without locks.
class FolderLock {
 public:
  /// Makes a missing folder. Waits for another process up to `patience`. Throws IoError, also if
  /// the other process goes on.
  explicit FolderLock(const std::filesystem::path& dir,
                      std::chrono::milliseconds patience = std::chrono::milliseconds(0));
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

  /// Makes everything durable that was written to the folder's file system so far. Throws IoError.
  void Sync() const;

 private:
  std::filesystem::path dir_;
  int fd_ = -1;
};

/// Removes temporary files of WriteFileAtomically that killed processes left in `folder`. Only for
/// the process that has the folder's lock.
void RemoveTemporaries(const std::filesystem::path& folder);

/// A folder with the complete files of one run. A new run writes to a draft inside it. The files
/// move to their places when all are complete. Locked while the object lives.
class ResultFolder {
 public:
  /// Makes a missing folder, and removes drafts that killed processes left. Throws IoError if it
  /// cannot be written to, or if another process writes there.
  explicit ResultFolder(const std::filesystem::path& dir);

  const std::filesystem::path& dir() const { return dir_; }
  /// Has its files at the same relative paths as dir(). Removed with the object.
  const std::filesystem::path& draft() const { return draft_.path(); }

  /// Moves the draft's files to their places, over earlier ones, and removes `outdated`, paths in
  /// dir(). Files named `last` mark complete results: earlier ones are removed first, new ones come
  /// last. So a process that is killed in between leaves none of them. Throws IoError.
  void Publish(const std::string& last, const std::set<std::filesystem::path>& outdated = {}) const;

 private:
  std::filesystem::path dir_;
  FolderLock lock_;
  TemporaryPath draft_;
};

}  // namespace volalign
