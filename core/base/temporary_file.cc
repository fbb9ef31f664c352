#include "core/base/temporary_file.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <system_error>
#include <vector>

#include "core/base/text.h"

namespace volalign {
namespace {

namespace fs = std::filesystem;

/// Is it locked, or unreadable?
bool IsLocked(const fs::path& file) {
  const int fd = ::open(file.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) return true;
  const bool locked = ::flock(fd, LOCK_EX | LOCK_NB) != 0;
  ::close(fd);
  return locked;
}

}  // namespace

std::optional<TemporaryFile> ReadTemporary(const std::string& name) {
  const std::string mark = ".tmp-";
  const std::size_t at = name.rfind(mark);
  if (at == std::string::npos) return std::nullopt;
  const std::vector<std::string> numbers = Split(name.substr(at + mark.size()), '-');
  const auto is_number = [](const std::string& number) {
    return !number.empty() && number.find_first_not_of("0123456789") == std::string::npos;
  };
  if (numbers.size() > 2 || !std::all_of(numbers.begin(), numbers.end(), is_number))
    return std::nullopt;
  return TemporaryFile{name.substr(0, at),
                       static_cast<pid_t>(std::strtol(numbers[0].c_str(), nullptr, 10))};
}

void RemoveAbandoned(const fs::path& file) {
  std::error_code ignored;
  std::vector<fs::path> found;
  const fs::path folder = file.has_parent_path() ? file.parent_path() : ".";
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, ignored)) {
    const auto temporary = ReadTemporary(entry.path().filename().string());
    if (!temporary || temporary->of != file.filename() || temporary->writer <= 0) continue;
    const bool gone = ::kill(temporary->writer, 0) != 0 && errno == ESRCH;
    if (gone && !IsLocked(entry.path())) found.push_back(entry.path());
  }
  for (const fs::path& path : found) fs::remove(path, ignored);
}

}  // namespace volalign
