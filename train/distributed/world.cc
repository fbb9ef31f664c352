#include "train/distributed/world.h"

#include <fmt/format.h>

#include <charconv>
#include <cstdint>
#include <cstdlib>
#include <limits>

#include "core/base/error.h"

namespace volalign {
namespace {

std::string Required(const char* name) {
  const char* const value = std::getenv(name);
  if (value && *value) return value;
  throw ConfigError(fmt::format(
      "WORLD_SIZE is set and {} is not: start the processes with torchrun, set all of RANK, "
      "WORLD_SIZE, LOCAL_RANK, MASTER_ADDR and MASTER_PORT, or unset WORLD_SIZE",
      name));
}

int Number(const std::string& name, const std::string& text, int least, int largest) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error == std::errc() && end == text.data() + text.size() && value >= least &&
      value <= largest) {
    return value;
  }
  throw ConfigError(
      fmt::format("{} = '{}' is not a whole number from {} to {}", name, text, least, largest));
}

int PortOfRankZero() {
  constexpr int kLargest = 65535;
  if (const char* own = std::getenv("VOLALIGN_PORT"))
    return Number("VOLALIGN_PORT", own, 1, kLargest);
  const int port = Number("MASTER_PORT", Required("MASTER_PORT"), 1, kLargest - 1);
  const bool agent_listens = std::getenv("TORCHELASTIC_RUN_ID") != nullptr;
  return agent_listens ? port + 1 : port;
}

}  // namespace

World ReadWorld() {
  World world;
  const char* const size = std::getenv("WORLD_SIZE");
  if (!size) return world;
  world.size = Number("WORLD_SIZE", size, 1, std::numeric_limits<int>::max());
  if (world.size == 1) return world;
  world.rank = Number("RANK", Required("RANK"), 0, world.size - 1);
  world.local_rank = Number("LOCAL_RANK", Required("LOCAL_RANK"), 0, world.size - 1);
  if (const char* store = std::getenv(kStoreVariable)) {
    world.store = store;
    return world;
  }
  world.address = Required("MASTER_ADDR");
  world.port = PortOfRankZero();
  return world;
}

BatchSlice SliceOf(int batch_size, int rank, int size) {
  if (size > batch_size) {
    throw ConfigError(fmt::format(
        "run.batch_size = {} is the batch of all processes together: {} processes need at least {}",
        batch_size, size, size));
  }
  const auto begin = [&](int of) { return static_cast<int>(std::int64_t{batch_size} * of / size); };
  return {begin(rank), begin(rank + 1) - begin(rank)};
}

}  // namespace volalign
