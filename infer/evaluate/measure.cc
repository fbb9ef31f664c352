#include "infer/evaluate/measure.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <utility>

#include "infer/calib/calibrate.h"
#include "infer/initial/initial_pose.h"
#include "infer/initial/sides_fix_pose.h"

namespace volalign {

namespace {

/// Remembers the network's labels of the frames of one capture.
class SharedSegmenter : public Segmenter {
 public:
  explicit SharedSegmenter(Segmenter* inner) : inner_(inner) {}

  std::vector<SegmentationResult> Segment(
      const std::vector<SegmentationRequest>& requests) override {
    std::vector<std::size_t> answer(requests.size());
    std::vector<SegmentationRequest> unknown;
    for (std::size_t i = 0; i < requests.size(); ++i) {
      answer[i] = Find(requests[i]);
      if (answer[i] < known_.size()) continue;
      answer[i] = known_.size();
      known_.push_back(
          {*requests[i].depth, *requests[i].intrinsics, requests[i].quarter_turns, {}});
      unknown.push_back(requests[i]);
    }
    if (!unknown.empty()) {
      std::vector<SegmentationResult> seen = inner_->Segment(unknown);
      for (std::size_t j = 0; j < seen.size(); ++j) {
        known_[known_.size() - seen.size() + j].result = std::move(seen[j]);
      }
    }
    std::vector<SegmentationResult> results;
    results.reserve(answer.size());
    for (const std::size_t i : answer) results.push_back(known_[i].result);
    return results;
  }

 private:
  struct Known {
    DepthImage depth;
    Intrinsics intrinsics;
    int turns;
    SegmentationResult result;
  };

  std::size_t Find(const SegmentationRequest& request) const {
    const auto found = std::find_if(known_.begin(), known_.end(), [&](const Known& known) {
      return known.turns == request.quarter_turns && known.intrinsics == *request.intrinsics &&
             known.depth == *request.depth;
    });
    return static_cast<std::size_t>(found - known_.begin());
  }

  Segmenter* inner_;
  std::vector<Known> known_;
};

bool SeesAPose(const Structure& structure, const LabelImage& labels) {
  std::map<int, int> pixels;
  for (const std::uint8_t label : labels) {
    if (label) ++pixels[label];
  }
  std::vector<int> seen;
  for (const auto& [label, count] : pixels) {
    if (count >= kFewestSidePixels) seen.push_back(label);
  }
  return SidesFixPose(structure, seen);
}

EvaluatedErrors ErrorsOf(const FrameResult& sensor, const Pose& truth) {
  EvaluatedErrors errors;
  errors.initial = ComparePoses(sensor.initial, truth);
  errors.refined = ComparePoses(*sensor.structure_from_sensor, truth);
  errors.delta = LeftDifference(*sensor.structure_from_sensor, truth);
  return errors;
}

/// Does sensor i truly see enough in one capture? None if that is not known.
std::optional<bool> SidesFixPoseOf(const EvaluationCapture& capture, std::size_t i) {
  if (i >= capture.labels.size()) return std::nullopt;
  return SeesAPose(capture.structure, capture.labels[i]) ||
         std::any_of(capture.further.begin(), capture.further.end(),
                     [&](const FurtherCapture& other) {
                       return SeesAPose(capture.structure, other.labels.at(i));
                     });
}

/// The captures to be calibrated together.
std::vector<Capture> NameCaptures(const EvaluationCapture& capture) {
  std::vector<Capture> captures{{"placement_1", capture.frames}};
  for (const FurtherCapture& other : capture.further) {
    captures.push_back({fmt::format("placement_{}", captures.size() + 1), other.frames});
  }
  return captures;
}

/// `i`: index of the sensor's frame.
EvaluatedSensor Measure(const FrameResult& result, std::size_t i,
                        const EvaluationCapture& capture) {
  const SensorFrame& frame = capture.frames[i];
  EvaluatedSensor sensor;
  sensor.name = result.name;
  sensor.status = result.status;
  sensor.code = result.code;
  sensor.sides_fix_pose = SidesFixPoseOf(capture, i);
  if (!result.structure_from_sensor) return sensor;
  sensor.sides = static_cast<int>(result.sides.size());
  sensor.initial_rms_to_structure_m = result.initial_rms_to_structure_m;
  sensor.rms_to_structure_m = result.rms_to_structure_m;
  sensor.inlier_share = result.inlier_share;
  sensor.sigma = result.covariance.diagonal().cwiseSqrt();
  if (frame.ground_truth) {
    sensor.nominal = ErrorsOf(result, *frame.ground_truth);
    sensor.built = ErrorsOf(result, capture.nominal_from_built * *frame.ground_truth);
  }
  return sensor;
}

}  // namespace

std::vector<EvaluatedCase> EvaluateCapture(const EvaluationCapture& capture,
                                           const std::vector<EvaluationVariant>& variants,
                                           Segmenter& segmenter) {
  SharedSegmenter shared(&segmenter);
  std::vector<EvaluatedCase> cases;
  for (const EvaluationVariant& variant : variants) {
    const CalibrationResult calibration =
        Calibrate(NameCaptures(capture), capture.structure, shared, variant.options);
    EvaluatedCase one;
    one.variant = variant.name;
    one.timings_s = {calibration.timings_s.begin(), calibration.timings_s.end()};
    for (std::size_t i = 0; i < calibration.sensors.size(); ++i) {
      one.results.push_back(Measure(calibration.sensors[i], i, capture));
    }
    cases.push_back(std::move(one));
  }
  return cases;
}

}  // namespace volalign
