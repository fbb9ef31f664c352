#pragma once

#include <string>
#include <vector>

namespace volalign {

/// This process's command line.
std::vector<std::string> OwnCommand();

/// Runs `command` (program and arguments) `count` times at once on this machine, each with the
/// variables of ReadWorld, and waits for all; nothing else in this process may have children.
/// SIGINT and SIGTERM are passed on to them, and SIGTERM should this process be killed. When one of
/// them fails, the others have `grace_s` seconds to notice. Returns 0, the exit status of the first
/// that failed, as a shell gives it (which one that was is said on stderr), or StatusOfSignal where
/// they ended by a signal that was passed on. Throws IoError where a process cannot be started.
int LaunchProcesses(int count, std::vector<std::string> command, double grace_s = 60);

}  // namespace volalign
