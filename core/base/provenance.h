#pragma once

#include <string>

namespace volalign {

/// The program with its source: "volalign 0.2.0 (e7d50cc1f2a3 of 2026-11-24)", version, commit and
/// its date. "-dirty" follows the commit if files differed from it. Without a repository there is
/// the version alone.
std::string Tool();

/// The version alone, "0.2.0".
std::string Version();

/// The present time in UTC, in ISO 8601: "2026-11-24T09:46:16Z". If SOURCE_DATE_EPOCH is set, the
/// time after so many seconds since 1970, for reproducible files
/// (reproducible-builds.org/specs/source-date-epoch). Throws ConfigError if it is no number.
std::string UtcNow();

}  // namespace volalign
