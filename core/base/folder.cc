#include "core/base/folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <map>
#include <system_error>
#include <thread>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/base/text.h"

namespace volalign {
namespace {

namespace fs = std::filesystem;

constexpr char kDraft[] = "unfinished.tmp-";
constexpr std::chrono::milliseconds kLockPause(100);

[[noreturn]] void FailFolder(const char* what, const fs::path& path, int reason) {
  throw IoError(fmt::format("cannot {} {}: {}", what, path.string(), std::strerror(reason)));
}

/// Syncs a folder. Does nothing on file systems that cannot.
void SyncOpen(int fd, const fs::path& folder) {
  if (::fsync(fd) != 0 && errno != EINVAL && errno != EROFS) FailFolder("sync", folder, errno);
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

/// Files by their paths in the folder, in a fixed order.
std::set<fs::path> FilesBelow(const fs::path& folder) {
  std::set<fs::path> files;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder)) {
    if (!entry.is_directory()) files.insert(entry.path().lexically_relative(folder));
  }
  return files;
}

/// The folders of a folder that is written to, each opened once. None of them was reached by a
/// link, which somebody may put there at any time.
class FoldersBelow {
 public:
  explicit FoldersBelow(const fs::path& dir)
      : dir_(dir), dir_fd_(::open(dir.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
    if (dir_fd_ < 0) FailFolder("open", dir, errno);
  }
  ~FoldersBelow() {
    ::close(dir_fd_);
    for (const auto& [path, fd] : open_) ::close(fd);
  }
  FoldersBelow(const FoldersBelow&) = delete;
  FoldersBelow& operator=(const FoldersBelow&) = delete;

  /// The folder of the file. If it is missing: made with `make`, else -1.
  int Of(const fs::path& file, bool make) {
    int at = dir_fd_;
    fs::path path;
    for (const fs::path& part : file.parent_path()) {
      path /= part;
      const auto known = open_.find(path);
      if (known != open_.end()) {
        at = known->second;
        continue;
      }
      if (make && ::mkdirat(at, part.c_str(), 0777) == 0) SyncOpen(at, dir_ / path);
      const int next = ::openat(at, part.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
      if (next < 0 && !make && errno == ENOENT) return -1;
      if (next < 0) Fail(at, path, errno);
      at = open_.emplace(path, next).first->second;
    }
    return at;
  }

  void Sync() const {
    SyncOpen(dir_fd_, dir_);
    for (const auto& [path, fd] : open_) SyncOpen(fd, dir_ / path);
  }

 private:
  [[noreturn]] void Fail(int parent, const fs::path& path, int reason) const {
    struct stat there = {};
    ::fstatat(parent, path.filename().c_str(), &there, AT_SYMLINK_NOFOLLOW);
    if (!S_ISLNK(there.st_mode)) FailFolder("write into", dir_ / path, reason);
    throw IoError(fmt::format("cannot write into {}, which is a link to another folder; remove it",
                              ShownPath(dir_ / path)));
  }

  const fs::path& dir_;
  int dir_fd_;
  std::map<fs::path, int> open_;  // by their paths in the folder
};

/// Removes a file of an earlier run. Anything else stays.
void RemoveOutdated(int folder, const fs::path& file) {
  struct stat there = {};
  if (folder < 0 || ::fstatat(folder, file.filename().c_str(), &there, AT_SYMLINK_NOFOLLOW) != 0 ||
      !S_ISREG(there.st_mode))
    return;
  if (::unlinkat(folder, file.filename().c_str(), 0) != 0)
    FailFolder("remove a file of an earlier run,", file, errno);
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
  if (fd < 0) return;  // a folder may be writable but not readable
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
  const std::string mark = ".tmp-";
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, ignored)) {
    const std::string name = entry.path().filename().string();
    const std::size_t at = name.rfind(mark);
    if (at != std::string::npos &&
        name.find_first_not_of("0123456789-", at + mark.size()) == std::string::npos)
      found.push_back(entry.path());
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
  FoldersBelow folders(dir_);
  for (const fs::path& file : outdated) folders.Of(file, false);
  for (const fs::path& file : files) {
    folders.Of(file, true);
    RequirePlace(dir_ / file);
  }
  const auto each = [&](bool of_last, const auto& call) {
    for (const fs::path& file : files) {
      if ((file.filename() == last) == of_last) call(file);
    }
    folders.Sync();
  };
  const auto move = [&](const fs::path& file) {
    if (::renameat(AT_FDCWD, (draft() / file).c_str(), folders.Of(file, true),
                   file.filename().c_str()) != 0)
      FailFolder("write", dir_ / file, errno);
  };
  each(true, [&](const fs::path& file) { RemoveOutdated(folders.Of(file, true), file); });
  for (const fs::path& file : outdated) RemoveOutdated(folders.Of(file, false), file);
  each(false, move);
  each(true, move);
}

}  // namespace volalign
