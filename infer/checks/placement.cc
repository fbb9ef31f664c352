#include "infer/checks/placement.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>

#include "core/parallel_for.h"
#include "infer/checks/hints.h"
#include "infer/checks/intrinsics_check.h"
#include "infer/checks/verification.h"
#include "infer/pose/agreement.h"
#include "infer/pose/shape_check.h"

namespace volalign {

namespace {

/// m: how far a measured point may lie from the side that the pose shows there, to be labelled with
/// it. Boxes stray by centimetres.
constexpr double kRelabelDistance = 0.04;

/// Where many sides fit the structure badly: would they fit it with other intrinsics?
std::optional<BetterIntrinsics> CheckIntrinsics(const SensorView& view,
                                                const Intrinsics& intrinsics,
                                                const LabelledView& labelled,
                                                const Structure& structure,
                                                const PlacementOptions& options) {
  const InitialPose& initial = labelled.initial;
  const bool fits = initial.found && initial.agreement.score() >= options.verdict.suspicious_score;
  if (fits || !SeesManySides(initial.evidence, options.verdict)) return std::nullopt;
  return FindBetterIntrinsics(view.depth, intrinsics, labelled.segmentation, structure,
                              options.initial, options.verdict.intrinsics);
}

struct OwnPose {
  Pose structure_from_sensor = Pose::Identity();
  double sigma_translation_m = 0;  // of the axis that is known least
};

/// The sensor's pose from its own view, everything that may be estimated being free.
OwnPose RefineAlone(const SensorPoints& points, const InitialPose& initial, const SensorLens& lens,
                    const Structure& structure, const RefineOptions& options) {
  RefineOptions alone = options;
  alone.max_overlap_points = 0;
  alone.threads = 1;
  alone.choose_estimates = false;
  const RefinedFrame refined =
      Refine(structure,
             {{&points, initial.from_keypoints, initial.structure_from_sensor,
               initial.structure_from_sensor, true, 0}},
             alone, {lens})
          .frames.front();
  return {refined.structure_from_sensor,
          std::sqrt(refined.covariance.diagonal().head<3>().maxCoeff())};
}

Finding ExplainAlteredStack(const AssemblyReport& report) {
  std::string hint =
      "stack the boxes as the structure file says, or describe them as they stand (--structure)";
  if (report.arrangement.code == SensorCode::kAssemblyMirrored) {
    hint = "if it is the stack, " + hint +
           "; if it is the frames, which then show everything as a mirror does, switch that off in "
           "the capture program or flip the stored pictures";
  }
  return {report.arrangement.code,
          fmt::format("{}: that explains {:.0f} % of what the sensors see, the stack as described "
                      "{:.0f} %",
                      report.arrangement.sentence, 100 * report.overlap,
                      100 * report.described_overlap),
          std::move(hint)};
}

Finding MirroredFrame() {
  return {SensorCode::kFrameMirrored,
          "the frame is mirrored: it shows the structure as a mirror does, while other sensors see "
          "it as described",
          "switch the mirroring of this sensor's pictures off in the capture program, or flip the "
          "stored picture"};
}

bool IsMirrored(const std::optional<AssemblyReport>& assembly, std::size_t frame) {
  if (!assembly) return false;
  const std::vector<std::size_t>& mirrored = assembly->mirrored_frames;
  return std::find(mirrored.begin(), mirrored.end(), frame) != mirrored.end();
}

Finding UpUnknown(const LabelledView& labelled) {
  return {
      SensorCode::kAmbiguous,
      fmt::format("its view fits the structure about as well {}, and nothing tells which of the "
                  "two agrees with the other sensors: no floor, nothing else that they share, "
                  "and none that is mounted like it",
                  labelled.other_pose),
      "let it see the floor under the structure, mount it as the others are mounted, or give "
      "its quarter_turns"};
}

/// Refines the own pose again, with the labels that it implies itself: a network's, or those of the
/// pose that geometry has found, end where they like.
OwnPose RefineWithItsLabels(const SeenView& seen, const OwnPose& own, const Structure& structure,
                            const PlacementOptions& options) {
  InitialPose from;
  from.from_keypoints = from.structure_from_sensor = own.structure_from_sensor;
  return RefineAlone(PlaceAt(seen, structure, own.structure_from_sensor, options).points, from,
                     seen.lens, structure, options.refine);
}

/// See PlaceSensors.
Placement PlaceSensor(const SeenView& seen, const LabelledView& labelled, bool use_structure,
                      const Structure& structure, const PlacementOptions& options) {
  const SensorView& view = seen.view;
  const InitialPose& initial = labelled.initial;
  const std::optional<BetterIntrinsics> better =
      CheckIntrinsics(view, seen.intrinsics, labelled, structure, options);
  if (!initial.found && labelled.source == PoseSource::kGeometry) return ExplainMissingShape();
  if (!initial.found) return ExplainMissingPose(initial, options.verdict);

  OwnPose own{initial.structure_from_sensor, 0};
  if (use_structure) {
    own = RefineAlone(SampleSeen(seen, labelled.segmentation, structure, options), initial,
                      seen.lens, structure, options.refine);
    own = RefineWithItsLabels(seen, own, structure, options);
  }

  const Pose& pose = own.structure_from_sensor;
  OwnPoseEvidence evidence;
  evidence.agreement = CompareWithView(view, labelled.segmentation, structure, pose,
                                       options.initial.evidence.min_confidence, kInlierDistance);
  evidence.confirmed = ConfirmedLabels(view, initial.evidence, structure, pose);
  evidence.sigma_translation_m = own.sigma_translation_m;
  evidence.initial = &initial;
  evidence.better_intrinsics = better ? &*better : nullptr;
  if (std::optional<Finding> failure =
          VerifyOwnPose(evidence, structure, options.initial.keypoints, options.verdict)) {
    return *std::move(failure);
  }
  std::optional<double> visible;
  if (labelled.source == PoseSource::kGeometry) {
    visible = VisibleWithShape(view, structure, pose, options.initial);
    if (!visible) return ExplainMissingShape();
  }
  if (labelled.up_unknown) return UpUnknown(labelled);

  PlacedSensor placed = PlaceAt(seen, structure, pose, options);
  placed.visible_by_geometry = visible;
  if (better) placed.suspect_intrinsics = SuspectIntrinsics(*better);
  return placed;
}

/// Tells sensors that see too few sides where to move, which takes the others' orientation.
void GiveMoveHints(const std::vector<LabelledView>& labelled, std::vector<Placement>* placements) {
  std::vector<std::pair<Pose, int>> placed;
  for (std::size_t i = 0; i < labelled.size(); ++i) {
    if (const auto* sensor = std::get_if<PlacedSensor>(&(*placements)[i]))
      placed.emplace_back(sensor->own_pose, labelled[i].quarter_turns);
  }
  const std::optional<int> network = UprightTurnsOfNetwork(placed);
  for (std::size_t i = 0; i < labelled.size(); ++i) {
    auto* failure = std::get_if<Finding>(&(*placements)[i]);
    if (!failure || failure->code != SensorCode::kDegenerateSides) continue;
    std::optional<int> upright;
    if (network) upright = *network + labelled[i].quarter_turns;
    failure->hint = MoveHint(labelled[i].segmentation.labels, upright);
  }
}

bool HasStructureTerms(const std::string& name, const RefineOptions& options) {
  const auto& without = options.without_structure;
  return std::find(without.begin(), without.end(), name) == without.end();
}

}  // namespace

SensorPoints SampleSeen(const SeenView& seen, const SegmentationResult& segmentation,
                        const Structure& structure, const PlacementOptions& options) {
  SamplingOptions sampling;
  sampling.min_confidence = options.initial.evidence.min_confidence;
  sampling.max_side_points = options.refine.max_side_points;
  sampling.max_edge_points = options.refine.max_edge_points;
  SensorPoints points = SamplePoints(seen.view, segmentation, structure, sampling);
  points.intrinsics = seen.intrinsics;
  points.lens = seen.lens.change;
  return points;
}

PlacedSensor PlaceAt(const SeenView& seen, const Structure& structure, const Pose& pose,
                     const PlacementOptions& options) {
  return {pose,
          SampleSeen(seen, LabelsFromPose(seen.view, structure, pose, kRelabelDistance), structure,
                     options),
          std::nullopt, std::nullopt, std::nullopt};
}

std::optional<AssemblyReport> InspectStack(const std::vector<SensorView>& views,
                                           const std::vector<LabelledView>& labelled,
                                           const Structure& structure,
                                           const PlacementOptions& options) {
  std::vector<AssemblySensor> sensors;
  std::vector<std::size_t> frames;  // of each of them
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (!SeesManySides(labelled[i].initial.evidence, options.verdict)) continue;
    sensors.push_back({&views[i], &labelled[i].segmentation, &labelled[i].initial});
    frames.push_back(i);
  }
  if (!options.assembly.enabled || sensors.empty()) return std::nullopt;
  AssemblyReport report =
      InspectAssembly(sensors, structure, options.initial, options.assembly, options.threads);
  for (std::size_t& sensor : report.mirrored_frames) sensor = frames[sensor];
  return report;
}

