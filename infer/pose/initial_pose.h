#pragma once

#include <string>
#include <vector>

#include "core/config.h"
#include "core/pose.h"
#include "core/structure.h"
#include "infer/pose/agreement.h"
#include "infer/pose/side_evidence.h"

namespace volalign {

struct InitialPoseOptions {
  std::string method = "robust";
  std::string keypoints = "exposed";
  int visibility_iterations = 5;
  int side_fit_steps = 5;
  double max_keypoint_error_m = 0.2;
  double max_normal_error_deg = 30;
  EvidenceOptions evidence;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("method", method,
       "robust (hypothesise and verify, see infer/pose/initial_pose.h), or paper: the mean of each "
       "side's "
       "confident pixels against its centre, Procrustes over all visible sides; it uses evidence's "
       "min_confidence and min_pixels only",
       OneOf({"robust", "paper"}));
    ar("keypoints", keypoints,
       "point that stands for a side before its visible part is known: exposed (centroid of the "
       "area that no "
       "other box covers) or centre (the paper)",
       OneOf({"exposed", "centre"}));
    ar("visibility_iterations", visibility_iterations,
       "times that keypoints are replaced by centroids of what the structure shows from the "
       "estimated pose",
       AtLeast(0));
    ar("side_fit_steps", side_fit_steps,
       "robust steps, at the end, that bring labelled points onto their finite sides", AtLeast(0));
    ar("max_keypoint_error_m", max_keypoint_error_m,
       "distance between a side's keypoint and its measured one beyond which they contradict each "
       "other, m",
       Above(0));
    ar("max_normal_error_deg", max_normal_error_deg,
       "angle between a side's normal and its fitted one beyond which they contradict each other, "
       "deg",
       Between(1, 90));
    ar("evidence", evidence, "collection of each side's pixels");
  }
};

/// What one sensor's labels say about its pose.
struct InitialPose {
  bool found = false;  ///< a pose was hypothesised; whether it is right is CompareWithView's to say
  Pose structure_from_sensor = Pose::Identity();
  /// The same before the points were brought onto their sides: no depth but those of centroids and
  /// normals is fitted.
  Pose from_keypoints = Pose::Identity();
  Agreement agreement;                 ///< at the pose, on the decimated view, tolerance 5 cm
  std::vector<SideEvidence> evidence;  ///< all patches that were found
  std::vector<int> consistent;         ///< indices of the patches that the pose agrees with
};

/// By `options.method`:
///
/// robust: hypothesise and verify. A pose is made from every pair and triple of patches, from all
/// of them and from all but one, by Procrustes over area-weighted keypoints and, as a second point
/// of each side, its fitted normal (four parallel sides fix no rotation with keypoints alone); the
/// patches that agree with it vote for it, and the best hypotheses compete by how well their view
/// of the structure agrees with measured depths and labels (not by a number of pixels). Keypoints
/// are corrected for visibility: the centroid of a half hidden side is compared with that of the
/// part that the estimated pose shows. With `near`, that pose competes too, and only what comes out
/// within 20 cm and 15 deg of it.
InitialPose EstimateInitialPose(const SensorView& view, const SegmentationResult& segmentation,
                                const Structure& structure, const InitialPoseOptions& options,
                                const Pose* near = nullptr);

/// Do these sides fix six degrees of freedom? By their keypoints (second singular value of the
/// centred set over 5 cm, design section 2) or, where those fail, by their planes: the
/// point-to-plane normal equations have rank 6, every eigenvalue above 0.3 % of the trace with
/// rotations in units of 0.25 m.
bool SidesFixPose(const Structure& structure, const std::vector<int>& labels, KeypointKind kind);

}  // namespace volalign
