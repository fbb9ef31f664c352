#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "infer/refine/noise_model.h"
#include "infer/refine/options.h"
#include "infer/refine/overlap.h"
#include "infer/refine/parameters.h"
#include "infer/refine/sensor_points.h"

namespace volalign {

/// A frame to refine: one sensor in one still. All poses are structure_from_sensor, in the
/// structure where it stands in that still.
struct FrameInput {
  std::shared_ptr<const SensorPoints> points;
  Pose start = Pose::Identity();  ///< where the solution begins
  /// Index into the lenses; -1: its lens is known.
  int lens = -1;
  /// Index of the sensor among those of all stills; -1: one of its own.
  int sensor = -1;
  int still = 0;  ///< index into the placements
  /// What an earlier refinement has fitted to its errors (RefinedFrame::noise), to be kept;
  /// nothing: they are fitted.
  std::optional<refine_internal::NoiseModel> noise = {};
  /// Whether an earlier refinement has set it aside (RefinedFrame::refused_fit), to be kept;
  /// nothing: it is asked whether it disagrees.
  std::optional<bool> aside = {};
};

namespace refine_internal {

/// Standard deviations of a lens that a capture tells.
inline const Eigen::Vector3d kFoundLens(0.003, 0.006, 0.01);

/// What is given and stays as it is while the parameters are sought. Refers to its arguments.
struct JointProblem {
  JointProblem(const Structure& structure, const std::vector<FrameInput>& frames,
               const RefineSetup& setup, const std::vector<SensorLens>& lenses = {},
               std::size_t stills = 1);

  const Structure& structure;  ///< as described
  const std::vector<FrameInput>& frames;
  RefineSetup setup;
  BuildModel model;
  Priors priors;  ///< without a lens's
  /// Those given, then one for all sensors whose lens is known, where there are any.
  std::vector<SensorLens> lenses;
  std::vector<FrameOf> frame_of;  ///< what each of `frames` is of
  ParameterLayout layout;
  std::vector<std::vector<int>> overlap_points;  ///< of each frame, see ChooseOverlapPoints

  std::size_t size() const { return frames.size(); }
  /// For what a sensor's points alone are to tell: with the standard deviations of its lens about
  /// where all evidence together has it, which are not those of a lens of which nothing is known.
  Priors PriorsOf(std::size_t i) const {
    Priors own = priors;
    const auto lens = static_cast<std::size_t>(frame_of[i].lens);
    own.lens = lenses[lens].prior_sigmas.cwiseMin(kFoundLens);
    own.focal = lenses[lens].own_focal_sigma;
    return own;
  }
  /// The kind of device that a frame is of, see SensorFrame::sensor; empty: not known.
  const std::string& KindOf(std::size_t i) const {
    return lenses[static_cast<std::size_t>(frame_of[i].lens)].sensor;
  }
  /// Does the overlap of two frames count? They have to be of one still, and no earlier one may
  /// have both sensors: what stands about the structure would be measured again with the same
  /// errors.
  bool OverlapCounts(std::size_t a, std::size_t b) const;
  /// One frame's part in its overlap with others.
  OverlapEnd Overlap(std::size_t i, const State& state) const {
    return {frames[i].points.get(), &overlap_points[i], state.Frame(i)};
  }
};

}  // namespace refine_internal
}  // namespace volalign
