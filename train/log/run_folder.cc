#include "train/log/run_folder.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <functional>
#include <string>
#include <system_error>
#include <utility>

namespace volalign {
namespace {

constexpr char kStateSuffix[] = ".state";
/// A killed process keeps its lock until its memory is freed, which takes seconds on a busy
/// machine.
constexpr std::chrono::seconds kLockPatience(10);

/// The number in a state's name, or -1.
std::int64_t SamplesOf(const std::filesystem::path& path) {
  const std::string stem = path.stem().string();
  std::int64_t samples = -1;
  const auto [end, error] = std::from_chars(stem.data(), stem.data() + stem.size(), samples);
  if (error != std::errc() || end != stem.data() + stem.size()) return -1;
  return path.extension() == kStateSuffix ? samples : -1;
}

}  // namespace

RunFolder::RunFolder(std::filesystem::path dir) : dir_(std::move(dir)), lock_(dir_, kLockPatience) {
  MakeFolder(dir_ / "states");
}

std::filesystem::path RunFolder::State(std::int64_t samples) const {
  return dir_ / "states" / fmt::format("{:012}{}", samples, kStateSuffix);
}

std::vector<std::int64_t> RunFolder::States() const {
  std::vector<std::int64_t> states;
  std::error_code missing;
  for (const auto& entry : std::filesystem::directory_iterator(dir_ / "states", missing)) {
    const std::int64_t samples = SamplesOf(entry.path());
    if (samples >= 0) states.push_back(samples);
  }
  std::sort(states.begin(), states.end(), std::greater<>());
  return states;
}

void RunFolder::KeepStates(int count) const {
  const std::vector<std::int64_t> states = States();
  for (std::size_t i = static_cast<std::size_t>(count); i < states.size(); ++i) {
    std::error_code ignored;
    std::filesystem::remove(State(states[i]), ignored);
  }
}

void RunFolder::BeginAfter(std::int64_t samples) const {
  std::error_code ignored;
  for (const std::int64_t state : States()) {
    if (state > samples) std::filesystem::remove(State(state), ignored);
  }
  for (const std::filesystem::path& folder : {dir_, dir_ / "states"}) RemoveTemporaries(folder);
}

}  // namespace volalign
