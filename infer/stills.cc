#include "infer/stills.h"

#include <algorithm>
#include <map>
#include <string>
#include <utility>

#include "infer/refine/find_lenses.h"

namespace volalign {

namespace {

/// What the refinement of all stills says about one, as if it were the only one. `first`: index of
/// its first frame among those that were refined.
RefineResult OfStill(const RefineResult& refined, std::size_t still, std::size_t first,
                     std::size_t count) {
  RefineResult result;
  const auto begin = refined.frames.begin() + static_cast<std::ptrdiff_t>(first);
  result.frames.assign(begin, begin + static_cast<std::ptrdiff_t>(count));
  const int before = static_cast<int>(first), after = static_cast<int>(first + count);
  for (RefinedFrame& frame : result.frames) {
    if (!frame.refused_fit) continue;
    for (int& other : frame.refused_fit->contradicts) other -= before;
  }
  for (const RefinedPair& pair : refined.pairs) {
    if (pair.a < before || pair.a >= after) continue;
    result.pairs.push_back({pair.a - before, pair.b - before, pair.overlap, pair.rms});
  }
  result.placements = {refined.placements[still]};
  result.lenses = refined.lenses;
  result.size_estimated = refined.size_estimated;
  result.size_scale = refined.size_scale;
  result.sigma_size_scale = refined.sigma_size_scale;
  return result;
}

}  // namespace

std::vector<SensorFrame> AllFrames(const std::vector<Still>& stills) {
  std::vector<SensorFrame> all;
  for (const Still& still : stills) all.insert(all.end(), still.frames.begin(), still.frames.end());
  return all;
}

std::vector<StillStages> BeginStages(const std::vector<Still>& stills) {
  std::vector<StillStages> stages;
  std::size_t first = 0;
  for (const Still& still : stills) {
    stages.push_back({&still, first, {}, {}, {}, {}, {}, {}});
    first += still.frames.size();
  }
  return stages;
}

void SeeThrough(const LensSet& lenses, int threads, std::vector<StillStages>* stages) {
  for (StillStages& still : *stages) {
    const std::vector<SensorFrame>& frames = still.still->frames;
    still.seen = SeenThrough(frames, OfFrames(lenses, still.first, frames.size()));
    still.views = MakeSensorViews(still.seen, threads);
  }
}

std::vector<SensorPlanes> FindPlanes(const std::vector<StillStages>& stages, const LensSet& lenses,
                                     int threads) {
  std::vector<SensorPlanes> planes;
  for (const StillStages& still : stages) {
    for (SensorPlanes& of : FindPlanes(still.views, still.Lenses(lenses), threads))
      planes.push_back(std::move(of));
  }
  return planes;
}

std::vector<RefineFrame> FramesToRefine(const std::vector<StillStages>& stages,
                                        const LensSet& lenses, const RefineOptions& options) {
  std::vector<RefineFrame> frames;
  std::map<std::string, int> sensors;
  for (std::size_t s = 0; s < stages.size(); ++s) {
    const StillStages& still = stages[s];
    std::vector<RefineFrame> placed =
        FramesToRefine(still.seen, still.labelled, still.placements, still.Lenses(lenses), options);
    std::size_t next = 0;
    for (std::size_t i = 0; i < still.seen.size(); ++i) {
      const int sensor =
          sensors.emplace(still.seen[i].name, static_cast<int>(sensors.size())).first->second;
      if (!std::holds_alternative<PlacedSensor>(still.placements[i])) continue;
      placed[next].sensor = sensor;
      placed[next].still = static_cast<int>(s);
      frames.push_back(placed[next++]);
    }
  }
  return frames;
}

std::vector<CalibrationResult> JudgeStills(
    std::vector<StillStages> stages, const Structure& structure, const RefineResult& refined,
    const LensSet& lenses, const std::vector<std::optional<Finding>>& suspect_lenses,
    const JudgeOptions& options) {
  std::vector<CalibrationResult> judged;
  std::size_t first = 0;  // of the refined frames
  for (std::size_t s = 0; s < stages.size(); ++s) {
    StillStages& still = stages[s];
    const auto count = static_cast<std::size_t>(
        std::count_if(still.placements.begin(), still.placements.end(),
                      [](const Placement& p) { return std::holds_alternative<PlacedSensor>(p); }));
    const auto suspects = suspect_lenses.begin() + static_cast<std::ptrdiff_t>(still.first);
    judged.push_back(
        JudgeSensors(still.still->frames, structure,
                     {std::move(still.depths),
                      std::move(still.views),
                      std::move(still.labelled),
                      std::move(still.placements),
                      std::move(still.assembly),
                      OfStill(refined, s, first, count),
                      still.Lenses(lenses),
                      {suspects, suspects + static_cast<std::ptrdiff_t>(still.seen.size())}},
                     options));
    first += count;
  }
  return judged;
}

}  // namespace volalign
