#pragma once

// Observations of one sensor in the refinement, and their noise. Not for callers of Refine.

#include <Eigen/Core>
#include <vector>

#include "infer/lens/sensor_lens.h"
#include "infer/refine/noise_model.h"
#include "infer/refine/parameters.h"

namespace volalign::refine_internal {

/// One image block's points on one side, as one measurement. Sensor frame, m.
struct FaceObservation {
  Eigen::Vector3d p;  ///< mean of the points
  int label = 0;
  /// The depth error, m, that each of its sensor's errors causes at 1.
  SensorErrorVector by_errors = SensorErrorVector::Zero();
  double bulge = 0;              ///< see Side::BulgeAt
  double lateral_sigma_rad = 0;  ///< of p: mean over its points, which are off alike, see SidePoint
  double variance = 0;  ///< m^2, along the side's normal, of the mean of independent point errors
  RayByLensMatrix by_lens = RayByLensMatrix::Zero();  ///< of its ray, by its sensor's lens
};

/// Silhouette points of one image block along one edge of a side. Only their bearing counts.
struct EdgeObservation {
  Eigen::Vector3d p;
  int label = 0;
  int edge = 0;         ///< of the side, see Side::BorderAt
  int axis = 0;         ///< see EdgePoint
  double pixel = 0;     ///< m across the edge, in the side's plane, that one pixel covers
  double variance = 0;  ///< px^2, independent of the other observations'
  RayByLensMatrix by_lens = RayByLensMatrix::Zero();  ///< of its ray, by its sensor's lens
};

struct FrameObservations {
  std::vector<FaceObservation> faces;
  std::vector<EdgeObservation> edges;
  NoiseModel noise;
  LensChange lens = LensChange::Zero();  ///< with which the points were measured
  /// Lower Cholesky factors of the covariances of the residuals, faces and edges, in m.
  Eigen::MatrixXd face_root, edge_root;

  /// Keeps only the noise model.
  void Forget() {
    const NoiseModel known = noise;
    *this = FrameObservations();
    noise = known;
  }
};

}  // namespace volalign::refine_internal
