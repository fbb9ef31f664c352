#include "infer/checks/placement.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <string>
#include <utility>

#include "core/base/parallel_for.h"
#include "infer/checks/hints.h"
#include "infer/checks/prior_use.h"
#include "infer/checks/verification.h"
#include "infer/initial/agreement.h"
#include "infer/initial/geometry_search.h"
#include "infer/initial/pose_hypotheses.h"
#include "infer/initial/pose_priors.h"

namespace volalign {

namespace {

/// The sensor's pose from its own view, and its prior if one is given, with all quantities free
/// that may be estimated.
RefinedFrame RefineAlone(const Seen& seen, FrameId id, std::shared_ptr<const SensorPoints> points,
                         const Pose& start, const std::optional<PosePrior>& prior,
                         const RefineOptions& options) {
  RefineSetup alone(options);
  alone.free.scale_priors = false;
  alone.threads = 1;
  FrameInput input{std::move(points), start, 0};
  input.prior = prior;
  return Refine(seen.input->structure, {input}, alone, {seen.lenses.Of(id)}).frames.front();
}

Finding ExplainAlteredStack(const AssemblyReport& report) {
  std::string hint =
      "stack the boxes as the structure file says, or describe them as they stand (--structure)";
  if (report.arrangement.code == SensorCode::kAssemblyMirrored) {
    hint = "if only the stack is mirrored, " + hint +
           ". If everything in the pictures is mirrored, switch that off in the capture program, "
           "or flip the stored pictures";
  }
  if (report.arrangement.code == SensorCode::kAssemblyHeight)
    hint += ". A box may be missing in that file, or have another height there";
  return {
      report.arrangement.code,
      fmt::format(
          "{}: this explains {:.0f} % of what the sensors see, and the stack as described {:.0f} %",
          report.arrangement.sentence, 100 * report.share, 100 * report.described_share),
      std::move(hint)};
}

Finding MirroredFrame() {
  return {SensorCode::kFrameMirrored,
          "the frame is mirrored: it shows the structure as in a mirror, and the other sensors see "
          "it as described",
          "switch the mirroring of this sensor's pictures off in the capture program, or flip the "
          "stored picture"};
}

bool Contains(const std::vector<std::size_t>& frames, std::size_t frame) {
  return std::find(frames.begin(), frames.end(), frame) != frames.end();
}

/// Points of a frame for the refinement, with these labels.
std::shared_ptr<const SensorPoints> PointsOf(const Seen& seen, FrameId id,
                                             const SegmentationResult& segmentation,
                                             const LocateOptions& options) {
  SensorPoints points =
      SamplePoints(seen.views[id], segmentation, seen.input->structure, options.refine);
  points.cloud = seen.clouds[id];
  points.intrinsics = seen.lenses.Effective(id);
  points.lens = seen.lenses.ChangeOf(id);
  return std::make_shared<const SensorPoints>(std::move(points));
}

/// The own pose, refined first with the frame's labels and then with those that it implies. The
/// first labels do not end exactly at the sides' borders.
RefinedFrame RefineTwice(const Seen& seen, FrameId id, const Labelled& labelled,
                         const std::optional<PosePrior>& prior, const LocateOptions& options) {
  const Pose pose = RefineAlone(seen, id, PointsOf(seen, id, labelled.segmentation, options),
                                labelled.initial.structure_from_sensor, prior, options.refine)
                        .structure_from_sensor;
  return RefineAlone(seen, id, PointsAt(seen, id, seen.input->structure, pose, options), pose,
                     prior, options.refine);
}

/// See LocateAlone.
LocateResult LocateByItself(const Seen& seen, FrameId id, const LocateOptions& options) {
  const Structure& structure = seen.input->structure;
  const SensorView& view = seen.views[id];
  const Labelled& labelled = seen.labelled[id];
  const InitialPose& initial = labelled.initial;
  if (!initial.found && labelled.source == PoseSource::kGeometry) return ExplainMissingShape();
  if (!initial.found) return ExplainMissingPose(initial);

  const RefinedFrame own = RefineTwice(seen, id, labelled, {}, options);
  const Pose& pose = own.structure_from_sensor;
  const LocateFacts facts{
      ExplainView(view, labelled.ByNetwork(), structure, pose, options.refine.box_sigma_m),
      ConfirmedLabels(view, initial.patches, structure, pose),
      LargestSigmaPosition(pose, own.covariance), &initial};
  if (std::optional<Finding> failure = VerifyOwnPose(facts, structure, options.verdict)) {
    return *std::move(failure);
  }
  LocatedFrame located;
  if (labelled.source == PoseSource::kGeometry) {
    located.shape_log_odds = ShapeLogOdds(view, structure, pose);
    if (!located.shape_log_odds) return ExplainMissingShape();
  }

  located.own_pose = pose;
  located.covariance = own.covariance;
  located.points = PointsAt(seen, id, structure, pose, options);
  return located;
}

/// Can a prior place a frame with this finding?
bool IsOpen(const Finding& finding) {
  return finding.code == SensorCode::kDegenerateSides || finding.code == SensorCode::kNoStructure ||
         finding.code == SensorCode::kInconsistent;
}

/// The frame at the pose that its prior has, with the labels that follow; nothing if its view does
/// not show the structure there. `prior`: in the structure frame of the capture.
std::optional<std::pair<LocatedFrame, Labelled>> LocateByPrior(const Seen& seen, FrameId id,
                                                               const PosePrior& prior,
                                                               const LocateOptions& options) {
  const Structure& structure = seen.input->structure;
  const SensorView& view = seen.views[id];
  Labelled labelled;
  static_cast<LabelledPose&>(labelled) = LabelByPose(view, structure, prior.world_from_sensor);
  labelled.quarter_turns = seen.labelled[id].quarter_turns;
  labelled.source = PoseSource::kPrior;
  if (!labelled.initial.found) labelled.initial.structure_from_sensor = prior.world_from_sensor;
  labelled.initial.found = true;
  const RefinedFrame own = RefineTwice(seen, id, labelled, prior, options);
  const Pose& pose = own.structure_from_sensor;
  if (!ShapeLogOdds(view, structure, pose) ||
      !(LargestSigmaPosition(pose, own.covariance) <= options.verdict.max_sigma_position_m)) {
    return std::nullopt;
  }
  LocatedFrame located;
  located.own_pose = pose;
  located.points = PointsAt(seen, id, structure, pose, options);
  return std::make_pair(std::move(located), std::move(labelled));
}

}  // namespace

std::shared_ptr<const SensorPoints> PointsAt(const Seen& seen, FrameId id,
                                             const Structure& structure, const Pose& pose,
                                             const LocateOptions& options) {
  return PointsOf(seen, id,
                  LabelsFromPose(seen.views[id], structure, pose,
                                 SurfaceTolerance::AtPose(seen.views[id].errors)),
                  options);
}

PerFrame<LocateResult> LocateAlone(const Seen& seen, const StackFinding& stack,
                                   const LocateOptions& options) {
  return MapFrames(seen.views, options.threads, [&](FrameId id) -> LocateResult {
    if (const std::optional<Finding>& failure = seen.depths[id].failure) return *failure;
    const std::optional<AssemblyReport>& assembly = stack[id.capture];
    if (assembly && Contains(assembly->mirrored_frames, id.frame)) return MirroredFrame();
    const bool altered = assembly && assembly->altered();
    if (altered && Contains(assembly->seen_by, id.frame)) return ExplainAlteredStack(*assembly);
    LocateResult result = LocateByItself(seen, id, options);
    if (altered && std::holds_alternative<LocatedFrame>(result))
      return ExplainAlteredStack(*assembly);
    auto* failure = std::get_if<Finding>(&result);
    if (failure && failure->code == SensorCode::kDegenerateSides)
      failure->hint = MoveHint(seen.labelled[id].segmentation.labels);
    return result;
  });
}

PerFrame<LocateResult> LocateByPriors(PerFrame<LocateResult> results, const LocateOptions& options,
                                      Seen* seen) {
  for (std::size_t capture = 0; capture < results.captures(); ++capture) {
    const std::vector<std::optional<PosePrior>> priors = PriorsOfCapture(*seen->input, capture);
    std::vector<const PosePrior*> given;
    std::vector<std::vector<Pose>> poses;
    for (std::size_t i = 0; i < priors.size(); ++i) {
      const auto* located = std::get_if<LocatedFrame>(&results[{capture, i}]);
      given.push_back(priors[i] ? &*priors[i] : nullptr);
      poses.push_back(located ? std::vector<Pose>{located->own_pose} : std::vector<Pose>{});
    }
    std::vector<WorldPlacement> worlds = FindWorlds(given, poses);
    if (worlds.empty()) continue;
    ParallelFor(priors.size(), options.threads, [&](std::size_t i) {
      const FrameId id{capture, i};
      const auto* finding = std::get_if<Finding>(&results[id]);
      if (!priors[i] || !finding || !IsOpen(*finding)) return;
      PosePrior placed = *priors[i];
      placed.world_from_sensor = worlds.front().Place(placed.world_from_sensor);
      placed.world = PriorWorld::kStructure;
      auto found = LocateByPrior(*seen, id, placed, options);
      if (!found) return;
      results[id] = std::move(found->first);
      seen->labelled[id] = std::move(found->second);
    });
  }
  return results;
}

SomeFrames<FrameInput> FramesToRefine(const Seen& seen, const PerFrame<LocateResult>& results) {
  SomeFrames<FrameInput> frames;
  for (const FrameId id : results.Ids()) {
    const auto* located = std::get_if<LocatedFrame>(&results[id]);
    if (!located) continue;
    frames[id] = {located->points, located->own_pose, seen.lenses.of_frame[id],
                  static_cast<int>(seen.input->sensor_of[id]), id.capture};
  }
  return frames;
}

}  // namespace volalign
