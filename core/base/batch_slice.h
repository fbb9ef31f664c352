#pragma once

namespace volalign {

/// The part of each batch that a process draws: samples [first, first + count) of it.
struct BatchSlice {
  int first = 0;
  int count = 0;  ///< 0: all
};

}  // namespace volalign
