#pragma once

#include <optional>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/metrics.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// The metrics of the paper "Deep Soft Procrustes for Markerless Volumetric Sensor Alignment"
/// (section Results) for one view, a pose of it, and the labels that were predicted for it.
struct PoseScore {
  /// Mean IoU of the predicted labels and those that the structure's model shows at the pose, over
  /// the pixels with depth: over all classes, one that is absent from both maps counting as 1 (the
  /// code of the paper's authors), and over the classes that are present in either.
  double miou_authors = 0, miou = 0;
  /// miou_authors over all pixels: those without depth, which no network can label, count too.
  double miou_authors_all = 0;
  int sides = 0;  ///< predicted with at least `min_pixels` pixels
  /// Root mean square, m, of the distances between the mean point of each such side's pixels at the
  /// pose, and the side's centre (the paper's 3D RMSE) or the mean point of the pixels on which the
  /// model shows the side at the pose. Absent without sides.
  std::optional<double> rmse_m, rmse_visible_m;
};
PoseScore ScorePose(const SensorView& view, const LabelImage& labels, const Structure& structure,
                    const Pose& structure_from_sensor, int min_pixels);

/// A column of the paper's tables.
struct ColumnStatistics {
  int count = 0;
  double mean = 0;
  double std = 0;  ///< of the population
  double rsd = 0;  ///< std / mean
  /// Mean of the groups' own std / mean. The paper's table of the arc has an RSD that is 2 to 5
  /// times below its STD / mean, as this one would be where distances differ more than captures at
  /// one distance do; in all its other tables the RSD is STD / mean.
  /// None where each group has one value.
  std::optional<double> rsd_within;
};
/// `groups`: of each value, the set-up that it comes from.
ColumnStatistics Column(const std::vector<double>& values, const std::vector<int>& groups);

}  // namespace volalign
