#pragma once

#include <vector>

#include "core/config/config.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/aliases.h"
#include "infer/initial/oriented_points.h"
#include "infer/initial/view_fit.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// What geometry has to find for a pose to be the structure's.
struct GeometryOptions {
  double min_explained_share = 0.94;
  double min_visible_share = 0.3;
  double max_goes_on_share = 0.15;
  double min_area_share = 0.2;
  double rival_margin = 0.1;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("min_explained_share", min_explained_share,
       "least share of the structure's view, but for what something hides, that is measured on it",
       Between(0, 1));
    ar("min_visible_share", min_visible_share, "least share of its view that nothing hides",
       Between(0, 1));
    ar("max_goes_on_share", max_goes_on_share,
       "most of the surroundings of its sides' borders where the measured surface goes on, so that "
       "it is no border",
       Between(0, 1));
    ar("min_area_share", min_area_share,
       "least part of the structure's surface that has to be measured", Between(0, 1));
    ar("rival_margin", rival_margin,
       "two poses whose shapes differ by less, as a share of what the better one explains, explain "
       "a view about equally well",
       Between(0, 1));
  }
};

/// A pose that explains a view by its shape.
struct GeometricPose {
  Pose structure_from_sensor = Pose::Identity();
  ViewFit shape;
  double shape_iou = 0;  ///< ViewFit::shape_iou, with all that were tried
};

/// A view as MeasureShape wants it. Planes that are larger than any of the structure's are the
/// room's.
SensorSurface PrepareSurface(const SensorView& view, const Structure& structure);

/// Is what the view shows the structure at this pose?
bool HasShape(const ViewFit& shape, const Structure& structure, const GeometryOptions& options);

/// The poses at which the structure has the shape of what a view shows, the best first, without any
/// labels: each that explains it about as well as the best one, symmetric ones among them. Empty
/// where the structure is not seen.
///
/// The structure is searched for on every large plane that may be a floor (stack_search.h). Where
/// that finds nothing, up is taken from the directions in which surfaces face, and the height is
/// searched as well. The best candidates are brought onto the boxes (box_fit.h) and verified
/// (view_fit.h). `table_height_m`: of the structure's foot above the floor; negative: not
/// known.
std::vector<GeometricPose> FindPosesByGeometry(const SensorView& view, const Structure& structure,
                                               const std::vector<StructureAlias>& aliases,
                                               double table_height_m,
                                               const GeometryOptions& options);

}  // namespace volalign
