#pragma once

#include <cstddef>
#include <vector>

#include "core/config/config.h"
#include "core/geometry/structure.h"
#include "infer/checks/arrangements.h"
#include "infer/checks/outcome.h"
#include "infer/initial/initial_pose.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

struct AssemblyOptions {
  bool enabled = true;
  double suspicious_shape_iou = 0.92;
  double min_shape_iou = 0.7;
  double margin = 0.08;
  double suspicious_frame_shape_iou = 0.85;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("enabled", enabled, "look for a stack that is built otherwise than the structure says");
    ar("suspicious_shape_iou", suspicious_shape_iou,
       "intersection over union of the structure as described and what the sensors see, below "
       "which "
       "other arrangements are tried",
       Between(0, 1), FormerlyNamed("suspicious_overlap"));
    ar("min_shape_iou", min_shape_iou,
       "least intersection over union of another arrangement that is believed", Between(0, 1),
       FormerlyNamed("min_overlap"));
    ar("margin", margin,
       "by how much its intersection over union has to exceed that of the structure as described",
       Between(0, 1));
    ar("suspicious_frame_shape_iou", suspicious_frame_shape_iou,
       "intersection over union of the structure as described and what one sensor sees, below "
       "which "
       "its frame may be mirrored",
       Between(0, 1), FormerlyNamed("suspicious_frame_overlap"));
  }
};

/// A sensor whose view is asked. What it refers to must outlive the check.
struct AssemblySensor {
  const SensorView* view = nullptr;
  const SegmentationResult* segmentation = nullptr;
  const InitialPose* initial = nullptr;  ///< of the arrangement as described
};

struct AssemblyReport {
  Arrangement arrangement;         ///< code kNone: nothing speaks for another one
  double described_shape_iou = 0;  ///< of all sensors together (ShapeIou::ratio)
  double shape_iou = 0;            ///< the same of `arrangement`
  /// Indices of sensors whose frames alone are mirrored: the others see the stack as described.
  std::vector<std::size_t> mirrored_frames;
  bool altered() const { return arrangement.code != SensorCode::kNone; }
};

/// Does another arrangement explain the sensors' views clearly better than the one described?
/// Others are tried only where the one described leaves something to explain. For each, every
/// sensor's pose is estimated again, and has to stand on a floor where there is one. At most
/// eight are asked, those with the most labelled pixels. `threads` >= 1.
///
/// Before that, every sensor on its own is asked for a mirrored frame: where the mirror image of
/// the stack explains some views clearly better, others fit as described, and no single arrangement
/// explains all of them as well, those frames are mirrored and left out of the rest.
AssemblyReport InspectAssembly(const std::vector<AssemblySensor>& sensors,
                               const Structure& structure, const InitialPoseOptions& initial,
                               const AssemblyOptions& options, int threads);

}  // namespace volalign
