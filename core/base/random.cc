#include "core/base/random.h"

#include <cmath>

namespace volalign {

namespace {

constexpr std::uint32_t kMultiplier0 = 0xD2511F53u;
constexpr std::uint32_t kMultiplier1 = 0xCD9E8D57u;
constexpr std::uint32_t kWeyl0 = 0x9E3779B9u;
constexpr std::uint32_t kWeyl1 = 0xBB67AE85u;
constexpr double kTwoPi = 6.283185307179586476925;

/// FNV-1a, 64 bits: a stage's name becomes the upper half of the counter.
std::uint64_t HashName(std::string_view name) {
  std::uint64_t hash = 14695981039346656037ull;
  for (const char c : name) {
    hash ^= static_cast<unsigned char>(c);
    hash *= 1099511628211ull;
  }
  return hash;
}

}  // namespace

std::array<std::uint32_t, 4> Philox4x32(std::array<std::uint32_t, 4> counter,
                                        std::array<std::uint32_t, 2> key) {
  for (int round = 0; round < 10; ++round) {
    const std::uint64_t p0 = static_cast<std::uint64_t>(kMultiplier0) * counter[0];
    const std::uint64_t p1 = static_cast<std::uint64_t>(kMultiplier1) * counter[2];
    counter = {
        static_cast<std::uint32_t>(p1 >> 32) ^ counter[1] ^ key[0], static_cast<std::uint32_t>(p1),
        static_cast<std::uint32_t>(p0 >> 32) ^ counter[3] ^ key[1], static_cast<std::uint32_t>(p0)};
    key[0] += kWeyl0;
    key[1] += kWeyl1;
  }
  return counter;
}

RandomStream::RandomStream(std::uint64_t seed, std::uint64_t index, std::string_view stage) {
  // One Philox call under the seed turns (stage, index) into the stream's own key and upper half of
  // the counter. It is a bijection, so two streams of one seed share no block.
  const std::uint64_t name = HashName(stage);
  const std::array<std::uint32_t, 4> derived =
      Philox4x32({static_cast<std::uint32_t>(name), static_cast<std::uint32_t>(name >> 32),
                  static_cast<std::uint32_t>(index), static_cast<std::uint32_t>(index >> 32)},
                 {static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32)});
  key_ = {derived[0], derived[1]};
  counter_ = {0, 0, derived[2], derived[3]};
}

std::uint32_t RandomStream::NextU32() {
  if (used_ == 4) {
    block_ = Philox4x32(counter_, key_);
    if (++counter_[0] == 0) ++counter_[1];
    used_ = 0;
  }
  return block_[static_cast<std::size_t>(used_++)];
}

double RandomStream::Uniform() { return (NextU32() >> 8) * 0x1.0p-24; }

double RandomStream::Uniform(double low, double high) { return low + (high - low) * Uniform(); }

int RandomStream::Below(int n) {
  return static_cast<int>((static_cast<std::uint64_t>(NextU32()) * static_cast<std::uint64_t>(n)) >>
                          32);
}

bool RandomStream::Chance(double probability) { return Uniform() < probability; }

double RandomStream::Normal() {
  if (has_spare_) {
    has_spare_ = false;
    return spare_;
  }
  const double u = (static_cast<double>(NextU32()) + 1.0) * 0x1.0p-32;  // (0, 1]
  const double angle = kTwoPi * Uniform();
  const double radius = std::sqrt(-2.0 * std::log(u));
  spare_ = radius * std::sin(angle);
  has_spare_ = true;
  return radius * std::cos(angle);
}

double RandomStream::Normal(double mean, double sigma) { return mean + sigma * Normal(); }

}  // namespace volalign
