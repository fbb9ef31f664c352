#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/pose.h"
#include "infer/checks/placement.h"
#include "infer/pose/orientation.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

/// One still, as its sensors are placed in it.
struct PlacedStill {
  const std::string& name;
  const std::vector<SensorFrame>& frames;
  const std::vector<LabelledView>& labelled;
  std::vector<Placement>* placements;
};

/// Where the stack stood in each still, by the sensors that are placed in several: about
/// first_from_placement, the first the identity. A sensor stands in one place in all stills: most
/// sensors of a still, weighed by how well they fit to the stack, decide where the stack stood, and
/// most stills of a sensor where it stands. A frame that contradicts that is no longer placed
/// (disagrees), nor is one of a still that no chain of sensors joins to the first (unconnected;
/// the identity is returned for it).
std::vector<Pose> JoinStills(const std::vector<PlacedStill>& stills);

}  // namespace volalign
