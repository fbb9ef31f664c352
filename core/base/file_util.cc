#include "core/base/file_util.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <openssl/evp.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <optional>
#include <system_error>
#include <utility>

#include "core/base/error.h"
#include "core/base/folder.h"
#include "core/base/interrupt.h"
#include "core/base/text.h"

namespace volalign {

namespace {

std::atomic<std::uint64_t> next_temporary{0};

/// Closes a descriptor of ::open.
class FileHandle {
 public:
  explicit FileHandle(int file) : file_(file) {}
  ~FileHandle() { Close(); }
  FileHandle(const FileHandle&) = delete;
  FileHandle& operator=(const FileHandle&) = delete;
  int get() const { return file_; }
  int Close() {
    const int file = std::exchange(file_, -1);
    return file < 0 ? 0 : ::close(file);
  }

 private:
  int file_;
};

}  // namespace

std::string ReadFile(const std::filesystem::path& path, std::uint64_t max_bytes) {
  const std::string name = ShownPath(path);
  const auto fail = [&](const char* reason) {
    throw IoError(fmt::format("cannot read {}: {}", name, reason));
  };
  // Opening a pipe without O_NONBLOCK would wait for its writer.
  const FileHandle file(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  if (file.get() < 0) fail(std::strerror(errno));
  struct stat status {};
  if (::fstat(file.get(), &status) != 0) fail(std::strerror(errno));
  if (S_ISDIR(status.st_mode)) {
    throw IoError(fmt::format("{} is a folder; a file is expected", name));
  }
  if (!S_ISREG(status.st_mode)) {
    throw IoError(fmt::format("{} is a device or a pipe; a file on disk is expected", name));
  }
  const auto require_size = [&](std::uint64_t size) {
    if (size <= max_bytes) return;
    throw IoError(fmt::format("{} has {} bytes, more than the {} that are read of such a file",
                              name, size, max_bytes));
  };
  const auto announced = static_cast<std::uint64_t>(status.st_size);
  require_size(announced);
  // The size is a hint: files of /proc have size 0, and a file may grow while it is read.
  std::string content(static_cast<std::size_t>(announced) + 1, '\0');
  std::size_t at = 0;
  for (;;) {
    const ssize_t n = ::read(file.get(), content.data() + at, content.size() - at);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) fail(std::strerror(errno));
    if (n == 0) break;
    at += static_cast<std::size_t>(n);
    require_size(at);
    if (at == content.size()) content.resize(2 * content.size() + 4096);
  }
  content.resize(at);
  // If a file is truncated meanwhile, zeros may have been read: the system clears the page of the
  // new end after it has published the size.
  if (::fstat(file.get(), &status) != 0) fail(std::strerror(errno));
  if (static_cast<std::uint64_t>(status.st_size) < announced) {
    fail("it became shorter while it was read");
  }
  return content;
}

void RequirePlace(const std::filesystem::path& path) {
  std::error_code error;
  const std::filesystem::file_status there = std::filesystem::status(path, error);
  if (!std::filesystem::exists(there) || std::filesystem::is_regular_file(there)) return;
  throw IoError(
      fmt::format("cannot write {}: {} is there; name another file", ShownPath(path),
                  std::filesystem::is_directory(there) ? "a folder" : "a device or a pipe"));
}

void WriteFileAtomically(const std::filesystem::path& path, std::string_view bytes, bool sync) {
  RequirePlace(path);
  MakeFolder(path.parent_path());
  const auto fail = [shown = ShownPath(path)](const char* what, int reason) {
    throw IoError(fmt::format("cannot {} {}: {}", what, shown, std::strerror(reason)));
  };
  std::optional<FileHandle> file;
  // Two writers never share a file. A name is passed over if a killed writer left it, or one with
  // the same process number on another machine.
  TemporaryPath temporary([&] {
    std::filesystem::path name;
    do {
      name = fmt::format("{}.tmp-{}-{}", path.string(), ::getpid(), next_temporary++);
      file.emplace(::open(name.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
    } while (file->get() < 0 && errno == EEXIST);
    if (file->get() < 0) fail("create", errno);
    return name;
  });
  std::size_t written = 0;
  while (written < bytes.size()) {
    const ssize_t n = ::write(file->get(), bytes.data() + written, bytes.size() - written);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) fail("write", n < 0 ? errno : EIO);
    written += static_cast<std::size_t>(n);
  }
  if (sync && ::fsync(file->get()) != 0 && errno != EINVAL && errno != EROFS) fail("sync", errno);
  if (file->Close() != 0) fail("close", errno);
  std::error_code error;
  std::filesystem::rename(temporary.path(), path, error);
  if (error) fail("rename", error.value());
  temporary.Complete();
  if (sync) SyncFolder(path.has_parent_path() ? path.parent_path() : ".");
}

std::string Base64(std::string_view bytes) {
  std::string text((bytes.size() + 2) / 3 * 4 + 1, '\0');
  EVP_EncodeBlock(reinterpret_cast<unsigned char*>(text.data()),
                  reinterpret_cast<const unsigned char*>(bytes.data()),
                  static_cast<int>(bytes.size()));
  text.pop_back();  // the final zero
  return text;
}

std::string Sha256(std::string_view bytes) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned int size = 0;
  if (EVP_Digest(bytes.data(), bytes.size(), digest.data(), &size, EVP_sha256(), nullptr) != 1) {
    throw Error("SHA-256 is not available in this OpenSSL");
  }
  std::string text;
  for (unsigned int i = 0; i < size; ++i) text += fmt::format("{:02x}", digest[i]);
  return text;
}

}  // namespace volalign
