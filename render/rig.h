#pragma once

#include <string>
#include <vector>

#include "core/camera.h"
#include "core/image.h"
#include "core/pose.h"
#include "core/rig.h"
#include "core/structure.h"

namespace volalign {

class DepthRenderer;

/// What one sensor of a rig measures. All images have the intrinsics' size.
struct CapturedSensor {
  std::string name;
  std::string sensor;            ///< pool name
  Intrinsics intrinsics;         ///< true: the frame is drawn with them
  Intrinsics stated_intrinsics;  ///< what the capture says (Rig::state_lens, lens_spread_percent)
  Pose structure_from_sensor = Pose::Identity();  ///< ground truth, nominal structure
  DepthImage depth;                               ///< m, with noise; 0 for no measurement
  LabelImage labels;                              ///< 0 where noise took the depth away
  DepthImage depth_clean;
  LabelImage labels_clean;
};

struct RigCapture {
  Structure structure;  ///< nominal
  bool structure_present = true;
  std::vector<Pose> box_offsets;  ///< of the boxes as they were built (Structure::Displaced)
  double size_scale = 1;
  std::vector<CapturedSensor> sensors;
};

/// All sensors see the same room and the same structure; each has noise of its own. A pure function
/// of the rig. Throws ConfigError (a sensor that the pool lacks, an image size of another aspect
/// ratio), IoError or DataError.
RigCapture RenderRig(const Rig& rig, DepthRenderer& renderer);

}  // namespace volalign
