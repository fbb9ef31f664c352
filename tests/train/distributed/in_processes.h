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
#include "tests/core/base/temp_folder.h"
#include "train/distributed/world.h"

namespace volalign {

/// Calls `work` in `size` processes of their own, which meet as those of LaunchProcesses do, and
/// gives back their exit statuses; an exception is status 1, and its message what the file `rank`
/// of `folder` has.
inline std::vector<int> InProcesses(int size, const std::filesystem::path& folder,
                                    const std::function<void(const World&)>& work) {
  const TempFolder meeting;
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
      World world;
      world.rank = world.local_rank = rank;
      world.size = size;
      world.store = meeting / "store";
      work(world);
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
