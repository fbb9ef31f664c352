#include "infer/calib/look.h"

#include <utility>
#include <variant>
#include <vector>

namespace volalign {

namespace {

/// Frames whose depths failed get no labels.
std::vector<Labelled> LabelStill(const Seen& seen, std::size_t still, Segmenter* segmenter,
                                 const CalibrateOptions& options, StageClock* clock) {
  const std::vector<SensorFrame>& frames = seen.capture->stills[still].frames;
  std::vector<Intrinsics> intrinsics;
  for (std::size_t i = 0; i < frames.size(); ++i)
    intrinsics.push_back(seen.lenses.Effective({still, i}));
  std::vector<LabelRequest> requests;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    requests.push_back({&seen.views[{still, i}], &intrinsics[i], frames[i].quarter_turns,
                        !seen.depths[{still, i}].failure});
  }
  return LabelViews(requests, seen.capture->structure, segmenter, options.initial,
                    options.orientation, options.threads, clock);
}

}  // namespace

Seen Look(const CaptureSet& capture, LensSet lenses, Segmenter* segmenter,
          const CalibrateOptions& options, StageClock* clock) {
  Seen seen;
  seen.capture = &capture;
  seen = WithLenses(std::move(seen), std::move(lenses), options.threads);
  std::vector<std::vector<DepthFinding>> depths;
  for (std::size_t s = 0; s < capture.stills.size(); ++s)
    depths.push_back(CheckDepths(capture.stills[s].frames, seen.views.OfStill(s), options.verdict));
  seen.depths = PerFrame(std::move(depths));
  clock->Lap("rays");
  std::vector<std::vector<Labelled>> labelled;
  for (std::size_t s = 0; s < capture.stills.size(); ++s)
    labelled.push_back(LabelStill(seen, s, segmenter, options, clock));
  seen.labelled = PerFrame(std::move(labelled));
  return seen;
}

Seen WithLenses(Seen seen, LensSet lenses, int threads) {
  seen.views = LookThrough(*seen.capture, lenses, threads);
  seen.lenses = std::move(lenses);
  return seen;
}

PerFrame<Labelled> LabelAgain(const Seen& seen, const PerFrame<LocateResult>& results,
                              Segmenter* segmenter, const CalibrateOptions& options,
                              StageClock* clock) {
  const auto is_anew = [&](FrameId id) {
    return std::holds_alternative<Finding>(results[id]) && !seen.depths[id].failure;
  };
  PerFrame<Labelled> labelled = MapFrames(results, options.threads, [&](FrameId id) {
    return UpdateInitialPose(seen.views[id], seen.labelled[id], seen.capture->structure,
                             options.initial);
  });
  for (std::size_t still = 0; still < results.stills(); ++still) {
    std::vector<FrameId> anew;
    for (std::size_t i = 0; i < results.OfStill(still).size(); ++i) {
      if (is_anew({still, i})) anew.push_back({still, i});
    }
    if (anew.empty()) continue;
    std::vector<Labelled> of_still = LabelStill(seen, still, segmenter, options, clock);
    for (const FrameId id : anew) labelled[id] = std::move(of_still[id.frame]);
  }
  return labelled;
}

}  // namespace volalign
