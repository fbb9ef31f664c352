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

/// The measurements of one sensor of a rig. All images have the intrinsics' size.
struct CapturedSensor {
  std::string name;
  std::string sensor;            ///< pool name
  Intrinsics intrinsics;         ///< true: the frame is drawn with them
  Intrinsics stated_intrinsics;  ///< of the capture (Rig::state_lens, lens_spread_percent)
  Pose structure_from_sensor = Pose::Identity();  ///< ground truth, nominal structure
  DepthImage depth;                               ///< m, with noise; 0 for no measurement
  LabelImage labels;                              ///< 0 where noise removed the depth
  DepthImage depth_clean;
  LabelImage labels_clean;
  GreyImage infrared;  ///< empty unless asked for
  /// The sensor's intrinsics at the pool's largest size with the same aspect ratio, for the
  /// infrared picture.
  Intrinsics infrared_intrinsics;
};

/// One capture of a rig.
struct RigCapture {
  Structure structure;  ///< nominal
  bool structure_present = true;
  /// Pose of the nominal structure's frame in that of the first placement.
  Pose first_from_placement = Pose::Identity();
  std::vector<Pose> box_offsets;  ///< of the boxes as built (Structure::Displaced)
  double size_scale = 1;
  std::vector<CapturedSensor> sensors;
};

/// One capture of the first placement, and one of each further placement: the same sensors, with
/// their device errors (Rig::device_errors), and the same room. Pixel noise, gaps and holes are
/// drawn again. All sensors see the same structure; each has its own noise. `prints`, if given,
/// adds infrared pictures with these prints and changes nothing else. `count` receives the progress
/// in frames. A pure function of the rig. Throws Error for a rig with turns_deg
/// (core/geometry/rig.h, Turns). Throws ConfigError for a sensor that the pool lacks, an image size
/// of another aspect ratio, or a placement in a tripod. Throws IoError or DataError.
std::vector<RigCapture> RenderPlacements(const Rig& rig, DepthRenderer& renderer,
                                         const std::vector<MarkerPrint>* prints = nullptr,
                                         const CountDone& count = nullptr);

/// Draws `count` further placements for a rig, from its seed: uniform in a disc about the first, in
/// any orientation, none in a sensor's tripod. The first ones do not depend on `count`. Throws
/// ConfigError if there is no such place. Throws as reading the structure does.
std::vector<RigPlacement> DrawPlacements(const Rig& rig, int count, double radius_m);

}  // namespace volalign
