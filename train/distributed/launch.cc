#include "train/distributed/launch.h"

#include <fmt/format.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <thread>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/interrupt.h"
#include "core/base/text.h"
#include "train/distributed/world.h"

namespace volalign {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kLost = 127;  // status, as a shell gives it of a process that it does not know

/// The environment of this process with the variables of ReadWorld.
std::vector<std::string> EnvironmentOf(int rank, int count, const std::string& store) {
  const std::vector<std::pair<std::string, std::string>> own = {
      {"RANK", std::to_string(rank)},
      {"LOCAL_RANK", std::to_string(rank)},
      {"WORLD_SIZE", std::to_string(count)},
      {"NCCL_SOCKET_IFNAME", "lo"},  // as OpenDevice does for Gloo
      {kStoreVariable, store}};
  std::vector<std::string> all;
  for (char** entry = environ; *entry != nullptr; ++entry) {
    const std::string text = *entry;
    const bool replaced = std::any_of(own.begin(), own.end(), [&](const auto& variable) {
      return text.rfind(variable.first + "=", 0) == 0;
    });
    if (!replaced) all.push_back(text);
  }
  for (const auto& [name, value] : own) all.push_back(name + "=" + value);
  return all;
}

std::vector<char*> Pointers(std::vector<std::string>& texts) {
  std::vector<char*> pointers;
  for (std::string& text : texts) pointers.push_back(text.data());
  pointers.push_back(nullptr);
  return pointers;
}

pid_t Start(std::vector<std::string> command, std::vector<std::string> environment) {
  // All memory is ready before fork(), after which only the system may be called.
  const std::vector<char*> arguments = Pointers(command), variables = Pointers(environment);
  const pid_t parent = ::getpid(), child = ::fork();
  if (child < 0) {
    throw IoError(fmt::format("cannot start {}: {}", command.at(0), std::strerror(errno)));
  }
  if (child > 0) return child;
  ::prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (::getppid() == parent) ::execve(arguments[0], arguments.data(), variables.data());
  ::_exit(127);
}

/// As a shell gives it.
int StatusOf(int status) {
  return WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
}

std::string Words(int status) {
  if (!WIFSIGNALED(status)) return fmt::format("ended with status {}", WEXITSTATUS(status));
  return fmt::format("was killed by signal {} ({})", WTERMSIG(status),
                     ::strsignal(WTERMSIG(status)));
}

/// Where something else in this process has waited for the child, its status is lost: a failure.
bool HasEnded(pid_t child, int* status) {
  const pid_t ended = ::waitpid(child, status, WNOHANG);
  if (ended < 0) *status = W_EXITCODE(kLost, 0);
  return ended != 0;
}

void SignalAll(const std::vector<pid_t>& children, int number) {
  for (const pid_t child : children) {
    if (child > 0) ::kill(child, number);
  }
}

/// That no other user can look into.
std::filesystem::path MakePrivateFolder() {
  std::string folder = (std::filesystem::temp_directory_path() / "volalign_XXXXXX").string();
  if (::mkdtemp(folder.data()) == nullptr) {
    throw IoError(fmt::format("cannot create folder {}: {}", folder, std::strerror(errno)));
  }
  return folder;
}

}  // namespace

int LaunchProcesses(int count, const std::vector<std::string>& command, double grace_s) {
  InterruptGuard guard;
  const Unfinished folder(MakePrivateFolder);
  const std::string store = folder.path() / "store";
  std::vector<pid_t> children;
  for (int rank = 0; rank < count; ++rank) {
    children.push_back(Start(command, EnvironmentOf(rank, count, store)));
  }
  int first_failure = 0, passed_on = 0, stopped = 0, running = count;
  Clock::time_point failed_at;
  while (running > 0) {
    if (const int number = guard.Take()) {
      passed_on = StatusOfSignal(number);
      SignalAll(children, number);
    }
    for (std::size_t rank = 0; rank < children.size(); ++rank) {
      int status = 0;
      if (children[rank] <= 0 || !HasEnded(children[rank], &status)) continue;
      children[rank] = 0;
      --running;
      if (StatusOf(status) == passed_on) stopped = passed_on;
      if (status == 0 || StatusOf(status) == passed_on || first_failure != 0) continue;
      first_failure = StatusOf(status);
      failed_at = Clock::now();
      fmt::print(stderr, "\nrank {} {}\n", rank, Words(status));
    }
    if (first_failure != 0 && Clock::now() - failed_at > std::chrono::duration<double>(grace_s)) {
      SignalAll(children, SIGKILL);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return first_failure != 0 ? first_failure : stopped;
}

std::vector<std::string> OwnCommandWithout(const std::string& name) {
  std::vector<std::string> command = Split(ReadFile("/proc/self/cmdline", kMaxTextBytes), '\0');
  command.pop_back();  // what stands behind the last zero
  std::vector<std::string> without = {"/proc/self/exe"};
  for (std::size_t i = 1; i < command.size(); ++i) {
    if (command[i] == name) {
      ++i;
    } else if (command[i].rfind(name + "=", 0) != 0) {
      without.push_back(command[i]);
    }
  }
  return without;
}

}  // namespace volalign
