// libFuzzer's entry: `fuzz --target=NAME [libFuzzer's options] FOLDER ...` (tests/long/fuzz.sh).

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <string_view>

#include "tests/fuzz/targets.h"

namespace {

const volalign::FuzzTarget* chosen = nullptr;

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  constexpr std::string_view kOption = "--target=";
  for (int i = 1; i < *argc; ++i) {
    const std::string_view word = (*argv)[i];
    if (word.substr(0, kOption.size()) != kOption) continue;
    for (const volalign::FuzzTarget& target : volalign::FuzzTargets()) {
      if (word.substr(kOption.size()) == target.name) chosen = &target;
    }
  }
  if (!chosen) {
    std::fprintf(stderr, "--target=NAME is needed, one of tests/fuzz/targets.cc\n");
    std::exit(2);
  }
  return 0;
}

// What is thrown beside volalign::Error is a finding: it ends the program.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  volalign::ReadFuzzInput(*chosen, std::string(reinterpret_cast<const char*>(data), size));
  return 0;
}
