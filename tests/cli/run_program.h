#pragma once

// Runs the program under test, VOLALIGN_PROGRAM, as a user would.

#include <sys/wait.h>

#include <cstdio>
#include <string>

namespace volalign {

struct Outcome {
  int status = -1;
  std::string output;  ///< standard output and standard error
};

inline Outcome Volalign(const std::string& arguments) {
  const std::string command = std::string(VOLALIGN_PROGRAM) + " " + arguments + " 2>&1";
  Outcome run;
  FILE* pipe = ::popen(command.c_str(), "r");
  char buffer[4096];
  while (std::fgets(buffer, sizeof(buffer), pipe)) run.output += buffer;
  const int status = ::pclose(pipe);
  run.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return run;
}

}  // namespace volalign
