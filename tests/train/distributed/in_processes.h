#pragma once

#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>

#include <exception>
#include <filesystem>
#include <functional>
#include <vector>

#include "core/base/file_util.h"
#include "core/nn/cpu/torch_threads.h"
#include "train/distributed/rendezvous.h"
#include "train/distributed/world.h"

namespace volalign {

inline World WorldOf(int rank, int size, int port) {
  World world;
  world.rank = world.local_rank = rank;
  world.size = size;
  world.address = "127.0.0.1";
  world.port = port;
  return world;
}

/// Calls `work` in `size` processes of their own, on a port that is free, and gives back their exit
/// statuses; an exception is status 1, and its message what the file `rank` of `folder` has.
inline std::vector<int> InProcesses(int size, const std::filesystem::path& folder,
                                    const std::function<void(const World&)>& work) {
  const int port = FreePort();
  std::vector<pid_t> children;
  for (int rank = 0; rank < size; ++rank) {
    const pid_t child = ::fork();
    if (child != 0) {
      children.push_back(child);
      continue;
    }
    int status = 0;
    try {
      SetTorchThreads(1);
      work(WorldOf(rank, size, port));
    } catch (const std::exception& e) {
      status = 1;
      WriteFileAtomically(folder / fmt::format("message{}", rank), e.what());
    }
    ::_exit(status);
  }
  std::vector<int> statuses;
  for (const pid_t child : children) {
    int status = 0;
    ::waitpid(child, &status, 0);
    statuses.push_back(WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status));
  }
  return statuses;
}

}  // namespace volalign
