#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <string>
#include <vector>

#include "core/geometry/structure.h"

namespace volalign {

/// Precision, m, of measured and stacked boxes. Up to it, they may seem to share space, or to float
/// above what they stand on.
inline constexpr double kStackTolerance = 5e-3;

/// The bounding box in the structure frame, m.
Eigen::AlignedBox3d BoundsOf(const Box& box);

/// Does a box stand on another one?
bool RestsOn(const Box& box, const Box& below);

/// Indices of the boxes that rest on a box, directly or not.
std::vector<std::size_t> BoxesOn(const std::vector<Box>& boxes, std::size_t box);

/// A fault of a described stack: impossible, or unlikely.
struct StackFault {
  bool impossible = false;
  std::string
      text;  ///< a sentence that names the boxes, what is wrong by how many mm, and what to do
};

/// Impossible: boxes that share space, or stand neither on the floor (the lowest side of all) nor
/// on a box, by more than 5 cm. Doubtful: the same by less, beyond kStackTolerance. Boxes are also
/// doubtful if their longest edge is less than 10 cm or more than 5 m, as in other units. So are
/// gaps of up to 5 cm between boxes side by side, and boxes whose middle is beyond what they stand
/// on. Impossible for meshes: fewer than three flat sides of different directions. How meshes
/// stand and touch is not asked.
std::vector<StackFault> FindStackFaults(const Structure& structure);

/// Throws DataError with the sentence of the first impossible fault.
void RequireStack(const Structure& structure);

}  // namespace volalign
