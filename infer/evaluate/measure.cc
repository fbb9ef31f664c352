#include "infer/evaluate/measure.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <set>
#include <utility>

#include "core/base/error.h"
#include "core/base/text.h"
#include "infer/initial/initial_pose.h"
#include "infer/initial/sides_fix_pose.h"

namespace volalign {

namespace {

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
  std::vector<EvaluatedCase> cases;
  for (const EvaluationVariant& variant : variants) {
    const CalibrationResult calibration =
        Calibrate(NameCaptures(capture), capture.structure, segmenter, variant.options);
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

std::vector<EvaluationVariant> ReadVariants(const ConfigSource& source,
                                            const std::string& compare) {
  if (compare.empty()) return {{"volalign", ReadConfig<CalibrateOptions>(source)}};
  const std::size_t equals = compare.find('=');
  if (equals == std::string::npos || equals == 0 || equals + 1 == compare.size()) {
    throw ConfigError(fmt::format(
        "--compare {}: KEY=VALUE,VALUE is expected, as in refine.box_sigma_m=0.004,0.01", compare));
  }
  std::vector<EvaluationVariant> variants;
  std::set<std::string> names;
  for (const std::string& value : Split(compare.substr(equals + 1), ',')) {
    if (!names.insert(value).second) {
      throw ConfigError(fmt::format("--compare {}: {} stands twice", compare, value));
    }
    ConfigSource own = source;
    own.Set(compare.substr(0, equals + 1) + value);
    variants.push_back({value, ReadConfig<CalibrateOptions>(own)});
  }
  return variants;
}

}  // namespace volalign
