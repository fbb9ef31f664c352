#pragma once

#include <string>
#include <vector>

namespace volalign {

/// This process's command line.
std::vector<std::string> OwnCommand();

/// Runs `command` (program and arguments) `count` times at once on this machine, each with the
/// variables of ReadWorld, and waits for all. This process may have no other children. SIGINT and
/// SIGTERM are passed on to them; if this process is killed, they get SIGTERM. If one of them
/// fails, the others have `grace_s` seconds to notice. Returns 0, or the exit status of the first
/// that failed, as a shell gives it (stderr says which). Returns StatusOfSignal if they ended by a
/// signal that was passed on. Throws IoError if a process cannot be started.
int LaunchProcesses(int count, std::vector<std::string> command, double grace_s = 60);

}  // namespace volalign
