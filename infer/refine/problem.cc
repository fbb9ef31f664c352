#include "infer/refine/problem.h"

#include <algorithm>
#include <map>

#include "core/base/parallel_for.h"

namespace volalign::refine_internal {

namespace {

/// Sensors are numbered in the order in which they first occur.
std::vector<FrameOf> WhatFramesAreOf(const std::vector<FrameInput>& frames) {
  std::vector<FrameOf> frame_of;
  std::map<int, std::size_t> numbers;
  std::size_t count = 0;
  for (const FrameInput& frame : frames) {
    const std::size_t sensor =
        frame.sensor < 0 ? count : numbers.emplace(frame.sensor, count).first->second;
    count = std::max(count, sensor + 1);
    frame_of.push_back({sensor, frame.capture, frame.lens});
  }
  return frame_of;
}

}  // namespace

JointProblem::JointProblem(const Structure& structure_in, const std::vector<FrameInput>& frames_in,
                           const RefineSetup& setup_in, const std::vector<SensorLens>& lenses_in,
                           std::size_t captures)
    : structure(structure_in),
      frames(frames_in),
      setup(setup_in),
      model(structure_in),
      priors(refine_internal::PriorsOf(setup_in, structure_in.boxes().size())),
      lenses(lenses_in),
      frame_of(WhatFramesAreOf(frames_in)),
      layout(frame_of, captures, model.size(), lenses.size()) {
  overlap_points.resize(frames.size());
  ParallelFor(frames.size(), setup.threads, [&](std::size_t i) {
    int others = 0;
    for (std::size_t j = 0; j < frames.size(); ++j)
      others += OverlapCounts(std::min(i, j), std::max(i, j)) ? 1 : 0;
    if (others == 0) return;
    overlap_points[i] = ChooseOverlapPoints(structure, *frames[i].points, frames[i].start,
                                            setup.max_overlap_points / others, false);
  });
}

bool JointProblem::OverlapCounts(std::size_t a, std::size_t b) const {
  if (setup.max_overlap_points == 0 || frame_of[a].sensor == frame_of[b].sensor ||
      frame_of[a].capture != frame_of[b].capture)
    return false;
  const auto is_in = [&](std::size_t sensor, std::size_t capture) {
    return std::any_of(frame_of.begin(), frame_of.end(), [&](const FrameOf& of) {
      return of.sensor == sensor && of.capture == capture;
    });
  };
  for (std::size_t capture = 0; capture < frame_of[a].capture; ++capture) {
    if (is_in(frame_of[a].sensor, capture) && is_in(frame_of[b].sensor, capture)) return false;
  }
  return true;
}

}  // namespace volalign::refine_internal
