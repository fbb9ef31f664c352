#include "core/base/folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <system_error>
#include <thread>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/base/shown_path.h"
#include "core/base/temporary_file.h"

namespace volalign {
namespace {

namespace fs = std::filesystem;

constexpr char kDraft[] = "unfinished.tmp-";
constexpr std::chrono::milliseconds kLockPause(100);

[[noreturn]] void FailFolder(const char* what, const fs::path& path, int reason) {
  throw IoError(fmt::format("cannot {} {}: {}", what, path.string(), std::strerror(reason)));
}

void RequireDone(const std::error_code& error, const char* what, const fs::path& path) {
  if (error) FailFolder(what, path, error.value());
}

void RemoveDrafts(const fs::path& dir) {
  std::error_code ignored;
  for (const fs::directory_entry& entry : fs::directory_iterator(dir, ignored)) {
    if (entry.path().filename().string().rfind(kDraft, 0) == 0)
      fs::remove_all(entry.path(), ignored);
  }
}

fs::path MakeDraft(const fs::path& dir) {
  std::string draft = (dir / (std::string(kDraft) + "XXXXXX")).string();
  if (::mkdtemp(draft.data()) == nullptr) {
    throw IoError(fmt::format("cannot write into the folder {}: {}; choose another one",
                              dir.string(), std::strerror(errno)));
  }
  return draft;
}

/// By their paths in it, in a fixed order.
std::set<fs::path> FilesBelow(const fs::path& folder) {
  std::set<fs::path> files;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder)) {
    if (!entry.is_directory()) files.insert(entry.path().lexically_relative(folder));
  }
  return files;
}

/// Below the folder. What lies behind a link to another folder, which somebody may have put there,
/// is not written over.
void RequireNoLinks(const fs::path& folder, const fs::path& file) {
  fs::path at = folder;
  for (const fs::path& part : file.parent_path()) {
    at /= part;
    std::error_code error;
    if (!fs::is_symlink(fs::symlink_status(at, error))) continue;
    throw IoError(fmt::format("cannot write {}: {} is a link to another folder; remove the link",
                              ShownPath(folder / file), ShownPath(at)));
  }
}

/// What is no file of an earlier run stays.
void RemoveOutdated(const fs::path& file) {
  std::error_code error;
  if (!fs::is_regular_file(fs::symlink_status(file, error))) return;
  fs::remove(file, error);
  RequireDone(error, "remove a file of an earlier run,", file);
}

}  // namespace

void MakeFolder(const fs::path& folder) {
  if (folder.empty()) return;
  std::error_code error;
  if (fs::is_directory(folder, error)) return;
  MakeFolder(folder.parent_path() == folder ? fs::path() : folder.parent_path());
  if (fs::create_directory(folder, error)) {
    SyncFolder(folder.has_parent_path() ? folder.parent_path() : ".");
  }
  if (error) {
    throw IoError(fmt::format("cannot create folder {}: {}; choose another one", folder.string(),
                              error.message()));
  }
}

void SyncFolder(const fs::path& folder) {
  const int fd = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return;  // one may write into a folder that one may not read
  const int failed = ::fsync(fd) == 0 ? 0 : errno;
  ::close(fd);
  if (failed != 0 && failed != EINVAL && failed != EROFS) FailFolder("sync", folder, failed);
}

FolderLock::FolderLock(const fs::path& dir, std::chrono::milliseconds patience) : dir_(dir) {
  MakeFolder(dir);
  fd_ = ::open(dir.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd_ < 0) FailFolder("open", dir, errno);
  const auto until = std::chrono::steady_clock::now() + patience;
  while (::flock(fd_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
    if (std::chrono::steady_clock::now() >= until) {
      ::close(fd_);
      throw IoError(
          fmt::format("{}: another volalign is writing there: wait for it, or use another folder",
                      dir.string()));
    }
    std::this_thread::sleep_for(kLockPause);
  }
}

FolderLock::~FolderLock() { ::close(fd_); }

void FolderLock::Sync() const {
  if (::syncfs(fd_) != 0) FailFolder("sync", dir_, errno);
}

void RemoveTemporaries(const fs::path& folder) {
  std::error_code ignored;
  std::vector<fs::path> found;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, ignored)) {
    if (ReadTemporary(entry.path().filename().string())) found.push_back(entry.path());
  }
  for (const fs::path& path : found) fs::remove(path, ignored);
}

ResultFolder::ResultFolder(const fs::path& dir)
    : dir_(dir), lock_(dir), draft_([&] {
        RemoveDrafts(dir);
        return MakeDraft(dir);
      }) {}

void ResultFolder::Publish(const std::string& last, const std::set<fs::path>& outdated) const {
  const std::unique_lock<std::mutex> hold = HoldInterrupts();
  const std::set<fs::path> files = FilesBelow(draft());
  std::set<fs::path> folders;
  for (const fs::path& file : outdated) RequireNoLinks(dir_, file);
  for (const fs::path& file : files) {
    RequireNoLinks(dir_, file);
    RequirePlace(dir_ / file);
    folders.insert((dir_ / file).parent_path());
  }
  const auto each = [&](bool of_last, const auto& call) {
    for (const fs::path& file : files) {
      if ((file.filename() == last) == of_last) call(file);
    }
    for (const fs::path& folder : folders) SyncFolder(folder);
  };
  const auto move = [&](const fs::path& file) {
    std::error_code error;
    fs::rename(draft() / file, dir_ / file, error);
    RequireDone(error, "write", dir_ / file);
  };
  for (const fs::path& folder : folders) MakeFolder(folder);
  each(true, [&](const fs::path& file) { RemoveOutdated(dir_ / file); });
  for (const fs::path& file : outdated) RemoveOutdated(dir_ / file);
  each(false, move);
  each(true, move);
}

}  // namespace volalign
