#pragma once

// What the programs of this folder have in common.

#include <fmt/format.h>

#include <cstdio>
#include <exception>
#include <utility>

namespace volalign {

/// The status of `work`; 1, and a line on stderr, where it throws.
template <class Work>
int StatusOf(Work&& work) {
  try {
    return std::forward<Work>(work)();
  } catch (const std::exception& error) {
    fmt::print(stderr, "error: {}\n", error.what());
    return 1;
  }
}

}  // namespace volalign
