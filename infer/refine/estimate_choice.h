#pragma once

#include <algorithm>
#include <vector>

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

/// What a refinement has chosen to estimate, see ChooseEstimates.
struct EstimateChoice {
  FreeSet told;        ///< what the capture tells more about than its prior does
  PriorScales scales;  ///< of the priors; a kind of scale 0 is held
};

}  // namespace volalign::refine_internal
