#pragma once

#include <string>
#include <vector>

#include "core/base/image.h"
#include "core/base/progress_line.h"
#include "core/geometry/camera.h"
#include "core/geometry/pose.h"
#include "core/geometry/rig.h"
#include "core/geometry/structure.h"
#include "render/infrared.h"

namespace volalign {

class DepthRenderer;

/// What one sensor of a rig measures. All images have the intrinsics' size.
struct CapturedSensor {
  std::string name;
  std::string sensor;            ///< pool name
  Intrinsics intrinsics;         ///< true: the frame is drawn with them
  Intrinsics stated_intrinsics;  ///< what the capture says (Rig::state_lens, lens_spread_percent)
  Pose structure_from_sensor = Pose::Identity();  ///< ground truth, nominal structure of the still
  DepthImage depth;                               ///< m, with noise; 0 for no measurement
  LabelImage labels;                              ///< 0 where noise took the depth away
  DepthImage depth_clean;
  LabelImage labels_clean;
  GreyImage infrared;  ///< empty unless asked for
  /// Of the infrared picture: the sensor's, at the pool's largest size of the same aspect ratio.
  Intrinsics infrared_intrinsics;
};

/// Infrared pictures to take beside the depth maps.
struct InfraredRequest {
  std::vector<MarkerPrint> prints;
  InfraredConfig config;
};

/// One still of a rig.
struct RigCapture {
  Structure structure;  ///< nominal
  bool structure_present = true;
  /// Where the nominal structure's frame stands in that of the first placement.
  Pose first_from_placement = Pose::Identity();
  std::vector<Pose> box_offsets;  ///< of the boxes as they were built (Structure::Displaced)
  double size_scale = 1;
  std::vector<CapturedSensor> sensors;
};

/// One still of the first placement, and one of each further: the same sensors, with the errors of
/// their devices (Rig::device_errors), and the same room; pixel noise, gaps and holes are drawn
/// anew. All sensors see the same structure; each has noise of its own. `infrared`, where given,
/// asks for infrared pictures too, and changes nothing else. `count` is told of frames. A pure
/// function of the rig. Throws
/// Error for a rig with turns_deg (core/geometry/rig.h, Turns), ConfigError (a sensor that
/// the pool lacks, an image size of another aspect ratio, a placement in a tripod), IoError or
/// DataError.
std::vector<RigCapture> RenderPlacements(const Rig& rig, DepthRenderer& renderer,
                                         const InfraredRequest* infrared = nullptr,
                                         const CountDone& count = nullptr);

/// `count` further placements for a rig, from its seed: uniform in a disc about the first, in any
/// orientation, none in a sensor's tripod. The first ones do not depend on `count`. Throws
/// ConfigError where there is no such place, and what reading the structure throws.
std::vector<RigPlacement> DrawPlacements(const Rig& rig, int count, double radius_m);

}  // namespace volalign
