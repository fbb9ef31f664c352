#include "infer/formats/read_budget.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include "core/base/error.h"

namespace volalign {

namespace {

/// Most bytes unpacked from one stored byte. Frames without any noise reach some 50.
constexpr std::uint64_t kMostOfAByte = 128;
constexpr std::uint64_t kBlock = 512;  // bytes, of stat's count
constexpr int kMebibyteBits = 20;

}  // namespace

void ReadBudget::Open(const std::filesystem::path& path) {
  struct stat file {};
  if (stat(path.c_str(), &file) != 0 || !files_.emplace(file.st_dev, file.st_ino).second) return;
  allowed_ += kMostOfAByte * kBlock * static_cast<std::uint64_t>(file.st_blocks);
}

bool ReadBudget::Spend(std::uint64_t bytes) {
  if (bytes > allowed_ - spent_) return false;
  spent_ += bytes;
  return true;
}

void ReadBudget::Unpack(std::uint64_t bytes, const std::string& name) {
  if (Spend(bytes)) return;
  throw DataError(
      fmt::format("{}: unpacked, it has more than {} MiB, and no file of this size holds so much. "
                  "It is damaged, or made to use up time",
                  name, allowed_ >> kMebibyteBits));
}

void ReadBudget::Keep(std::uint64_t bytes, const std::string& name) {
  if (bytes > allowed_ - kept_) {
    throw DataError(
        fmt::format("{}: its depth needs more than {} MiB of memory; read fewer frames or fewer "
                    "sensors at once",
                    name, allowed_ >> kMebibyteBits));
  }
  kept_ += bytes;
}

}  // namespace volalign
