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
  double rms_m = 0;         ///< over those within 10 cm of the structure
  double inlier_share = 0;  ///< on it: SurfaceTolerance::AtPose
};
SurfaceFit FitToSurface(const SensorView& view, const LabelImage& labels,
                        const Structure& structure, const Pose& structure_from_sensor);

/// How well a pose explains a frame.
struct PoseQuality {
  std::vector<std::string> sides;  ///< found, and most of their pixels on them
  // SurfaceFit.
  int points = 0;
  double rms_to_structure_m = 0;
  double inlier_share = 0;
  double miou = 0;             ///< predicted labels against those rendered at the pose
  double label_iou = 0;        ///< Agreement::score
  double explained_share = 0;  ///< of the pixels expected on the structure, whose depth matches
};

/// Of a pose of `structure`. `view`: with corrected depths. `patches`: patches of the view's
/// sides. Only labels with `min_confidence` count for label_iou.
PoseQuality MeasureQuality(const SensorView& view, const SegmentationResult& segmentation,
                           const std::vector<SidePatch>& patches, const Structure& structure,
                           const Pose& structure_from_sensor, double min_confidence);

/// Labels of the patches of which most pixels lie on their side, ascending.
std::vector<int> ConfirmedLabels(const SensorView& view, const std::vector<SidePatch>& patches,
                                 const Structure& structure, const Pose& structure_from_sensor);

/// d1 and d2 of the paper (section "Results"), of the points within 10 cm of the structure: to its
/// surface, and for d2 from its exposed surface, sampled at 1 cm. Nothing where no point is near.
/// `points`: structure frame, m.
std::optional<SetDistances> CompareWithSurface(const std::vector<Eigen::Vector3d>& points,
                                               const Structure& structure, int threads = 1);

/// The points of the pixels with a side label and depth, structure frame, m.
std::vector<Eigen::Vector3d> LabelledPoints(const SensorView& view, const LabelImage& labels,
                                            const Pose& structure_from_sensor);

}  // namespace volalign
