#include "infer/calib/joint_solution.h"

#include <algorithm>
#include <cstddef>
#include <map>
#include <utility>
#include <variant>

#include "core/base/parallel_for.h"
#include "core/geometry/pose.h"
#include "infer/checks/join.h"
#include "infer/checks/verdict.h"
#include "infer/checks/verification.h"
#include "infer/initial/geometry_search.h"
#include "infer/initial/pose_priors.h"
#include "infer/lens/find_lenses.h"

namespace volalign {

namespace {

/// Frames are labelled again while a sensor moves farther than this, m, so often at most.
constexpr int kLabelRounds = 6;
constexpr double kLabelsStay = 0.002;

/// Located frames, none of which contradicts the others about where the stack stood.
struct Located {
  PerFrame<LocateResult> results;
  std::vector<Pose> first_from_stack;
  SomeFrames<PlacedPrior> priors;
};

PerFrame<LocateResult> Without(PerFrame<LocateResult> results,
                               const SomeFrames<Finding>& excluded) {
  for (const auto& [id, finding] : excluded) results[id] = finding;
  return results;
}

Located Join(const Seen& seen, PerFrame<LocateResult> results) {
  Stood stood = JoinCaptures(seen, results);
  results = Without(std::move(results), stood.contradicted);
  SomeFrames<PlacedPrior> priors = PlacePriors(seen, results, stood.first_from_stack);
  return {std::move(results), std::move(stood.first_from_stack), std::move(priors)};
}

Located Locate(const StackFinding& stack, const LocateOptions& options, Seen* seen) {
  PerFrame<LocateResult> alone = LocateAlone(*seen, stack, options);
  return Join(*seen, LocateByPriors(std::move(alone), options, seen));
}

/// The located frames with the priors that count.
SomeFrames<FrameInput> WithPriors(SomeFrames<FrameInput> frames,
                                  const SomeFrames<PlacedPrior>& priors) {
  for (const auto& [id, placed] : priors) {
    if (placed.used) frames.at(id).prior = placed.prior;
  }
  return frames;
}

RefineResult RefineTogether(const Seen& seen, const SomeFrames<FrameInput>& frames,
                            const std::vector<Pose>& first_from_stack, const RefineSetup& setup) {
  std::vector<FrameInput> all;
  for (const auto& [id, frame] : frames) all.push_back(frame);
  return Refine(seen.input->structure, all, setup, seen.lenses.lenses, first_from_stack);
}

/// The poses for new labels. A frame that was not solved keeps its start.
SomeFrames<Pose> PosesForLabels(const SomeFrames<FrameInput>& frames, const RefineResult& refined) {
  SomeFrames<Pose> poses;
  auto found = refined.frames.begin();
  for (const auto& [id, frame] : frames) {
    if (found->solved) poses[id] = found->structure_from_sensor;
    ++found;
  }
  return poses;
}

/// Distances, m, of the poses from the frames' starts.
SomeFrames<double> MovesOf(const SomeFrames<FrameInput>& frames, const SomeFrames<Pose>& poses) {
  SomeFrames<double> moves;
  for (const auto& [id, pose] : poses)
    moves[id] = (pose.translation() - frames.at(id).start.translation()).norm();
  return moves;
}

double Largest(const SomeFrames<double>& moves) {
  double largest = 0;
  for (const auto& [id, move] : moves) largest = std::max(largest, move);
  return largest;
}

/// The frames with these starts, labelled by them.
SomeFrames<FrameInput> LabelledAt(const Seen& seen, SomeFrames<FrameInput> frames,
                                  const SomeFrames<Pose>& poses, const RefineResult& refined,
                                  const LocateOptions& options) {
  const std::vector<std::pair<FrameId, Pose>> all(poses.begin(), poses.end());
  ParallelFor(all.size(), options.threads, [&](std::size_t k) {
    const auto& [id, pose] = all[k];
    FrameInput& frame = frames.at(id);
    frame.start = pose;
    frame.points = PointsAt(seen, id, refined.placements[id.capture].built, pose, options);
  });
  return frames;
}

/// The lenses with the refined changes, and each sensor's own focal length.
LensSet WithChanges(const CaptureSet& input, LensSet lenses, const SomeFrames<FrameInput>& frames,
                    const RefineResult& refined) {
  for (std::size_t i = 0; i < lenses.lenses.size(); ++i)
    lenses.lenses[i].change = refined.lenses[i].change;
  std::map<std::size_t, double> of_sensor;
  auto found = refined.frames.begin();
  for (const auto& [id, frame] : frames) of_sensor[input.sensor_of[id]] = found++->own_focal;
  for (const FrameId id : lenses.of_frame.Ids()) {
    const auto own = of_sensor.find(input.sensor_of[id]);
    lenses.own_focal[id] = own == of_sensor.end() ? 0 : own->second;
  }
  return lenses;
}

/// `moves`: of the last round.
Joint MakeJoint(Seen seen, Located located, const SomeFrames<FrameInput>& frames,
                const SomeFrames<double>& moves, RefineResult refined, SolveReport report) {
  std::vector<FrameId> ids;
  for (const auto& [id, frame] : frames) ids.push_back(id);
  const auto id_of = [&](int k) { return ids[static_cast<std::size_t>(k)]; };
  Joint joint;
  joint.seen = std::move(seen);
  joint.located = std::move(located.results);
  joint.priors = std::move(located.priors);
  report.settled = report.converged;
  for (std::size_t k = 0; k < ids.size(); ++k) {
    FrameSolution& solution = joint.frames[ids[k]];
    solution.refined = std::move(refined.frames[k]);
    if (const auto move = moves.find(ids[k]); move != moves.end()) solution.moved_m = move->second;
    solution.settled = report.converged && StandsStill(solution.moved_m, solution.refined);
    report.settled = report.settled && solution.settled;
    if (!solution.refined.refused_fit) continue;
    for (const int other : solution.refined.refused_fit->contradicts)
      solution.contradicts.push_back(id_of(other));
  }
  const WorldPlacement world{refined.structure_from_world, refined.world_scale};
  for (auto& [id, placed] : joint.priors) {
    if (placed.prior.world != PriorWorld::kStructure)
      placed.prior.world_from_sensor = world.Place(placed.prior.world_from_sensor);
  }
  refined.frames.clear();
  joint.report = report;
  const CaptureSet& input = *joint.seen.input;
  std::vector<std::string> names;
  for (const FrameId id : ids) names.push_back(input[id].name);
  joint.findings = ExplainPriors(joint.seen, joint.located, located.first_from_stack);
  for (RigFinding& off : ExplainQuantities(refined, names, input.structure))
    joint.findings.push_back(std::move(off));
  for (RigFinding& apart : FindPairsApart(refined, names))
    joint.findings.push_back(std::move(apart));
  joint.pairs.resize(input.captures.size());
  for (const RefinedPair& pair : refined.pairs) {
    const Pose& pose = joint.frames[id_of(pair.b)].refined.structure_from_sensor;
    joint.pairs[id_of(pair.a).capture].push_back(
        {input[id_of(pair.a)].name, input[id_of(pair.b)].name, pair.overlap, pair.rms,
         pair.predicted_rms, pair.covariance, LargestSigmaPosition(pose, pair.covariance),
         LargestSigmaRotationDeg(pair.covariance)});
  }
  joint.refined = std::move(refined);
  return joint;
}

}  // namespace

SomeFrames<Finding> FindShapeless(const Seen& seen, const PerFrame<LocateResult>& located,
                                  const SomeFrames<FrameInput>& frames,
                                  const RefineResult& refined) {
  SomeFrames<Finding> shapeless;
  auto found = refined.frames.begin();
  for (const auto& [id, frame] : frames) {
    const Pose& pose = found++->structure_from_sensor;
    if (!std::get<LocatedFrame>(located[id]).shape_log_odds ||
        ShapeLogOdds(seen.views[id], refined.placements[id.capture].built, pose)) {
      continue;
    }
    shapeless[id] = ExplainMissingShape();
  }
  return shapeless;
}

bool StandsStill(double moved_m, const RefinedFrame& refined) {
  return moved_m < std::max(kLabelsStay, LargestSigmaPosition(refined.structure_from_sensor,
                                                              refined.covariance));
}

Joint SolveJointly(Seen seen, const StackFinding& stack, const CalibrateOptions& options,
                   const CalibrateProgress& progress, StageClock* clock) {
  const auto begin = [&](const char* stage) {
    if (progress) progress(stage);
  };
  const LocateOptions locate{options.refine, options.verdict, options.threads};
  begin("each sensor by itself");
  seen.clouds = MapFrames(seen.views, options.threads,
                          [&](FrameId id) { return SampleCloud(seen.views[id]); });
  Located located = Locate(stack, locate, &seen);
  clock->Lap("placement");
  begin("all sensors together");
  SolveReport report;
  int labelled = 0;
  SomeFrames<FrameInput> frames = WithPriors(FramesToRefine(seen, located.results), located.priors);
  RefineSetup setup(options.refine);
  for (;;) {
    const auto labels_stay = [&](const RefineResult& refined) {
      return Largest(MovesOf(frames, PosesForLabels(frames, refined))) < kLabelsStay ||
             labelled == kLabelRounds;
    };
    setup.is_final = labels_stay;
    RefineResult refined = RefineTogether(seen, frames, located.first_from_stack, setup);
    ++report.rounds;
    const SomeFrames<Pose> poses = PosesForLabels(frames, refined);
    const SomeFrames<double> moves = MovesOf(frames, poses);
    report.moved_m = Largest(moves);
    if (!labels_stay(refined)) {  // label
      ++labelled;
      frames = LabelledAt(seen, std::move(frames), poses, refined, locate);
      // Points are associated anew in each round.
      setup.associations = poses.size() == frames.size() ? 1 : options.refine.associations;
      continue;
    }
    const SomeFrames<Finding> shapeless = FindShapeless(seen, located.results, frames, refined);
    if (shapeless.empty()) {
      clock->Lap("refinement");
      LensSet lenses = WithChanges(*seen.input, seen.lenses, frames, refined);
      report.converged = refined.converged;
      report.moved_px = LargestShift(seen.lenses, lenses);
      seen.views =
          LookThrough(*seen.input, lenses, std::move(seen.views), seen.lenses, options.threads);
      seen.lenses = std::move(lenses);
      return MakeJoint(std::move(seen), std::move(located), frames, moves, std::move(refined),
                       report);
    }
    located = Join(seen, Without(std::move(located.results), shapeless));
    frames = WithPriors(FramesToRefine(seen, located.results), located.priors);
    setup = RefineSetup(options.refine);
    labelled = 0;
  }
}

}  // namespace volalign
