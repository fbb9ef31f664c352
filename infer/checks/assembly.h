#pragma once

#include <cstddef>
#include <vector>

#include "core/config.h"
#include "core/structure.h"
#include "infer/checks/arrangements.h"
#include "infer/checks/outcome.h"
#include "infer/pose/initial_pose.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

struct AssemblyOptions {
  bool enabled = true;
  double suspicious_overlap = 0.92;
  double min_overlap = 0.7;
  double margin = 0.08;
  double suspicious_frame_overlap = 0.85;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("enabled", enabled, "look for a stack that is built otherwise than the structure says");
    ar("suspicious_overlap", suspicious_overlap,
       "overlap of the structure as described with what the sensors see, below which other "
       "arrangements are tried",
       Between(0, 1));
    ar("min_overlap", min_overlap, "least overlap of another arrangement that is believed",
       Between(0, 1));
    ar("margin", margin, "by how much its overlap has to exceed that of the structure as described",
       Between(0, 1));
    ar("suspicious_frame_overlap", suspicious_frame_overlap,
       "overlap of the structure as described with what one sensor sees, below which its frame may "
       "be mirrored",
       Between(0, 1));
  }
};

/// A sensor whose view is asked. What it refers to must outlive the check.
struct AssemblySensor {
  const SensorView* view = nullptr;
  const SegmentationResult* segmentation = nullptr;
  const InitialPose* initial = nullptr;  ///< of the arrangement as described
};

struct AssemblyReport {
  Arrangement arrangement;       ///< code kNone: nothing speaks for another one
  double described_overlap = 0;  ///< of all sensors together (DepthOverlap::ratio)
  double overlap = 0;            ///< the same of `arrangement`
  /// Indices of sensors whose frames alone are mirrored: the others see the stack as described.
  std::vector<std::size_t> mirrored_frames;
  bool altered() const { return arrangement.code != SensorCode::kNone; }
};

/// Does another arrangement explain the sensors' views clearly better than the one described?
/// Others are tried only where the one described leaves something to explain. For each, every
/// sensor's pose is estimated again, and has to stand on a floor where there is one. At most
/// `max_sensors` are asked, those with the most labelled pixels. `threads` >= 1.
///
/// Before that, every sensor on its own is asked for a mirrored frame: where the mirror image of
/// the stack explains some views clearly better, others fit as described, and no single arrangement
/// explains all of them as well, those frames are mirrored and left out of the rest.
AssemblyReport InspectAssembly(const std::vector<AssemblySensor>& sensors,
                               const Structure& structure, const InitialPoseOptions& initial,
                               const AssemblyOptions& options, int threads,
                               std::size_t max_sensors = 8);

}  // namespace volalign
