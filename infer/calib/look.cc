#include "infer/calib/look.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "infer/calib/check_request.h"
#include "infer/checks/prior_use.h"

namespace volalign {

namespace {

/// The requested number of a sensor's pose; 0: none.
int ChoiceOf(const std::string& name, const std::vector<std::string>& chosen) {
  int number = 0;
  for (const std::string& each : chosen) {
    const SensorNumber asked = ParseChoice(each);
    if (asked.sensor == name) number = asked.number;
  }
  return number;
}

/// Frames whose depths failed get no labels.
std::vector<Labelled> LabelCapture(const Seen& seen, std::size_t capture, Segmenter* segmenter,
                                   const CalibrateOptions& options, StageClock* clock) {
  const std::vector<SensorFrame>& frames = seen.input->captures[capture].frames;
  std::vector<Intrinsics> intrinsics;
  for (std::size_t i = 0; i < frames.size(); ++i)
    intrinsics.push_back(seen.lenses.Effective({capture, i}));
  const std::vector<std::optional<PosePrior>> priors = PriorsOfCapture(*seen.input, capture);
  std::vector<LabelRequest> requests;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    requests.push_back({&seen.views[{capture, i}], &intrinsics[i], frames[i].quarter_turns,
                        !seen.depths[{capture, i}].failure,
                        ChoiceOf(frames[i].name, options.orientation.choose),
                        priors[i] ? &*priors[i] : nullptr});
  }
  return LabelViews(requests, seen.input->structure, segmenter, options.initial, options.threads,
                    clock);
}

/// Throws ConfigError unless some capture leaves the choice open.
void RequireChoice(const Seen& seen, const SensorNumber& asked) {
  std::set<int> numbers;
  for (const FrameId id : seen.labelled.Ids()) {
    if ((*seen.input)[id].name != asked.sensor) continue;
    if (seen.labelled[id].given) return;
    for (const PoseAlternative& alternative : seen.labelled[id].alternatives)
      numbers.insert(alternative.number);
  }
  if (numbers.count(asked.number) > 0)
    throw ConfigError(
        fmt::format("orientation.choose (--choose): pose {1} of {0} contradicts what it sees; "
                    "leave the choice out",
                    asked.sensor, asked.number));
  throw ConfigError(fmt::format(
      "orientation.choose (--choose): {} has no pose {}; {}", asked.sensor, asked.number,
      numbers.empty() ? "no other pose fits its view"
                      : fmt::format("its other poses are {}", fmt::join(numbers, ", "))));
}

}  // namespace

Seen Look(const CaptureSet& input, FoundLenses found, Segmenter* segmenter,
          const CalibrateOptions& options, StageClock* clock) {
  Seen seen;
  seen.input = &input;
  seen.lenses = std::move(found.lenses);
  seen.views = std::move(found.views);
  std::vector<std::vector<DepthFinding>> depths;
  for (std::size_t s = 0; s < input.captures.size(); ++s) {
    const std::vector<SensorFrame>& frames = input.captures[s].frames;
    depths.push_back(CheckDepths(frames, seen.views.OfCapture(s)));
  }
  seen.depths = PerFrame(std::move(depths));
  clock->Lap("rays");
  std::vector<std::vector<Labelled>> labelled;
  for (std::size_t s = 0; s < input.captures.size(); ++s)
    labelled.push_back(LabelCapture(seen, s, segmenter, options, clock));
  seen.labelled = PerFrame(std::move(labelled));
  for (const std::string& chosen : options.orientation.choose)
    RequireChoice(seen, ParseChoice(chosen));
  return seen;
}

}  // namespace volalign
