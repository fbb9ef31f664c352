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
/// (section Results) for one view with a pose and predicted labels.
struct PoseScore {
  /// Mean IoU of the predicted labels and the model's labels at the pose, over the pixels with
  /// depth. `miou_authors` is over all classes, and a class that both lack counts as 1, as in the
  /// code of the paper's authors. `miou` is over the classes that either has.
  double miou_authors = 0, miou = 0;
  /// miou_authors over all pixels. Those without depth, which no network can label, count too.
  double miou_authors_all = 0;
  int sides = 0;  ///< predicted with at least `min_pixels` pixels
  /// Root mean square, m, of the distance of each such side's mean point at the pose from a
  /// reference. The reference of `rmse_m` is the side's centre (the paper's 3D RMSE). For
  /// `rmse_visible_m` it is the mean point of the model's pixels of the side at the pose. Absent
  /// without sides.
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
  /// Mean of the groups' own std / mean. None if each group has one value. In the paper's table of
  /// the arc the RSD is 2 to 5 times below STD / mean. In all its other tables the RSD is STD /
  /// mean. This mean is as low if distances differ more than captures at one distance.
  std::optional<double> rsd_within;
};
/// `groups`: the set-up of each value.
ColumnStatistics Column(const std::vector<double>& values, const std::vector<int>& groups);

}  // namespace volalign
