#pragma once

#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/aliases.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// The labels that the sides have after the symmetry's motion.
SegmentationResult Relabelled(SegmentationResult segmentation, const StructureAlias& alias);

/// Corrects labels by a pose that shape and floor have settled. A pixel that lies on the side of
/// its label keeps it. Any other pixel takes the label, with its confidence, of the nearest
/// candidate side on which it lies. Candidates are the labels that `segmentation` and `others` (the
/// same frame in other orientations) give it with at least `min_confidence`. The labels that these
/// have after each symmetry are candidates too. A network that sees only a part of the structure
/// takes some boxes for their neighbours.
void ReconcileLabels(const SensorView& view, const Structure& structure,
                     const std::vector<StructureAlias>& aliases, const Pose& structure_from_sensor,
                     const std::vector<const SegmentationResult*>& others, double min_confidence,
                     SegmentationResult* segmentation);

}  // namespace volalign
