#pragma once

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/depth/explain_ray.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Independent cells that the ray of a pixel stands for: its solid angle, in squares of the
/// correlation length of the sensor's smooth error. Neighbouring rays share that error, and meet
/// the same object.
double CellsOf(const SensorView& view, int u, int v);

/// Is there a surface, if so many cells were measured on it, and so many behind it? Natural
/// logarithm of the odds.
double LogOddsOfSurface(double on_it, double behind_it);

/// The evidence of a view's rays about a pose, in independent cells.
struct ViewExplanation {
  /// For the rays on which the structure is expected.
  CauseShares causes = {};
  /// Labelled rays on the side that the label names, and the others. A part of the structure
  /// without labels says nothing: the network may not know it.
  double named_so = 0, named_otherwise = 0;
  double labelled_on = 0;  ///< of the labelled rays, those on any side of the structure

  bool has_labels() const { return named_so + named_otherwise > 0; }
  double of(Cause cause) const { return causes[static_cast<std::size_t>(cause)]; }
  /// The share that passes through the structure, of the rays that nothing before it hides.
  double behind_share() const;
  double named_so_share() const;
  /// Is the pose right rather than wrong? Natural logarithms of the odds. By depths: only those on
  /// the structure and behind it count, since hiding objects and missing depths do not depend on
  /// the pose. By labels. By their outline: the share that is both, of the rays on the structure or
  /// labelled as any side of it. Without labels, the last two are 0.
  double LogOddsByDepth() const;
  double LogOddsByLabels() const;
  double LogOddsByOutline() const;
};

/// Explains a view by the structure at a pose. `sigma_m`: standard deviation of the structure's
/// surface, m, by the pose and the boxes' places. `segmentation`: of a network, or null if labels
/// say nothing.
ViewExplanation ExplainView(const SensorView& view, const SegmentationResult* segmentation,
                            const Structure& structure, const Pose& structure_from_sensor,
                            double sigma_m);

}  // namespace volalign
