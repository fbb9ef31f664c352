#pragma once

// A sensor's observations against the structure as built. Not for callers of Refine.

#include <ceres/cost_function.h>

#include <Eigen/Core>
#include <vector>

#include "infer/refine/build_model.h"
#include "infer/refine/frame_observations.h"
#include "infer/refine/parameters.h"

namespace volalign::refine_internal {

/// Signed distances, m: faces (to the infinite plane of the side as built), then edges (bearing
/// against the edge, in the side's plane). True depth = measured + offset + the errors of the
/// sensor. A side stands out by its bulge. Distances are as the sensor measures them: a face's is
/// the true one divided by the gain, an edge's is its bearing's at the measured depth. With true
/// lengths, the smallest world would fit best. `jacobian`, if wanted, has FrameColumns.
void Residuals(const BuildModel& model, const FrameObservations& observed,
               const FrameParameters& parameters, Eigen::VectorXd* residuals,
               Eigen::MatrixXd* jacobian);

/// The residuals in standard deviations, whitened by their joint covariance. `jacobian`, if wanted,
/// has only the columns in `wanted`.
void WhitenedResiduals(const BuildModel& model, const FrameObservations& observed,
                       const FrameParameters& parameters, const std::vector<Eigen::Index>& wanted,
                       Eigen::VectorXd* residuals, Eigen::MatrixXd* jacobian);

/// WhitenedResiduals as a cost. Refers to both arguments.
class SensorCost : public ceres::CostFunction {
 public:
  SensorCost(const BuildModel& model, const FrameObservations& observed);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const BuildModel& model_;
  const FrameObservations& observed_;
};

}  // namespace volalign::refine_internal
