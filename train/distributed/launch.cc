#include "train/distributed/launch.h"

#include <fmt/format.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <thread>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/interrupt.h"
#include "core/base/text.h"
#include "train/distributed/world.h"

namespace volalign {

std::vector<std::string> OwnCommand() {
  std::vector<std::string> command = Split(ReadFile("/proc/self/cmdline", kMaxTextBytes), '\0');
  command.pop_back();  // the part behind the last zero
  return command;
}

int LaunchProcesses(int count, std::vector<std::string> command, double grace_s) {
  using Clock = std::chrono::steady_clock;
  InterruptGuard guard;
  const TemporaryPath folder([] {
    std::string path = (std::filesystem::temp_directory_path() / "volalign_XXXXXX").string();
    if (::mkdtemp(path.data()) == nullptr) throw IoError("cannot create the folder " + path);
    return std::filesystem::path(path);
  });
  ::setenv("WORLD_SIZE", std::to_string(count).c_str(), 1);
  ::setenv("NCCL_SOCKET_IFNAME", "lo", 1);  // as OpenDevice does for Gloo
  ::setenv(kStoreVariable, (folder.path() / "store").c_str(), 1);
  std::vector<char*> arguments;
  for (std::string& argument : command) arguments.push_back(argument.data());
  arguments.push_back(nullptr);
  const pid_t parent = ::getpid();
  std::vector<pid_t> children;
  for (int rank = 0; rank < count; ++rank) {
    for (const char* name : {"RANK", "LOCAL_RANK"}) ::setenv(name, std::to_string(rank).c_str(), 1);
    children.push_back(::fork());
    if (children.back() < 0) throw IoError(fmt::format("cannot start rank {}", rank));
    if (children.back() > 0) continue;
    ::prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (::getppid() == parent) ::execvp(arguments[0], arguments.data());
    ::_exit(127);
  }
  int failure = 0, passed_on = 0, status = 0;
  Clock::time_point kill_at = Clock::time_point::max();
  const auto signal_all = [&](int number) {
    for (const pid_t child : children) {
      if (child > 0) ::kill(child, number);
    }
  };
  for (pid_t ended = 0; ended >= 0; ended = ::waitpid(-1, &status, WNOHANG)) {
    if (const auto child = std::find(children.begin(), children.end(), ended);
        child != children.end()) {
      *child = -1;
      const int own = WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
      if (own == 0 || failure != 0) continue;
      failure = own;
      if (own == passed_on) continue;
      kill_at = Clock::now() + std::chrono::milliseconds(static_cast<int>(1000 * grace_s));
      fmt::print(stderr, "\nrank {} ended with status {}\n", child - children.begin(), own);
    } else if (const int number = guard.Take()) {
      passed_on = StatusOfSignal(number);
      signal_all(number);
    } else {
      if (Clock::now() > kill_at) signal_all(SIGKILL);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }
  return failure;
}

}  // namespace volalign
