#pragma once

#include <cstdint>
#include <cstdlib>
#include <string_view>

namespace volalign {

/// How often a test repeats what it draws by chance: `all` where the environment has
/// VOLALIGN_LONG=1 (tests/long.sh), else `usual`.
inline std::uint64_t Rounds(std::uint64_t usual, std::uint64_t all) {
  const char* const asked = std::getenv("VOLALIGN_LONG");
  return asked != nullptr && std::string_view(asked) == "1" ? all : usual;
}

}  // namespace volalign
