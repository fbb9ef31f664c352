#pragma once

#include <chrono>
#include <filesystem>
#include <set>
#include <string>

#include "core/base/interrupt.h"

namespace volalign {

/// Makes the folder, and those that it lies in, where there are none, and syncs what they lie in.
/// Throws IoError.
void MakeFolder(const std::filesystem::path& folder);

/// After a power failure the folder has the names that it has now; on file systems that can do so.
/// Throws IoError.
void SyncFolder(const std::filesystem::path& folder);

/// Keeps other processes' FolderLocks from a folder while it lives, and is gone with the process,
/// however that ends. Does nothing on a file system without locks.
class FolderLock {
 public:
  /// Makes the folder where there is none. Waits for `patience` for another process. Throws
  /// IoError, also where that goes on.
  explicit FolderLock(const std::filesystem::path& dir,
                      std::chrono::milliseconds patience = std::chrono::milliseconds(0));
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

  /// Everything written to the folder's file system so far is on the disk afterwards. Throws
  /// IoError.
  void Sync() const;

 private:
  std::filesystem::path dir_;
  int fd_ = -1;
};

/// Removes the temporary files in `folder` that WriteFileAtomically leaves where a process is
/// killed. For the process that has the folder's lock.
void RemoveTemporaries(const std::filesystem::path& folder);

/// A folder that has the files of one run, whole: those of a new one are written to a draft inside
/// it, and come to their places when all of them are there. Locked while the object lives.
class ResultFolder {
 public:
  /// Makes the folder where there is none, and removes drafts that killed processes left. Throws
  /// IoError where it cannot be written into, or another process writes there.
  explicit ResultFolder(const std::filesystem::path& dir);

  const std::filesystem::path& dir() const { return dir_; }
  /// Files lie in it as they will in dir(). Gone with the object.
  const std::filesystem::path& draft() const { return draft_.path(); }

  /// Moves the draft's files to their places, over earlier ones, and removes `outdated`, paths in
  /// dir(). Files called `last` say that those beside them are there: earlier ones go first, new
  /// ones come last, so that a process which is killed in between leaves none. Throws IoError.
  void Publish(const std::string& last, const std::set<std::filesystem::path>& outdated = {}) const;

 private:
  std::filesystem::path dir_;
  FolderLock lock_;
  Unfinished draft_;
};

}  // namespace volalign
