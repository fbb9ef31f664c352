#pragma once

#include <vector>

#include "core/structure.h"
#include "infer/checks/placement.h"
#include "infer/pose/orientation.h"
#include "infer/view/sensor_frame.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Places sensors that failed as degenerate_sides by what they share with those that are placed.
///
/// Such a sensor's pose is open along some directions, or only one side of it is known. Candidates
/// are made along these directions from the initial pose, or from the largest sides and the way in
/// which the other sensors are mounted. They are ranked by how much of what the sensor measured
/// lies on what its neighbours measured, less what lies where one of the two sees through. The best
/// are refined together with the placed sensors, by structure and overlap. The sensor is placed
/// where one of them explains its view of the structure, shares options.verdict.min_shared_share
/// with its neighbours, is known to options.verdict.max_sigma_by_neighbours_*, and no other
/// candidate does about as well. PlacedSensor::by_neighbours then says so; a sensor that is not
/// placed keeps its finding.
std::vector<Placement> PlaceByNeighbours(const std::vector<SensorFrame>& frames,
                                         const std::vector<SensorView>& views,
                                         const std::vector<LabelledView>& labelled,
                                         std::vector<Placement> placements, const LensSet& lenses,
                                         const Structure& structure,
                                         const PlacementOptions& options);

}  // namespace volalign
