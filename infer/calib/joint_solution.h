#pragma once

#include <vector>

#include "core/base/stage_clock.h"
#include "infer/calib/calibrate.h"
#include "infer/calib/result.h"
#include "infer/checks/placement.h"
#include "infer/refine/refine.h"
#include "infer/view/frames.h"

namespace volalign {

/// A frame in the joint solution.
struct FrameSolution {
  RefinedFrame refined;
  std::vector<FrameId> contradicts;  ///< RefusedFit::contradicts
  double moved_m = 0;                ///< how far the last round moved it
  /// It moved it by less than its position is known to, or nowhere to speak of, and the solution
  /// ended by its tolerances, through lenses in which it is linear.
  bool settled = false;
};

/// The poses of all located frames together, and what they were found from.
struct Joint {
  Seen seen;                         ///< through the lenses that were found
  PerFrame<LocateResult> located;    ///< from where the solution began; or why there is none
  SomeFrames<FrameSolution> frames;  ///< of the located ones
  std::vector<std::vector<PairResult>> pairs;  ///< of each still
  std::vector<RefinedPlacement> stacks;        ///< of each still
  std::vector<RefinedLens> lenses;             ///< of seen.lenses
  bool size_estimated = false;
  double size_scale = 1, sigma_size_scale = 0;
  std::vector<RigFinding> findings;
  SolveReport report;
};

/// Solves for all sensors together, in rounds of these steps until nothing changes any more:
///
/// - locate: each frame by itself, by its neighbours, and where the stack stood in each still;
/// - refine: see Refine;
/// - label: the stack as it is found, seen from the poses that are found, labels the points anew.
///   So what the first labels came from, a network or geometry, makes little difference. A
///   frame that turns back begins the next one half way (NextStarts);
/// - set aside: a frame that geometry alone has located, and that the solution takes to where its
///   view does not have the structure's shape (ShapeLogOdds), is located no longer
///   (no_structure), and the others are solved again from where they were located;
/// - look: through lenses that have changed by so much that the solution is not linear in them.
///
/// Each step has a limit; Joint::report says whether one was reached.
Joint SolveJointly(Seen seen, const StackFinding& stack, Segmenter* segmenter,
                   const CalibrateOptions& options, const CalibrateProgress& progress,
                   StageClock* clock);

/// How far, m, frames have moved in a round.
using Moves = SomeFrames<Eigen::Vector3d>;

/// Where the frames begin in the next round: at the poses that this one has found, but half way to
/// them where a frame goes back on its move `before`. A frame whose labels call for one of two
/// places at the other one would go to and fro. `moves`: from the frames' starts to `poses`.
SomeFrames<Pose> NextStarts(const SomeFrames<FrameInput>& frames, SomeFrames<Pose> poses,
                            const Moves& moves, const Moves& before);

/// Has a round moved a frame by less than its position is known to, or nowhere to speak of?
bool StandsStill(double moved_m, const RefinedFrame& refined);

/// The frames that geometry alone has located and that stand where their views do not have the
/// structure's shape. `refined`: of `frames`, which are the located ones.
SomeFrames<Finding> FindShapeless(const Seen& seen, const PerFrame<LocateResult>& located,
                                  const SomeFrames<FrameInput>& frames,
                                  const RefineResult& refined);

}  // namespace volalign
