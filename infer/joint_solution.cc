#include "infer/joint_solution.h"

#include <algorithm>
#include <cstddef>
#include <variant>

#include "core/parallel_for.h"
#include "core/pose.h"
#include "infer/checks/verification.h"
#include "infer/pose/shape_check.h"

namespace volalign {

namespace {

/// Labels follow the joint solution, so often at most, and while a sensor moves farther than this,
/// m.
constexpr int kLabelRounds = 6;
constexpr double kLabelsStay = 0.002;

/// Only sensors without structure terms, which have not been refined alone, need the coarse stage.
RefineResult RefineTogether(const Structure& structure, const std::vector<RefineFrame>& frames,
                            const LensSet& lenses, const std::vector<Pose>& placements,
                            RefineOptions options) {
  options.coarse = std::any_of(frames.begin(), frames.end(),
                               [](const RefineFrame& f) { return !f.use_structure_terms; });
  return Refine(structure, frames, options, lenses.lenses, placements);
}

/// The seen views of all placed sensors, in the order of FramesToRefine.
std::vector<SeenView> PlacedViews(const std::vector<StillStages>& stages, const LensSet& lenses) {
  std::vector<SeenView> views;
  for (const StillStages& still : stages) {
    for (std::size_t i = 0; i < still.seen.size(); ++i) {
      if (std::holds_alternative<PlacedSensor>(still.placements[i]))
        views.push_back({still.views[i], still.seen[i].intrinsics, lenses.Of(still.first + i)});
    }
  }
  return views;
}

}  // namespace

JointSolution SolveJointly(const Structure& structure, const std::vector<StillStages>& stages,
                           const LensSet& lenses, const std::vector<Pose>& stood,
                           const PlacementOptions& options) {
  JointSolution joint;
  joint.frames = FramesToRefine(stages, lenses, options.refine);
  joint.refined = RefineTogether(structure, joint.frames, lenses, stood, options.refine);
  const std::vector<SeenView> views = PlacedViews(stages, lenses);
  joint.points.resize(views.size());
  for (int round = 0; round < kLabelRounds; ++round) {
    RefineOptions again = options.refine;
    std::vector<std::size_t> with_sides;
    double moved = 0;
    for (std::size_t i = 0; i < views.size(); ++i) {
      const RefinedFrame& found = joint.refined.frames[i];
      if (!joint.frames[i].use_structure_terms || !found.accepted) continue;
      with_sides.push_back(i);
      moved = std::max(
          moved, ComparePoses(joint.frames[i].start, found.structure_from_sensor).translation_m);
    }
    if (moved < kLabelsStay) break;
    // Points are associated anew in each round. A sensor that was refused begins where it did.
    if (with_sides.size() == views.size()) again.fine_iterations = 1;
    ParallelFor(with_sides.size(), options.threads, [&](std::size_t k) {
      const std::size_t i = with_sides[k];
      RefineFrame& frame = joint.frames[i];
      frame.start = joint.refined.frames[i].structure_from_sensor;
      const auto still = static_cast<std::size_t>(frame.still);
      joint.points[i] =
          PlaceAt(views[i], joint.refined.placements[still].built, frame.start, options).points;
      frame.points = &joint.points[i];
    });
    joint.refined = RefineTogether(structure, joint.frames, lenses, stood, again);
  }
  return joint;
}

bool DropWithoutShape(const RefineResult& refined, const PlacementOptions& options,
                      std::vector<StillStages>* stages) {
  bool dropped = false;
  std::size_t frame = 0;
  for (std::size_t still = 0; still < stages->size(); ++still) {
    StillStages& stage = (*stages)[still];
    for (std::size_t i = 0; i < stage.placements.size(); ++i) {
      const auto* placed = std::get_if<PlacedSensor>(&stage.placements[i]);
      if (!placed) continue;
      const Pose& pose = refined.frames[frame++].structure_from_sensor;
      if (!placed->visible_by_geometry ||
          VisibleWithShape(stage.views[i], refined.placements[still].built, pose,
                           options.initial)) {
        continue;
      }
      stage.placements[i] = ExplainMissingShape();
      dropped = true;
    }
  }
  return dropped;
}

}  // namespace volalign
