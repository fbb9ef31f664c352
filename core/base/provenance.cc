#include "core/base/provenance.h"

#include <fmt/chrono.h>

#include <charconv>
#include <cstdlib>
#include <cstring>
#include <ctime>

#include "core/base/error.h"

namespace volalign {

// Defined in version.cc, which cmake/WriteVersion.cmake writes.
extern const char kVersion[], kCommit[];

namespace {

std::time_t Seconds() {
  const char* epoch = std::getenv("SOURCE_DATE_EPOCH");
  if (!epoch) return std::time(nullptr);
  std::int64_t seconds = 0;
  const char* end = epoch + std::strlen(epoch);
  const auto [rest, error] = std::from_chars(epoch, end, seconds);
  constexpr std::int64_t kYear10000 = 253402300800;
  if (error != std::errc() || rest != end || seconds < 0 || seconds >= kYear10000) {
    throw ConfigError(fmt::format(
        "SOURCE_DATE_EPOCH is \"{}\", which is no number of seconds since 1970", epoch));
  }
  return static_cast<std::time_t>(seconds);
}

}  // namespace

std::string Version() { return kVersion; }

std::string Tool() {
  const std::string tool = "volalign " + Version();
  return *kCommit ? fmt::format("{} ({})", tool, kCommit) : tool;
}

std::string UtcNow() { return fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(Seconds())); }

}  // namespace volalign
