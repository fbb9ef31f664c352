#pragma once

#include <string>

namespace volalign {

/// Keeps the program's arguments for CommandLine; called once, by main.
void KeepCommandLine(int argc, const char* const* argv);

/// How the program was called, as a shell reads it.
std::string CommandLine();

}  // namespace volalign
