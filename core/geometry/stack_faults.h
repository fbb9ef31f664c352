#pragma once

#include <string>
#include <vector>

#include "core/geometry/structure.h"

namespace volalign {

/// How exactly boxes are measured and stacked, m: so far they may seem to share space, or to stand
/// above what they stand on.
inline constexpr double kStackTolerance = 5e-3;

/// What a description says that a stack of boxes cannot be, or hardly is.
struct StackFault {
  bool impossible = false;
  std::string
      text;  ///< a sentence that names the boxes, what is wrong by how many mm, and what to do
};

/// Impossible: boxes that share space, or stand neither on the floor (the lowest side of all) nor
/// on a box, by more than 5 cm. Doubtful: the same by less, beyond kStackTolerance; boxes of less
/// than 10 cm or more than 5 m, as in other units; gaps of up to 5 cm between sides that face each
/// other; boxes whose middle is beyond what they stand on.
std::vector<StackFault> FindStackFaults(const Structure& structure);

/// Throws DataError, of one sentence, for a stack with an impossible fault.
void RequireStack(const Structure& structure);

}  // namespace volalign
