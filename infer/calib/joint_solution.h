#pragma once

#include <vector>

#include "core/base/stage_clock.h"
#include "infer/calib/calibrate.h"
#include "infer/calib/result.h"
#include "infer/checks/placement.h"
#include "infer/checks/prior_use.h"
#include "infer/refine/refine.h"
#include "infer/view/frames.h"

namespace volalign {

/// A frame in the joint solution.
struct FrameSolution {
  RefinedFrame refined;
  std::vector<FrameId> contradicts;  ///< RefusedFit::contradicts
  double moved_m = 0;                ///< m, by the last round
  /// StandsStill, and the solution ended by its tolerances.
  bool settled = false;
};

/// The joint poses of all located frames, and the stages before them.
struct Joint {
  Seen seen;                                   ///< through the final lenses
  PerFrame<LocateResult> located;              ///< start of the solution, or why there is none
  SomeFrames<FrameSolution> frames;            ///< of the located ones
  std::vector<std::vector<PairResult>> pairs;  ///< for each capture
  RefineResult refined;                        ///< without its frames
  SomeFrames<PlacedPrior> priors;              ///< of located frames
  std::vector<RigFinding> findings;
  SolveReport report;
};

/// Solves for all sensors together, in rounds of these steps, until nothing changes any more.
/// Locate, once: each frame by itself, then with its prior, then where the stack stood in each
/// capture. Refine: see Refine; it is linear in the lenses, about those that
/// planes gave. Label: the stack and poses that were found label the points anew. The origin of the
/// first labels, a network or geometry, then makes little difference. Drop: a frame that geometry
/// alone has located may move to where its view does not have the structure's shape (ShapeLogOdds).
/// It is then no longer located (no_structure), and the others are solved again from their first
/// poses. Joint::report says whether the limit of rounds was reached.
Joint SolveJointly(Seen seen, const StackFinding& stack, const CalibrateOptions& options,
                   const CalibrateProgress& progress, StageClock* clock);

/// Has a round moved a frame by less than its largest standard deviation of position, or less than
/// 2 mm?
bool StandsStill(double moved_m, const RefinedFrame& refined);

/// The frames that geometry alone has located and whose views do not have the structure's shape at
/// their refined poses. `refined`: the result of `frames`, the located ones.
SomeFrames<Finding> FindShapeless(const Seen& seen, const PerFrame<LocateResult>& located,
                                  const SomeFrames<FrameInput>& frames,
                                  const RefineResult& refined);

}  // namespace volalign
