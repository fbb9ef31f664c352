#pragma once

// Runs the program under test, VOLALIGN_PROGRAM, as a user would.

#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <string>
#include <vector>

#include "core/base/file_util.h"
#include "core/base/text.h"
#include "tests/core/base/read_file.h"

namespace volalign {

struct Outcome {
  int status = -1;
  std::string output;  ///< standard output and standard error
};

/// The program at work. `arguments` are words with a blank between them, which no shell reads.
class RunningProgram {
 public:
  explicit RunningProgram(const std::string& arguments) {
    std::vector<std::string> words = Split(VOLALIGN_PROGRAM " " + arguments, ' ');
    std::vector<char*> pointers;
    for (std::string& word : words) {
      if (!word.empty()) pointers.push_back(word.data());
    }
    pointers.push_back(nullptr);
    int ends[2] = {-1, -1};
    if (::pipe(ends) != 0) return;
    child_ = ::fork();
    if (child_ == 0) {
      ::dup2(ends[1], STDOUT_FILENO);
      ::dup2(ends[1], STDERR_FILENO);
      ::close(ends[0]);
      ::close(ends[1]);
      ::signal(SIGINT, SIG_DFL);  // ignored where a shell runs the tests in the background
      ::execv(pointers[0], pointers.data());
      ::_exit(127);
    }
    ::close(ends[1]);
    output_ = ends[0];
  }
  ~RunningProgram() {
    if (child_ > 0) {
      ::kill(child_, SIGKILL);
      Wait();
    }
  }
  RunningProgram(const RunningProgram&) = delete;
  RunningProgram& operator=(const RunningProgram&) = delete;

  /// Waits until main has begun, which takes SIGINT (proc(5)), or the program has ended.
  void WaitForMain() const {
    const std::string path = "/proc/" + std::to_string(child_) + "/status";
    for (bool begun = false; !begun; ::usleep(1000)) {
      const std::string status = ReadFile(path);
      const std::size_t caught = status.find("SigCgt:\t");
      begun = status.find("State:\tZ") != std::string::npos || caught == std::string::npos ||
              (std::stoull(status.substr(caught + 8, 16), nullptr, 16) >> (SIGINT - 1) & 1) != 0;
    }
  }
  void Signal(int number) const { ::kill(child_, number); }

  Outcome Wait() {
    Outcome run;
    char buffer[4096];
    for (ssize_t n; (n = ::read(output_, buffer, sizeof(buffer))) > 0;)
      run.output.append(buffer, static_cast<std::size_t>(n));
    ::close(output_);
    int status = 0;
    ::waitpid(child_, &status, 0);
    child_ = -1;
    run.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    return run;
  }

 private:
  pid_t child_ = -1;
  int output_ = -1;
};

inline Outcome Volalign(const std::string& arguments) { return RunningProgram(arguments).Wait(); }

}  // namespace volalign
