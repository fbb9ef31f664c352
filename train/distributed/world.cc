#include "train/distributed/world.h"

#include <fmt/format.h>

#include <charconv>
#include <cstdlib>
#include <limits>

#include "core/base/error.h"

namespace volalign {
namespace {

std::string Required(const Environment& environment, const std::string& name) {
  const std::optional<std::string> value = environment(name);
  if (value && !value->empty()) return *value;
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

int PortOf(const Environment& environment) {
  constexpr int kLargest = 65535;
  if (const auto own = environment("VOLALIGN_PORT")) {
    return Number("VOLALIGN_PORT", *own, 1, kLargest);
  }
  const int port = Number("MASTER_PORT", Required(environment, "MASTER_PORT"), 1, kLargest - 1);
  const bool agent_listens = environment("TORCHELASTIC_RUN_ID").has_value();
  return agent_listens ? port + 1 : port;
}

}  // namespace

std::optional<std::string> ProcessEnvironment(const std::string& name) {
  const char* value = std::getenv(name.c_str());
  if (value == nullptr) return std::nullopt;
  return value;
}

World ReadWorld(const Environment& environment) {
  World world;
  const std::optional<std::string> size = environment("WORLD_SIZE");
  if (!size) return world;
  constexpr int kMost = std::numeric_limits<int>::max();
  world.size = Number("WORLD_SIZE", *size, 1, kMost);
  if (world.size == 1) return world;
  world.rank = Number("RANK", Required(environment, "RANK"), 0, world.size - 1);
  world.local_rank = Number("LOCAL_RANK", Required(environment, "LOCAL_RANK"), 0, world.size - 1);
  if (const auto store = environment(kStoreVariable)) {
    world.store = *store;
    return world;
  }
  world.address = Required(environment, "MASTER_ADDR");
  world.port = PortOf(environment);
  return world;
}

BatchSlice SliceOf(int batch_size, const World& world) {
  if (world.size > batch_size) {
    throw ConfigError(fmt::format(
        "run.batch_size = {} is the batch of all processes together: {} processes need at least {}",
        batch_size, world.size, world.size));
  }
  const auto begin = [&](int rank) {
    return static_cast<int>(static_cast<long>(batch_size) * rank / world.size);
  };
  const int first = begin(world.rank);
  return {first, begin(world.rank + 1) - first};
}

}  // namespace volalign
