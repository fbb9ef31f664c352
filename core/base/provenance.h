#pragma once

#include <string>

namespace volalign {

/// The program and what it was built from: "volalign 0.2.0 (e7d50cc1f2a3 of 2026-11-24)", version,
/// commit and its date. "-dirty" follows the commit where files differed from it; without a
/// repository there is the version alone.
std::string Tool();

/// The version alone, "0.2.0".
std::string Version();

/// Now, in UTC, as ISO 8601 has it: "2026-11-24T09:46:16Z". Where SOURCE_DATE_EPOCH is set, the
/// seconds since 1970 that it says, for files that are equal twice
/// (reproducible-builds.org/specs/source-date-epoch); throws ConfigError where it is no number.
std::string UtcNow();

}  // namespace volalign
