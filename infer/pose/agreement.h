#pragma once

#include "core/pose.h"
#include "core/structure.h"
#include "infer/view/segmenter.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// How well a pose explains what a sensor measured: pixel counts of the structure as it would be
/// seen from there (core/visibility.h, CastView) against the measured depth and the predicted
/// labels.
struct Agreement {
  int visible = 0;    ///< pixels with depth where the structure would be seen
  int explained = 0;  ///< of those: measured depth on the structure's surface
  int occluded = 0;   ///< of those: something in front
  int see_through =
      0;  ///< of those: the sensor measured through the structure, which contradicts the pose
  int labelled = 0;     ///< pixels with depth and a confident side label
  int on_own_side = 0;  ///< of those: within the tolerance of the finite side that they name
  int same_label = 0;   ///< explained pixels whose label is the predicted one
  int either =
      0;  ///< pixels with a confident side label, in the prediction or in the structure's view
  double miou = 0;  ///< rendered labels against predicted ones (design section 10)

  double explained_share() const { return Ratio(explained, visible); }
  double see_through_share() const { return Ratio(see_through, explained + see_through); }
  double inlier_share() const { return Ratio(on_own_side, labelled); }
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

/// Labels as a pose sees them: of each pixel whose measured point lies within `tolerance_m` of the
/// side that it would show, with confidence 1; 0 elsewhere. From a pose that is right to a pixel or
/// two they are complete and end where surfaces do, which a network's are not and do not.
SegmentationResult LabelsFromPose(const SensorView& view, const Structure& structure,
                                  const Pose& structure_from_sensor, double tolerance_m);

/// Does the structure stand on a floor at this pose? A stack of boxes can look the same upside down
/// (the paper's is unchanged, to 5 mm, by half a turn about a horizontal diagonal), so labels and
/// depths alone do not tell up from down; what lies around it does.
struct FloorEvidence {
  int pixels = 0;    ///< looked at: one in four of those with depth
  int on_floor = 0;  ///< of those: on the plane that the structure stands on, off the structure
  int below = 0;     ///< of those: clearly under that plane, where no true pose has any
  int balance() const { return on_floor - 2 * below; }
};
FloorEvidence FindFloor(const SensorView& view, const Structure& structure,
                        const Pose& structure_from_sensor);

/// Pixels of one view that belong to a structure at a pose, by depth: labels only tell the stack
/// from the room.
struct DepthOverlap {
  int both = 0;    ///< the structure is seen there, and its surface was measured
  int either = 0;  ///< the structure is seen and not hidden there, or a side was labelled
  double ratio() const { return either > 0 ? static_cast<double>(both) / either : 0; }
};
DepthOverlap MeasureOverlap(const SensorView& view, const SegmentationResult& segmentation,
                            const Structure& structure, const Pose& structure_from_sensor,
                            double min_confidence);

}  // namespace volalign