std::vector<Placement> PlaceSensors(const std::vector<SensorFrame>& frames,
                                    const std::vector<SensorView>& views,
                                    const std::vector<DepthFinding>& depths,
                                    const std::vector<LabelledView>& labelled,
                                    const std::optional<AssemblyReport>& assembly,
                                    const LensSet& lenses, const Structure& structure,
                                    const PlacementOptions& options) {
  std::vector<Placement> placements(frames.size());
  const bool altered = assembly && assembly->altered();
  ParallelFor(frames.size(), options.threads, [&](std::size_t i) {
    if (depths[i].failure) {
      placements[i] = *depths[i].failure;
    } else if (IsMirrored(assembly, i)) {
      placements[i] = MirroredFrame();
    } else if (altered && SeesManySides(labelled[i].initial.evidence, options.verdict)) {
      placements[i] = ExplainAlteredStack(*assembly);
    } else {
      placements[i] =
          PlaceSensor({views[i], frames[i].intrinsics, lenses.Of(i)}, labelled[i],
                      HasStructureTerms(frames[i].name, options.refine), structure, options);
      if (altered && std::holds_alternative<PlacedSensor>(placements[i]))
        placements[i] = ExplainAlteredStack(*assembly);
    }
  });
  GiveMoveHints(labelled, &placements);
  return placements;
}

std::vector<RefineFrame> FramesToRefine(const std::vector<SensorFrame>& frames,
                                        const std::vector<LabelledView>& labelled,
                                        const std::vector<Placement>& placements,
                                        const LensSet& lenses, const RefineOptions& options) {
  std::vector<RefineFrame> sensors;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (const auto* placed = std::get_if<PlacedSensor>(&placements[i])) {
      const InitialPose& initial = labelled[i].initial;
      const bool alone = !placed->by_neighbours;
      sensors.push_back({&placed->points, alone ? initial.from_keypoints : placed->own_pose,
                         placed->InitialPoseOf(initial), placed->own_pose,
                         HasStructureTerms(frames[i].name, options), lenses.of_frame[i]});
    }
  }
  return sensors;
}

}  // namespace volalign
