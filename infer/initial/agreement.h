#pragma once

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// m: a point that is nearer than this to a surface lies on it, at a pose that is not refined yet.
inline constexpr double kInitialTolerance = 0.05;

/// How well a pose explains what a sensor measured: pixel counts of the structure as it would be
/// seen from there (core/geometry/visibility.h, CastView) against the measured depth and the
/// predicted labels.
struct Agreement {
  int visible = 0;      ///< pixels with depth where the structure would be seen
  int explained = 0;    ///< of those: measured depth on the structure's surface
  int behind = 0;       ///< of those: something behind, which contradicts the pose
  int labelled = 0;     ///< pixels with depth and a confident side label
  int on_own_side = 0;  ///< of those: within the tolerance of the finite side that they name
  int same_label = 0;   ///< explained pixels whose label is the predicted one
  int either = 0;       ///< pixels with a side label, as predicted or as seen from the pose
  double miou = 0;      ///< mean IoU over classes (core/geometry/metrics.h) of these labels

  double explained_share() const { return Ratio(explained, visible); }
  double behind_share() const { return Ratio(behind, explained + behind); }
  double on_side_share() const { return Ratio(on_own_side, labelled); }
  /// Intersection over union of "side k, at the right depth"; 1 for a perfect pose and perfect
  /// labels.
  double score() const { return Ratio(same_label, either); }

 private:
  static double Ratio(int a, int b) { return b > 0 ? static_cast<double>(a) / b : 0.0; }
};

/// `tolerance_m`: distance within which depths agree and points lie on their side.
Agreement CompareWithView(const SensorView& view, const SegmentationResult& segmentation,
                          const Structure& structure, const Pose& structure_from_sensor,
                          double min_confidence, double tolerance_m);

/// Labels as seen from a pose: each pixel whose measured point lies within `tolerance_m` of the
/// side that the structure would show there gets that side's label, with confidence 1; all others
/// get 0. If the pose is right to a pixel or two, these labels are complete and end where the
/// surfaces do; those of a network are not and do not.
SegmentationResult LabelsFromPose(const SensorView& view, const Structure& structure,
                                  const Pose& structure_from_sensor, double tolerance_m);

/// How far the shape of what was seen is the structure's: pixels of one view that belong to a
/// structure at a pose, by depth. Which side a label names does not matter; labels only tell the
/// structure from the room.
struct ShapeIou {
  int both = 0;    ///< the structure is seen there, and its surface was measured
  int either = 0;  ///< the structure is seen and not hidden there, or a side was labelled
  double ratio() const { return either > 0 ? static_cast<double>(both) / either : 0; }
  /// Of several views together.
  ShapeIou& operator+=(const ShapeIou& other) {
    both += other.both;
    either += other.either;
    return *this;
  }
};
ShapeIou MeasureShapeIou(const SensorView& view, const SegmentationResult& segmentation,
                         const Structure& structure, const Pose& structure_from_sensor,
                         double min_confidence);

}  // namespace volalign
