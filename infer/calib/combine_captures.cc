#include "infer/calib/combine_captures.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "core/base/lists.h"

namespace volalign {

namespace {

/// A sensor in one capture.
struct OfSensor {
  std::size_t capture = 0;
  FrameResult* result = nullptr;
  const RefinedFrame* refined = nullptr;  // null if it was not refined

  bool IsPlaced() const { return refined && result->structure_from_sensor; }
};

/// Is the finding about the sensor itself, in whichever capture it appears?
bool ConcernsSensor(SensorCode code) {
  const std::set<SensorCode> of_sensor = {SensorCode::kDisagrees,   SensorCode::kDuplicateDepth,
                                          SensorCode::kSamePose,    SensorCode::kIntrinsicsSuspect,
                                          SensorCode::kLensSuspect, SensorCode::kNotFinite};
  return of_sensor.count(code) > 0;
}

/// The frame whose outcome is the sensor's. Without a pose, an unconnected frame comes before one
/// that sees no stack.
const FrameResult& MostTelling(const std::vector<OfSensor>& frames) {
  const auto rank = [](const FrameResult& frame) {
    if (!frame.structure_from_sensor) return frame.code == SensorCode::kUnconnected ? 2 : 3;
    return frame.status == SensorStatus::kOk ? 0 : 1;
  };
  const FrameResult* best = frames.front().result;
  for (const OfSensor& frame : frames) {
    if (rank(*frame.result) < rank(*best)) best = frame.result;
  }
  return *best;
}

/// The frame whose pose most of the sensor's frames agree with, preferably one that the joint
/// solution includes.
const OfSensor* MostAgreed(const std::vector<OfSensor>& frames) {
  constexpr double kTogether = 0.03;  // m, for a sensor that stands in one place
  const OfSensor* agreed = nullptr;
  std::pair<int, bool> best;
  for (const OfSensor& frame : frames) {
    if (!frame.IsPlaced()) continue;
    int agree = 0;
    for (const OfSensor& other : frames) {
      if (!other.IsPlaced()) continue;
      const Pose& there = other.refined->first_from_sensor;
      const PoseError apart = ComparePoses(there, frame.refined->first_from_sensor);
      agree += apart.translation_m < kTogether ? 1 : 0;
    }
    const std::pair<int, bool> rank(agree, !frame.refined->refused_fit);
    if (agreed && rank <= best) continue;
    agreed = &frame;
    best = rank;
  }
  return agreed;
}

/// Figures of all frames together: sums, and means weighted by points.
void PoolFigures(const std::vector<OfSensor>& frames, SensorOutcome* sensor) {
  const std::vector<double SensorOutcome::*> means = {
      &SensorOutcome::inlier_share, &SensorOutcome::miou, &SensorOutcome::label_iou,
      &SensorOutcome::explained_share};
  const std::vector<double SensorOutcome::*> roots = {&SensorOutcome::rms_to_structure_m,
                                                      &SensorOutcome::initial_rms_to_structure_m};
  for (const auto figure : means) sensor->*figure = 0;
  for (const auto figure : roots) sensor->*figure = 0;
  sensor->points = 0;
  std::set<std::string> sides;
  for (const OfSensor& frame : frames) {
    if (!frame.IsPlaced()) continue;
    const SensorOutcome& of = *frame.result;
    for (const auto figure : means) sensor->*figure += of.points * of.*figure;
    for (const auto figure : roots) sensor->*figure += of.points * (of.*figure) * (of.*figure);
    sides.insert(of.sides.begin(), of.sides.end());
    sensor->points += of.points;
  }
  const double points = std::max(1, sensor->points);
  for (const auto figure : means) sensor->*figure /= points;
  for (const auto figure : roots) sensor->*figure = std::sqrt(sensor->*figure / points);
  sensor->sides.assign(sides.begin(), sides.end());
}

FrameResult CombineFrames(const std::vector<OfSensor>& frames,
                          const std::vector<CaptureResult>& captures,
                          const std::optional<Pose>& ground_truth) {
  FrameResult sensor;
  static_cast<SensorOutcome&>(sensor) = MostTelling(frames);
  const OfSensor* agreed = MostAgreed(frames);
  if (!agreed) return sensor;
  const FrameResult& at = *agreed->result;
  const Pose& placement = captures[agreed->capture].first_from_placement;
  sensor.structure_from_sensor = agreed->refined->first_from_sensor;
  sensor.covariance = agreed->refined->first_covariance;
  sensor.initial = placement * at.initial;
  sensor.together.reset();
  if (at.together) sensor.together = placement * *at.together;
  if (at.prior) sensor.prior = placement * *at.prior;
  PoolFigures(frames, &sensor);
  for (const OfSensor& frame : frames) {
    if (sensor.status == SensorStatus::kFailed || !ConcernsSensor(frame.result->code)) continue;
    if (ConcernsSensor(sensor.code)) break;
    sensor.status = SensorStatus::kWeak;
    static_cast<Finding&>(sensor) = *frame.result;
  }
  sensor.error.reset();
  sensor.initial_error.reset();
  if (ground_truth) {
    sensor.error = ComparePoses(*sensor.structure_from_sensor, *ground_truth);
    sensor.initial_error = ComparePoses(sensor.initial, *ground_truth);
  }
  DemoteIfNotFinite(&sensor);
  return sensor;
}

/// Root mean squares over all captures, weighted by points.
std::optional<SetDistances> CombineMetrics(const std::vector<CaptureResult>& captures) {
  SetDistances squares;
  double points = 0;
  for (const CaptureResult& capture : captures) {
    if (!capture.metrics) continue;
    double of_capture = 0;
    for (const FrameResult& sensor : capture.sensors) of_capture += sensor.points;
    squares.d1 += of_capture * capture.metrics->d1 * capture.metrics->d1;
    squares.d2 += of_capture * capture.metrics->d2 * capture.metrics->d2;
    points += of_capture;
  }
  if (!(points > 0)) return std::nullopt;
  return SetDistances{std::sqrt(squares.d1 / points), std::sqrt(squares.d2 / points)};
}

/// The alternatives of all captures, in the structure of the first. If one capture decides a
/// sensor's choice, others that leave it open do not count.
std::vector<RigAlternative> CombineAlternatives(const std::vector<CaptureResult>& captures,
                                                const std::vector<FrameResult>& sensors) {
  const auto is_open = [&](const SensorAlternative& alternative) {
    return std::any_of(sensors.begin(), sensors.end(), [&](const FrameResult& sensor) {
      return sensor.name == alternative.name && sensor.code == SensorCode::kAmbiguous;
    });
  };
  std::vector<RigAlternative> alternatives;
  for (const CaptureResult& capture : captures) {
    for (RigAlternative alternative : capture.alternatives) {
      if (std::none_of(alternative.sensors.begin(), alternative.sensors.end(), is_open)) continue;
      alternative.capture = capture.name;
      for (SensorAlternative& sensor : alternative.sensors)
        sensor.structure_from_sensor = capture.first_from_placement * sensor.structure_from_sensor;
      alternatives.push_back(std::move(alternative));
    }
  }
  return alternatives;
}

/// Each two sensors, from the capture in which they overlap most, in the structure of the first
/// one.
std::vector<PairResult> CombinePairs(const std::vector<CaptureResult>& captures) {
  std::vector<PairResult> pairs;
  for (const CaptureResult& capture : captures) {
    const Matrix6d turn = Adjoint(capture.first_from_placement);
    for (PairResult pair : capture.pairs) {
      pair.covariance = turn * pair.covariance * turn.transpose();
      const auto known = std::find_if(pairs.begin(), pairs.end(), [&](const PairResult& other) {
        return (other.a == pair.a && other.b == pair.b) || (other.a == pair.b && other.b == pair.a);
      });
      if (known == pairs.end()) {
        pairs.push_back(pair);
      } else if (pair.overlap > known->overlap) {
        *known = pair;
      }
    }
  }
  return pairs;
}

/// The true pose of each sensor in the structure of the first capture, if known. For a sensor that
/// is absent there, sensors that share another capture with it tell where the structure stood in
/// that one.
std::vector<std::optional<Pose>> TruthsInFirst(const CaptureSet& input) {
  std::vector<std::optional<Pose>> truths(input.sensors.size());
  std::vector<std::optional<Pose>> placements(input.captures.size());
  placements[0] = Pose::Identity();
  for (std::size_t round = 0; round < input.captures.size(); ++round) {
    for (const FrameId id : input.sensor_of.Ids()) {
      const std::optional<Pose>& here = input[id].ground_truth;
      std::optional<Pose>& truth = truths[input.sensor_of[id]];
      std::optional<Pose>& placement = placements[id.capture];
      if (here && placement && !truth) truth = *placement * *here;
      if (here && truth && !placement) placement = *truth * here->inverse();
    }
  }
  return truths;
}

}  // namespace

CalibrationResult CombineCaptures(const CaptureSet& input, std::vector<CaptureResult> captures,
                                  const SomeFrames<FrameSolution>& frames) {
  CalibrationResult result;
  if (captures.size() == 1) {
    static_cast<StackResult&>(result) = std::move(captures.front());
    return result;
  }
  result.captures = std::move(captures);
  std::vector<std::vector<OfSensor>> of_sensor(input.sensors.size());
  const std::vector<std::optional<Pose>> truths = TruthsInFirst(input);
  for (const FrameId id : input.sensor_of.Ids()) {
    const std::size_t sensor = input.sensor_of[id];
    const auto solved = frames.find(id);
    of_sensor[sensor].push_back({id.capture, &result.captures[id.capture].sensors[id.frame],
                                 solved != frames.end() ? &solved->second.refined : nullptr});
  }
  for (std::size_t k = 0; k < of_sensor.size(); ++k)
    result.sensors.push_back(CombineFrames(of_sensor[k], result.captures, truths[k]));
  result.pairs = CombinePairs(result.captures);
  result.alternatives = CombineAlternatives(result.captures, result.sensors);
  result.metrics = CombineMetrics(result.captures);
  result.assembly = result.captures.front().assembly;
  for (const CaptureResult& capture : result.captures) {
    if (capture.assembly && capture.assembly->altered()) result.assembly = capture.assembly;
  }
  result.built = result.captures.front().built;
  result.boxes = result.captures.front().boxes;
  return result;
}

}  // namespace volalign
