#pragma once

#include <vector>

#include "core/config/config.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/initial/side_patch.h"
#include "infer/view/segmentation.h"
#include "infer/view/sensor_view.h"

namespace volalign {

/// Sources of initial poses that a person chooses from.
enum class PoseMethod { kAuto, kNetwork, kGeometry };
constexpr Words<PoseMethod, 3> WordsOf(PoseMethod) {
  return {{{"auto", PoseMethod::kAuto},
           {"network", PoseMethod::kNetwork},
           {"geometry", PoseMethod::kGeometry}}};
}

/// Source of an initial pose: the network's labels, the structure's geometry, or a prior. The other
/// sensors were one in older calibrations.
enum class PoseSource { kNetwork, kGeometry, kNeighbours, kPrior };
constexpr Words<PoseSource, 4> WordsOf(PoseSource) {
  return {{{"network", PoseSource::kNetwork},
           {"geometry", PoseSource::kGeometry},
           {"neighbours", PoseSource::kNeighbours},
           {"prior", PoseSource::kPrior}}};
}

struct InitialPoseOptions {
  PoseMethod method = PoseMethod::kAuto;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("method", method,
       "source of initial poses. Network: its labels. Geometry: the structure's shape, without a "
       "model. Auto: both if there is a model, and one verification chooses",
       Removed("table_height_m", "what the stack stands on is found by itself; leave the key out",
               std::vector<std::string>{"0"}),
       Removed("keypoints",
               "a side's point is the centroid of the area that no other box covers; "
               "leave the key out",
               std::vector<std::string>{"exposed"}),
       Fixed("max_keypoint_error_m", 0.2), Fixed("max_normal_error_deg", 30),
       Fixed("patch.min_confidence", kLeastConfidence),
       Fixed("patch.min_pixels", kFewestSidePixels));
  }
};

/// The pose of one sensor by its labels alone.
struct InitialPose {
  bool found = false;  ///< there is a pose, right or wrong
  /// Fitted to the sides' centroids and normals, not to single depths.
  Pose structure_from_sensor = Pose::Identity();
  std::vector<SidePatch> patches;  ///< all that were found
};

/// A frame's labels, in full size and its own orientation, and the pose that follows from them.
struct LabelledPose {
  SegmentationResult segmentation;
  InitialPose initial;
};

/// Finds the pose of one sensor from its labels: it hypothesises and verifies. Candidates are made
/// from sets of patches and corrected for visibility (pose_candidates.h). The candidate with the
/// largest Agreement::score is taken. With `near`, that pose is the only candidate.
InitialPose EstimateInitialPose(const SensorView& view, const SegmentationResult& segmentation,
                                const Structure& structure, const Pose* near = nullptr);

}  // namespace volalign
