#pragma once

#include <algorithm>
#include <optional>
#include <vector>

#include "core/geometry/sensor_kind.h"

namespace volalign::refine_internal {

/// What is estimated beside the poses and the nuisances that are always free.
struct FreeSet {
  std::vector<char> boxes;   ///< of each box of each still, still by still
  std::vector<char> gain;    ///< of each frame; those of one sensor are alike
  std::vector<char> offset;  ///< of each frame
  std::vector<char> lens;    ///< of each lens
  bool size = false;

  bool AllBoxes() const {
    return std::all_of(boxes.begin(), boxes.end(), [](char free) { return free != 0; });
  }
};

/// How far each kind of what is estimated beside the poses strays from its nominal value, as a
/// factor on its prior standard deviation; 0: not at all.
struct PriorScales {
  double places = 1, turns = 1;  ///< of boxes
  double size = 1, gain = 1, offset = 1;
};

/// Errors that a sensor's observations share, beyond its constant depth error.
struct NoiseModel {
  DepthErrorModel depth = ErrorsOf("");  ///< its smooth part and its corners are fitted
  double edge = 1;                       ///< scale of the silhouettes' standard deviations
  double line = 0;  ///< m, standard deviation of an edge's place where its box's is not estimated
};

/// What a refinement has chosen to estimate, see ChooseEstimates, and by which errors.
struct EstimateChoice {
  FreeSet told;        ///< what the capture tells more about than its prior does
  PriorScales scales;  ///< of the priors; a kind of scale 0 is held
  /// Of each frame that is not held: one that contradicts the others errs by its own pose. Empty:
  /// they are fitted.
  std::vector<std::optional<NoiseModel>> noise;
};

}  // namespace volalign::refine_internal
