#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/geometry/metrics.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/side_patch.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Point-to-surface residuals of the pixels with a side label and depth.
struct SurfaceFit {
  int points = 0;
  double rms_to_structure_m = 0;  ///< of the points within 10 cm of the structure
  double inlier_share = 0;        ///< share on the structure, by SurfaceTolerance::AtPose
};
SurfaceFit FitToSurface(const SensorView& view, const LabelImage& labels,
                        const Structure& structure, const Pose& structure_from_sensor);

/// Measures of a pose that explains a frame.
struct PoseQuality : SurfaceFit {
  std::vector<std::string> sides;  ///< names of the ConfirmedLabels
  double miou = 0;                 ///< predicted labels against those rendered at the pose
  double label_iou = 0;            ///< Agreement::score
  double explained_share = 0;      ///< Agreement::explained_share
};

/// Measures a pose of `structure`. `view`: with corrected depths. `patches`: of the view's sides.
PoseQuality MeasureQuality(const SensorView& view, const SegmentationResult& segmentation,
                           const std::vector<SidePatch>& patches, const Structure& structure,
                           const Pose& structure_from_sensor);

/// Labels of the patches that have at least half of their pixels on their side, ascending.
std::vector<int> ConfirmedLabels(const SensorView& view, const std::vector<SidePatch>& patches,
                                 const Structure& structure, const Pose& structure_from_sensor);

/// The paper's d1 and d2 (section "Results"), m, of the points within 10 cm of the structure. The
/// first is their distance to the surface. The second is the larger of it and the distance from the
/// exposed surface, sampled at 1 cm. Nothing if no point is near. `points`: structure frame, m.
std::optional<SetDistances> CompareWithSurface(const std::vector<Eigen::Vector3d>& points,
                                               const Structure& structure, int threads = 1);

/// The points of the pixels with a side label and depth, structure frame, m.
std::vector<Eigen::Vector3d> LabelledPoints(const SensorView& view, const LabelImage& labels,
                                            const Pose& structure_from_sensor);

}  // namespace volalign
