#include "infer/calib/check_request.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/geometry/stack_faults.h"
#include "infer/checks/depth_checks.h"

namespace volalign {

namespace {

/// m and deg: of a prior. Smaller ones are less than what a sensor moves by itself.
constexpr double kLeastPriorSigma = 1e-4, kMostPriorSigma = 1000;

/// Are these the same depth map, with any depth?
bool AreSame(const DepthImage& a, const DepthImage& b) {
  const bool shows_something = std::any_of(a.begin(), a.end(), [](float z) { return z > 0; });
  return shows_something && a.width() == b.width() && a.height() == b.height() &&
         std::equal(a.begin(), a.end(), b.begin());
}

/// A sensor is one device that does not move: only things in front of it may change.
void CheckSameSensor(const SensorFrame& earlier, const std::string& earlier_capture,
                     const SensorFrame& frame, const std::string& capture) {
  if (!(frame.intrinsics == earlier.intrinsics) || frame.sensor != earlier.sensor) {
    throw DataError(
        fmt::format("sensor \"{}\" has other intrinsics or is of another kind in {} than in {}; "
                    "give captures of the same sensors in the same modes",
                    frame.name, capture, earlier_capture));
  }
  if (AreSame(frame.depth, earlier.depth)) {
    throw DataError(
        fmt::format("sensor \"{}\" has the same depth map in {} as in {}; each capture needs "
                    "frames of its own, with the stack at another place",
                    frame.name, capture, earlier_capture));
  }
}

/// The priors of a calibration are of one world, and have standard deviations.
void CheckPriors(const std::vector<Capture>& captures) {
  const SensorFrame* first = nullptr;
  for (const Capture& capture : captures) {
    for (const SensorFrame& frame : capture.frames) {
      if (!frame.prior) continue;
      const PosePrior& prior = *frame.prior;
      if (!first) first = &frame;
      if (prior.world != first->prior->world) {
        throw DataError(
            fmt::format("the priors of \"{}\" and \"{}\" are of different worlds; give all as "
                        "structure_from_sensor, or all as world_from_sensor with the same scale",
                        first->name, frame.name));
      }
      for (const double sigma : {prior.sigma_m, prior.sigma_deg}) {
        if (!(sigma >= kLeastPriorSigma && sigma <= kMostPriorSigma)) {
          throw DataError(
              fmt::format("the prior of \"{}\" has a standard deviation of {}; give one from {} to "
                          "{}, in m and in deg",
                          frame.name, sigma, kLeastPriorSigma, kMostPriorSigma));
        }
      }
    }
  }
}

}  // namespace

SensorNumber ParseChoice(const std::string& text) {
  const std::size_t at = text.rfind('=');
  int number = 0;
  if (at != std::string::npos) {
    const char* end = text.data() + text.size();
    const auto read = std::from_chars(text.data() + at + 1, end, number);
    if (read.ec != std::errc() || read.ptr != end) number = 0;
  }
  if (number < 1) {
    throw ConfigError(fmt::format(
        "orientation.choose (--choose): \"{}\" is not SENSOR=NUMBER, for example S1=2", text));
  }
  return {text.substr(0, at), number};
}

CaptureSet CheckRequest(std::vector<Capture> captures, Structure structure,
                        const CalibrateOptions& options, bool model) {
  ValidateConfig(options);
  ParseEstimate(options.refine.estimate);
  if (!model && options.initial.method == PoseMethod::kNetwork) {
    throw ConfigError(
        "initial.method asks for the labels of a network, and there is no model; give one "
        "(--model), or choose geometry");
  }
  RequireStack(structure);
  if (captures.empty()) throw DataError("there is no capture to calibrate");
  std::map<std::string, std::vector<std::pair<const SensorFrame*, const Capture*>>> frames_of;
  std::set<std::string> capture_names;
  for (const Capture& capture : captures) {
    if (!capture_names.insert(capture.name).second) {
      throw DataError(
          fmt::format("two captures are named \"{}\"; names must be unique", capture.name));
    }
    std::set<std::string> names;
    for (const SensorFrame& frame : capture.frames) {
      if (!names.insert(frame.name).second) {
        throw DataError(
            fmt::format("two sensors are named \"{}\"; names must be unique", frame.name));
      }
      auto& earlier = frames_of[frame.name];
      for (const auto& [other, other_capture] : earlier)
        CheckSameSensor(*other, other_capture->name, frame, capture.name);
      earlier.emplace_back(&frame, &capture);
    }
  }
  for (const std::string& alternative : options.orientation.choose) {
    if (frames_of.count(ParseChoice(alternative).sensor) == 0) {
      throw ConfigError(fmt::format(
          "orientation.choose (--choose): \"{}\" names no sensor of the capture", alternative));
    }
  }
  CheckPriors(captures);
  for (Capture& capture : captures) {
    for (SensorFrame& frame : capture.frames) DropStandIns(&frame.depth);
  }
  return {std::move(captures), std::move(structure)};
}

}  // namespace volalign
