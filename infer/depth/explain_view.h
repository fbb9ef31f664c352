#pragma once

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/depth/explain_ray.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Independent cells that the ray of a pixel stands for: the solid angle that it covers, in squares
/// of the correlation length of the sensor's smooth error. Neighbouring rays share that error, and
/// meet the same object.
double CellsOf(const SensorView& view, int u, int v);

/// Is there a surface, of which so many cells were measured, and so many behind it? Natural
/// logarithm of the odds.
double LogOddsOfSurface(double on_it, double behind_it);

/// What the rays of a view say of a pose, in independent cells.
struct ViewExplanation {
  /// Of the rays on which the structure would be seen.
  CauseShares causes = {};
  /// Of the rays that a network has labelled: those on the side that the label names, and the
  /// others. A part of the structure without labels says nothing: the network may not know it.
  double named_so = 0, named_otherwise = 0;
  double labelled_on = 0;  ///< of the labelled rays, those on any side of the structure

  bool has_labels() const { return named_so + named_otherwise > 0; }
  double of(Cause cause) const { return causes[static_cast<std::size_t>(cause)]; }
  /// Of the rays that nothing before the structure keeps from it, the share that passes through it.
  double behind_share() const;
  double named_so_share() const;
  /// Is the pose right rather than wrong? Natural logarithms of the odds: by depths, of which only
  /// those on the structure and behind it tell, as what may hide it or be missing does not depend
  /// on the pose; by labels; and by their outline: of what lies on the structure or is labelled as
  /// any side of it, the share that is both. Without labels, the last two are 0.
  double LogOddsByDepth() const;
  double LogOddsByLabels() const;
  double LogOddsByOutline() const;
};

/// `sigma_m`: standard deviation of the structure's surface, m, by the pose and by how the boxes
/// stand. `segmentation`: of a network, or null where labels say nothing; those with less than
/// `min_confidence` are none.
ViewExplanation ExplainView(const SensorView& view, const SegmentationResult* segmentation,
                            const Structure& structure, const Pose& structure_from_sensor,
                            double sigma_m, double min_confidence);

}  // namespace volalign
