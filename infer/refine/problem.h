#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/refine/options.h"
#include "infer/refine/overlap.h"
#include "infer/refine/parameters.h"
#include "infer/refine/sensor_points.h"
#include "infer/view/pose_prior.h"

namespace volalign {

/// A frame to refine: one sensor in one capture. All poses are structure_from_sensor, in the
/// structure where it stands in that capture.
struct FrameInput {
  std::shared_ptr<const SensorPoints> points;
  Pose start = Pose::Identity();  ///< where the solution begins
  std::size_t lens = 0;           ///< index into the lenses
  /// Index of the sensor among those of all captures; -1: one of its own.
  int sensor = -1;
  std::size_t capture = 0;  ///< index into the placements
  /// A prior of the pose first_from_sensor. Its world is brought near the structure frame of the
  /// first capture; what PosePrior::world leaves open is estimated.
  std::optional<PosePrior> prior = {};
};

namespace refine_internal {

/// Standard deviations of a lens that a capture determines.
inline const Eigen::Vector3d kFoundLens(0.003, 0.006, 0.01);

/// Everything that is given and constant while the parameters are sought. Refers to its arguments.
struct JointProblem {
  JointProblem(const Structure& structure, const std::vector<FrameInput>& frames,
               const RefineSetup& setup, const std::vector<SensorLens>& lenses = {SensorLens()},
               std::size_t captures = 1);

  const Structure& structure;  ///< as described
  const std::vector<FrameInput>& frames;
  RefineSetup setup;
  BuildModel model;
  Priors priors;  ///< without those of a lens
  std::vector<SensorLens> lenses;
  std::vector<FrameOf> frame_of;  ///< of each of `frames`
  ParameterLayout layout;
  std::vector<std::vector<int>> overlap_points;  ///< of each frame, see ChooseOverlapPoints

  std::size_t size() const { return frames.size(); }
  /// Priors for an estimate from one sensor's points alone. The lens has the standard deviations
  /// that remain after all evidence, not those of an unknown lens.
  Priors PriorsOf(std::size_t i) const {
    Priors own = priors;
    const SensorLens& lens = lenses[frame_of[i].lens];
    own.lens = lens.prior_sigmas.cwiseMin(kFoundLens);
    own.focal = lens.own_focal_sigma;
    return own;
  }
  /// A frame's kind of device, see SensorFrame::sensor; empty: unknown.
  const std::string& KindOf(std::size_t i) const { return lenses[frame_of[i].lens].sensor; }
  /// Does the overlap of two frames count? They have to be of one capture. No earlier capture may
  /// have both sensors: it measured the surroundings already, with the same errors.
  bool OverlapCounts(std::size_t a, std::size_t b) const;
  /// A frame as one end of an overlap.
  OverlapEnd Overlap(std::size_t i, const State& state) const {
    return {frames[i].points.get(), &overlap_points[i], state.Frame(i)};
  }
};

}  // namespace refine_internal
}  // namespace volalign
