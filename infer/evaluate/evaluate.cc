#include "infer/evaluate/evaluate.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cctype>
#include <chrono>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "core/error.h"
#include "core/file_util.h"
#include "core/procrustes.h"
#include "core/strict_json.h"
#include "core/structure_gltf.h"
#include "infer/pose/sides_fix_pose.h"
#include "render/depth_renderer.h"

namespace volalign {

namespace {

using Json = nlohmann::ordered_json;

constexpr char kAllRigs[] = "all rigs", kAllSensors[] = "all";
constexpr char kAsTheRig[] = "as the rig";
constexpr double kWrongM = 0.1, kWrongDeg = 5;
// Half widths, in standard deviations, of a normal distribution's central intervals.
constexpr double kSigma68 = 0.994457883, kSigma95 = 1.959963985;

/// Remembers the network's answers for the frames of one still.
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
    const Intrinsics& k = *request.intrinsics;
    for (std::size_t i = 0; i < known_.size(); ++i) {
      const Intrinsics& other = known_[i].intrinsics;
      if (known_[i].turns == request.quarter_turns && other.fx == k.fx && other.fy == k.fy &&
          other.cx == k.cx && other.cy == k.cy && other.distortion == k.distortion &&
          known_[i].depth == *request.depth) {
        return i;
      }
    }
    return known_.size();
  }

  Segmenter* inner_;
  std::vector<Known> known_;
};

std::vector<Eigen::Vector3d> Corners(const Structure& structure) {
  std::vector<Eigen::Vector3d> corners;
  for (const Box& box : structure.boxes()) {
    for (int i = 0; i < 8; ++i) {
      const Eigen::Vector3d sign(i & 1 ? 0.5 : -0.5, i & 2 ? 0.5 : -0.5, i & 4 ? 0.5 : -0.5);
      corners.push_back(box.structure_from_box * Eigen::Vector3d(sign.cwiseProduct(box.size)));
    }
  }
  return corners;
}

bool SeesAPose(const Structure& structure, const LabelImage& labels,
               const InitialPoseOptions& options) {
  std::map<int, int> pixels;
  for (const std::uint8_t label : labels) {
    if (label) ++pixels[label];
  }
  std::vector<int> seen;
  for (const auto& [label, count] : pixels) {
    if (count >= options.evidence.min_pixels) seen.push_back(label);
  }
  return SidesFixPose(structure, seen, KeypointKind::kExposed);
}

EvaluatedSensor::Errors ErrorsOf(const SensorResult& sensor, const Pose& truth) {
  EvaluatedSensor::Errors errors;
  errors.initial = ComparePoses(sensor.initial, truth);
  errors.refined = ComparePoses(*sensor.structure_from_sensor, truth);
  errors.delta = LeftDifference(*sensor.structure_from_sensor, truth);
  return errors;
}

std::string Fingerprint(const EvaluationItem& item, const EvaluationVariant& variant,
                        const EvaluateRun& run) {
  std::string all;
  for (const std::string& part : {run.program, run.model_sha256, item.rig, item.sensors,
                                  item.identity, variant.name, WriteConfig(variant.options)}) {
    all += fmt::format("{}:{}\n", part.size(), part);
  }
  return Sha256(all);
}

double Finite(double value, const std::string& what) {
  if (!std::isfinite(value)) {
    throw Error(fmt::format("{} = {} is not finite and was not written", what, value));
  }
  return value;
}

Json SixJson(const Vector6d& v, const std::string& what) {
  Json json = Json::array();
  for (int i = 0; i < 6; ++i) json.push_back(Finite(v[i], what));
  return json;
}

Json ErrorsJson(const EvaluatedSensor::Errors& errors, const std::string& what) {
  const auto pose = [&](const PoseError& e) {
    return Json{{"translation_m", Finite(e.translation_m, what)},
                {"rotation_deg", Finite(e.rotation_deg, what)}};
  };
  return {{"initial", pose(errors.initial)},
          {"refined", pose(errors.refined)},
          {"delta", SixJson(errors.delta, what)}};
}

Json SensorJson(const EvaluatedSensor& sensor) {
  Json json = {{"name", sensor.name}, {"status", sensor.status}};
  if (!sensor.code.empty()) json["code"] = sensor.code;
  if (sensor.sides_fix_pose) json["sides_fix_pose"] = *sensor.sides_fix_pose;
  if (!sensor.placed()) return json;
  json["sides"] = sensor.sides;
  json["initial_rms_to_structure_m"] = Finite(sensor.initial_rms_to_structure_m, sensor.name);
  json["rms_to_structure_m"] = Finite(sensor.rms_to_structure_m, sensor.name);
  json["inlier_share"] = Finite(sensor.inlier_share, sensor.name);
  json["sigma"] = SixJson(sensor.sigma, sensor.name + ": sigma");
  if (sensor.nominal) json["error"] = ErrorsJson(*sensor.nominal, sensor.name + ": error");
  if (sensor.built) {
    json["error_as_built"] = ErrorsJson(*sensor.built, sensor.name + ": error_as_built");
  }
  return json;
}

Json CaseJson(const EvaluatedCase& one) {
  Json json = {{"fingerprint", one.fingerprint}, {"rig", one.rig}};
  if (!one.sensors.empty()) json["sensor_model"] = one.sensors;
  if (one.seed) json["seed"] = *one.seed;
  json["variant"] = one.variant;
  json["sensors"] = Json::array();
  for (const EvaluatedSensor& sensor : one.results) json["sensors"].push_back(SensorJson(sensor));
  json["timings_s"] = Json::object();
  for (const auto& [stage, seconds] : one.timings_s) {
    json["timings_s"][stage] = Finite(seconds, stage);
  }
  return json;
}

Json SummaryJson(const EvaluationSummary& summary) {
  Json json = {{"rig", summary.rig},         {"sensor_model", summary.sensors},
               {"variant", summary.variant}, {"sensors", summary.count},
               {"placed", summary.placed},   {"weak", summary.weak},
               {"fixable", summary.fixable}, {"lost", summary.lost},
               {"wrong", summary.wrong},     {"measured", summary.measured}};
  const auto put = [&](const char* key, const ErrorStatistics& s) {
    json[key] = {{"median", s.median}, {"p95", s.p95}, {"max", s.max}};
  };
  put("initial_mm", summary.initial_mm);
  put("initial_deg", summary.initial_deg);
  put("refined_mm", summary.refined_mm);
  put("refined_deg", summary.refined_deg);
  put("as_built_initial_mm", summary.built_initial_mm);
  put("as_built_initial_deg", summary.built_initial_deg);
  put("as_built_refined_mm", summary.built_refined_mm);
  put("as_built_refined_deg", summary.built_refined_deg);
  json["cover_68"] = summary.cover68;
  json["cover_95"] = summary.cover95;
  json["as_built_cover_68"] = summary.built_cover68;
  json["as_built_cover_95"] = summary.built_cover95;
  return json;
}

void WriteEvaluation(const EvaluateRun& run, const std::vector<EvaluatedCase>& cases) {
  Json json = {{"format", kEvaluationFormat},
               {"tool", "volalign " VOLALIGN_VERSION},
               {"model", {{"file", run.model_file}, {"sha256", run.model_sha256}}}};
  json["summary"] = Json::array();
  for (const EvaluationSummary& summary : SummariseCases(cases)) {
    json["summary"].push_back(SummaryJson(summary));
  }
  json["cases"] = Json::array();
  for (const EvaluatedCase& one : cases) json["cases"].push_back(CaseJson(one));
  WriteFileAtomically(run.output, json.dump(1) + "\n");
}

Vector6d ParseSix(const JsonObject& object, const std::string& key) {
  const std::vector<double> values = object.Numbers(key);
  if (values.size() != 6) {
    throw DataError(
        fmt::format("{}: {} has {} numbers, not 6", object.where(), key, values.size()));
  }
  return Eigen::Map<const Vector6d>(values.data());
}

EvaluatedSensor::Errors ParseErrors(const JsonObject& object) {
  const auto pose = [&](const char* key) {
    const JsonObject child = object.Child(key);
    const PoseError error{child.Number("translation_m"), child.Number("rotation_deg")};
    child.RejectOthers();
    return error;
  };
  EvaluatedSensor::Errors errors{pose("initial"), pose("refined"), ParseSix(object, "delta")};
  object.RejectOthers();
  return errors;
}

EvaluatedSensor ParseEvaluatedSensor(const JsonObject& object) {
  EvaluatedSensor sensor;
  sensor.name = object.Text("name");
  sensor.status = object.Text("status");
  if (object.Has("code")) sensor.code = object.Text("code");
  if (object.Has("sides_fix_pose")) sensor.sides_fix_pose = object.Bool("sides_fix_pose");
  if (sensor.placed()) {
    sensor.sides = object.Int("sides");
    sensor.initial_rms_to_structure_m = object.Number("initial_rms_to_structure_m");
    sensor.rms_to_structure_m = object.Number("rms_to_structure_m");
    sensor.inlier_share = object.Number("inlier_share");
    sensor.sigma = ParseSix(object, "sigma");
    if (object.Has("error")) sensor.nominal = ParseErrors(object.Child("error"));
    if (object.Has("error_as_built")) sensor.built = ParseErrors(object.Child("error_as_built"));
  }
  object.RejectOthers();
  return sensor;
}

ErrorStatistics StatisticsOf(const std::vector<double>& values) {
  if (values.empty()) return {};
  const Summary summary = Summarise(values);
  return {summary.median, summary.p95, *std::max_element(values.begin(), values.end())};
}

bool IsLost(const EvaluatedSensor& sensor) {
  return !sensor.placed() && sensor.sides_fix_pose.value_or(false);
}

bool IsWrong(const EvaluatedSensor& sensor) {
  return sensor.nominal && (sensor.nominal->refined.translation_m > kWrongM ||
                            sensor.nominal->refined.rotation_deg > kWrongDeg);
}

/// Gathers sensors into a summary.
class Tally {
 public:
  Tally(std::string rig, std::string sensors, std::string variant) {
    summary_.rig = std::move(rig);
    summary_.sensors = std::move(sensors);
    summary_.variant = std::move(variant);
  }

  void Add(const EvaluatedSensor& sensor) {
    ++summary_.count;
    if (sensor.sides_fix_pose.value_or(false)) ++summary_.fixable;
    if (IsLost(sensor)) ++summary_.lost;
    if (IsWrong(sensor)) ++summary_.wrong;
    if (!sensor.placed()) return;
    ++summary_.placed;
    if (sensor.status == "weak") ++summary_.weak;
    if (!sensor.nominal) return;
    ++summary_.measured;
    nominal_.Add(*sensor.nominal, sensor.sigma);
    built_.Add(sensor.built.value_or(*sensor.nominal), sensor.sigma);
  }

  EvaluationSummary Result() const {
    EvaluationSummary out = summary_;
    out.initial_mm = StatisticsOf(nominal_.initial_mm);
    out.initial_deg = StatisticsOf(nominal_.initial_deg);
    out.refined_mm = StatisticsOf(nominal_.refined_mm);
    out.refined_deg = StatisticsOf(nominal_.refined_deg);
    out.built_initial_mm = StatisticsOf(built_.initial_mm);
    out.built_initial_deg = StatisticsOf(built_.initial_deg);
    out.built_refined_mm = StatisticsOf(built_.refined_mm);
    out.built_refined_deg = StatisticsOf(built_.refined_deg);
    const double components = std::max(1, 6 * summary_.measured);
    out.cover68 = nominal_.in68 / components;
    out.cover95 = nominal_.in95 / components;
    out.built_cover68 = built_.in68 / components;
    out.built_cover95 = built_.in95 / components;
    return out;
  }

 private:
  struct Values {
    std::vector<double> initial_mm, initial_deg, refined_mm, refined_deg;
    int in68 = 0, in95 = 0;

    void Add(const EvaluatedSensor::Errors& errors, const Vector6d& sigma) {
      initial_mm.push_back(1000 * errors.initial.translation_m);
      initial_deg.push_back(errors.initial.rotation_deg);
      refined_mm.push_back(1000 * errors.refined.translation_m);
      refined_deg.push_back(errors.refined.rotation_deg);
      for (int i = 0; i < 6; ++i) {
        const double off = std::abs(errors.delta[i]);
        in68 += off <= kSigma68 * sigma[i];
        in95 += off <= kSigma95 * sigma[i];
      }
    }
  };

  EvaluationSummary summary_;
  Values nominal_, built_;
};

bool HasTruth(const EvaluatedCase& one) {
  return std::any_of(one.results.begin(), one.results.end(), [](const EvaluatedSensor& sensor) {
    return sensor.nominal || sensor.sides_fix_pose;
  });
}

std::string Cell(const ErrorStatistics& s, int count, int digits) {
  if (count == 0) return "-";
  return fmt::format("{:.{}f} / {:.{}f} / {:.{}f}", s.median, digits, s.p95, digits, s.max, digits);
}

std::string Percent(double share, int count) {
  return count == 0 ? "-" : fmt::format("{:.0f} %", 100 * share);
}

std::string SummaryTables(const std::vector<EvaluationSummary>& summaries) {
  std::string text =
      "Errors of placed sensors, median / 95 % / largest. As built: in the frame in which the "
      "boxes' "
      "own displacements average out.\n\n"
      "| rig | sensors | variant | initial, mm | deg | refined, mm | deg | as built, mm | deg |\n"
      "|---|---|---|---|---|---|---|---|---|\n";
  for (const EvaluationSummary& s : summaries) {
    text += fmt::format("| {} | {} | {} | {} | {} | {} | {} | {} | {} |\n", s.rig, s.sensors,
                        s.variant, Cell(s.initial_mm, s.measured, 1),
                        Cell(s.initial_deg, s.measured, 2), Cell(s.refined_mm, s.measured, 1),
                        Cell(s.refined_deg, s.measured, 2), Cell(s.built_refined_mm, s.measured, 1),
                        Cell(s.built_refined_deg, s.measured, 2));
  }
  text +=
      "\nLost: failed although the sides in view fix a pose. Wrong: placed more than 10 cm or 5 "
      "deg "
      "off. Intervals: share of the pose components (three of translation, three of rotation) "
      "within "
      "the covariance's 68 % and 95 % intervals.\n\n"
      "| rig | sensors | variant | placed | weak | lost | wrong | 68 % | 95 % | 68 %, as built | "
      "95 %, as built |\n|---|---|---|---|---|---|---|---|---|---|---|\n";
  for (const EvaluationSummary& s : summaries) {
    text += fmt::format("| {} | {} | {} | {} of {} | {} | {} of {} | {} | {} | {} | {} | {} |\n",
                        s.rig, s.sensors, s.variant, s.placed, s.count, s.weak, s.lost, s.fixable,
                        s.wrong, Percent(s.cover68, s.measured), Percent(s.cover95, s.measured),
                        Percent(s.built_cover68, s.measured), Percent(s.built_cover95, s.measured));
  }
  return text;
}

/// Sensors that were lost or placed wrong, so that one can look at them.
std::string Culprits(const std::vector<EvaluatedCase>& cases) {
  std::string text;
  for (const EvaluatedCase& one : cases) {
    for (const EvaluatedSensor& sensor : one.results) {
      const bool lost = IsLost(sensor), wrong = IsWrong(sensor);
      if (!lost && !wrong) continue;
      text +=
          fmt::format("- {} {}{}, {}, sensor {}: ", one.rig, one.sensors,
                      one.seed ? fmt::format(" seed {}", *one.seed) : "", one.variant, sensor.name);
      text += lost ? fmt::format("lost ({})\n", sensor.code)
                   : fmt::format("{}, but {:.0f} mm and {:.1f} deg off\n", sensor.status,
                                 1000 * sensor.nominal->refined.translation_m,
                                 sensor.nominal->refined.rotation_deg);
    }
  }
  return text.empty() ? text : "\nLost or wrong:\n\n" + text;
}

std::string CaptureTable(const std::vector<const EvaluatedCase*>& cases) {
  std::string text =
      "| capture | sensor | variant | status | sides | initial RMS to the structure, mm | refined "
      "| "
      "within 3 cm |\n|---|---|---|---|---|---|---|---|\n";
  for (const EvaluatedCase* one : cases) {
    for (const EvaluatedSensor& sensor : one->results) {
      const std::string head =
          fmt::format("| {} | {} | {} | {}{}{} ", one->rig, sensor.name, one->variant,
                      sensor.status, sensor.code.empty() ? "" : ", ", sensor.code);
      text += sensor.placed()
                  ? fmt::format("{}| {} | {:.1f} | {:.1f} | {:.0f} % |\n", head, sensor.sides,
                                1000 * sensor.initial_rms_to_structure_m,
                                1000 * sensor.rms_to_structure_m, 100 * sensor.inlier_share)
                  : head + "| - | - | - | - |\n";
    }
  }
  return text;
}

}  // namespace

Vector6d LeftDifference(const Pose& from, const Pose& to) {
  const Eigen::Matrix3d rotation = to.linear() * from.linear().transpose();
  Vector6d delta;
  delta << to.translation() - rotation * from.translation(), RotationLog(rotation);
  return delta;
}

EvaluationStill StillOf(const RigCapture& capture) {
  EvaluationStill still;
  still.structure = capture.structure;
  for (const CapturedSensor& sensor : capture.sensors) {
    SensorFrame frame;
    frame.name = sensor.name;
    frame.depth = sensor.depth;
    frame.intrinsics = sensor.intrinsics;
    if (capture.structure_present) frame.ground_truth = sensor.structure_from_sensor;
    still.frames.push_back(std::move(frame));
    still.labels.push_back(sensor.labels);
  }
  const Structure built = capture.structure.Displaced(capture.box_offsets, capture.size_scale);
  still.nominal_from_built =
      AlignPoints(Corners(built), Corners(capture.structure)).target_from_source;
  return still;
}

EvaluationItem RigItem(const std::string& name, Rig rig, const std::string& sensors,
                       DepthRenderer* renderer) {
  EvaluationItem item;
  item.rig = name;
  item.sensors = sensors.empty() ? kAsTheRig : sensors;
  item.seed = rig.seed;
  if (!sensors.empty()) {
    for (RigSensor& sensor : rig.sensors) {
      sensor.sensor = sensors;
      sensor.image_size.clear();
    }
  }
  item.identity =
      WriteConfig(rig) + ReadStructure(rig.structure).Hash() + Sha256(ReadFile(rig.intrinsics));
  item.load = [rig, renderer] { return StillOf(RenderRig(rig, *renderer)); };
  return item;
}

EvaluationItem CaptureItem(const std::filesystem::path& path, const Structure& structure) {
  const Capture capture = ReadCapture(path);
  EvaluationItem item;
  item.rig = path.string();
  item.identity = Sha256(ReadFile(path));
  for (const SensorFrame& frame : capture.sensors) {
    for (const std::string& file : frame.depth_files) {
      item.identity += Sha256(ReadFile(path.parent_path() / file));
    }
  }
  EvaluationStill still;
  still.structure = capture.structure ? ReadStructure(capture.structure->string()) : structure;
  item.identity += still.structure.Hash();
  still.frames = capture.sensors;
  item.load = [still] { return still; };
  return item;
}

std::vector<EvaluatedCase> EvaluateStill(const EvaluationStill& still,
                                         const std::vector<EvaluationVariant>& variants,
                                         Segmenter& segmenter) {
  SharedSegmenter shared(&segmenter);
  std::vector<EvaluatedCase> cases;
  for (const EvaluationVariant& variant : variants) {
    const CalibrationResult calibration =
        Calibrate(still.frames, still.structure, shared, variant.options);
    EvaluatedCase one;
    one.variant = variant.name;
    one.timings_s = {calibration.timings_s.begin(), calibration.timings_s.end()};
    for (std::size_t i = 0; i < calibration.sensors.size(); ++i) {
      const SensorResult& from = calibration.sensors[i];
      EvaluatedSensor sensor;
      sensor.name = from.name;
      sensor.status = ToString(from.status);
      sensor.code = ToString(from.code);
      if (i < still.labels.size()) {
        sensor.sides_fix_pose =
            SeesAPose(still.structure, still.labels[i], variant.options.initial);
      }
      if (from.structure_from_sensor) {
        sensor.sides = static_cast<int>(from.sides.size());
        sensor.initial_rms_to_structure_m = from.initial_rms_to_structure_m;
        sensor.rms_to_structure_m = from.rms_to_structure_m;
        sensor.inlier_share = from.inlier_share;
        sensor.sigma = from.covariance.diagonal().cwiseSqrt();
        if (const std::optional<Pose>& truth = still.frames[i].ground_truth) {
          sensor.nominal = ErrorsOf(from, *truth);
          sensor.built = ErrorsOf(from, still.nominal_from_built * *truth);
        }
      }
      one.results.push_back(std::move(sensor));
    }
    cases.push_back(std::move(one));
  }
  return cases;
}

std::vector<EvaluationSummary> SummariseCases(const std::vector<EvaluatedCase>& cases) {
  using Key = std::array<std::string, 3>;
  std::vector<Key> order;
  std::map<Key, Tally> tallies;
  std::vector<std::string> rigs, models, variants;
  const auto note = [](const std::string& name, std::vector<std::string>* names) {
    if (std::find(names->begin(), names->end(), name) == names->end()) names->push_back(name);
  };
  std::vector<const EvaluatedCase*> with_truth;
  for (const EvaluatedCase& one : cases) {
    if (!HasTruth(one)) continue;
    with_truth.push_back(&one);
    note(one.rig, &rigs);
    note(one.sensors, &models);
    note(one.variant, &variants);
  }
  const auto open = [&](const Key& key) {
    if (tallies.emplace(key, Tally(key[0], key[1], key[2])).second) order.push_back(key);
  };
  for (const std::string& rig : rigs) {
    for (const std::string& model : models) {
      for (const std::string& variant : variants) open({rig, model, variant});
    }
  }
  if (rigs.size() > 1) {
    for (const std::string& model : models) {
      for (const std::string& variant : variants) open({kAllRigs, model, variant});
    }
  }
  if (models.size() > 1) {
    for (const std::string& variant : variants) open({kAllRigs, kAllSensors, variant});
  }
  for (const EvaluatedCase* one : with_truth) {
    for (const Key& key :
         {Key{one->rig, one->sensors, one->variant}, Key{kAllRigs, one->sensors, one->variant},
          Key{kAllRigs, kAllSensors, one->variant}}) {
      const auto tally = tallies.find(key);
      if (tally == tallies.end()) continue;
      for (const EvaluatedSensor& sensor : one->results) tally->second.Add(sensor);
    }
  }
  std::vector<EvaluationSummary> summaries;
  for (const Key& key : order) {
    const EvaluationSummary summary = tallies.at(key).Result();
    if (summary.count > 0) summaries.push_back(summary);
  }
  return summaries;
}

std::vector<EvaluatedCase> ReadEvaluation(const std::filesystem::path& path) {
  const std::string name = path.string();
  const nlohmann::json document = ParseStrictJson(ReadFile(path), name);
  const JsonObject root(document, name);
  if (!root.Has("format") || root.Text("format") != kEvaluationFormat) {
    throw DataError(
        fmt::format("{}: this is no \"{}\"; choose another folder", name, kEvaluationFormat));
  }
  std::vector<EvaluatedCase> cases;
  for (const JsonObject& object : root.Children("cases")) {
    EvaluatedCase one;
    one.fingerprint = object.Text("fingerprint");
    one.rig = object.Text("rig");
    if (object.Has("sensor_model")) one.sensors = object.Text("sensor_model");
    if (object.Has("seed")) one.seed = object.Get("seed").get<std::uint64_t>();
    one.variant = object.Text("variant");
    for (const JsonObject& sensor : object.Children("sensors")) {
      one.results.push_back(ParseEvaluatedSensor(sensor));
    }
    const JsonObject timings = object.Child("timings_s");
    for (const std::string& stage : timings.Keys()) {
      one.timings_s[stage] = timings.Number(stage);
    }
    object.RejectOthers();
    cases.push_back(std::move(one));
  }
  return cases;
}

std::vector<EvaluatedCase> Evaluate(const std::vector<EvaluationItem>& items,
                                    const std::vector<EvaluationVariant>& variants,
                                    Segmenter& segmenter, const Structure& structure,
                                    const EvaluateRun& run) {
  std::map<std::string, EvaluatedCase> known;
  if (std::filesystem::exists(run.output)) {
    for (EvaluatedCase& one : ReadEvaluation(run.output)) {
      const std::string fingerprint = one.fingerprint;
      known[fingerprint] = std::move(one);
    }
  }
  std::vector<std::vector<std::string>> fingerprints(items.size());
  for (std::size_t i = 0; i < items.size(); ++i) {
    for (const EvaluationVariant& variant : variants) {
      fingerprints[i].push_back(Fingerprint(items[i], variant, run));
    }
  }
  const auto done = [&] {
    std::vector<EvaluatedCase> cases;
    for (const std::vector<std::string>& item : fingerprints) {
      for (const std::string& fingerprint : item) {
        const auto found = known.find(fingerprint);
        if (found != known.end()) cases.push_back(found->second);
      }
    }
    return cases;
  };

  std::size_t made = 0;
  const auto start = std::chrono::steady_clock::now();
  for (std::size_t i = 0; i < items.size(); ++i) {
    const EvaluationItem& item = items[i];
    std::vector<EvaluationVariant> missing;
    std::vector<std::string> missing_fingerprints;
    for (std::size_t j = 0; j < variants.size(); ++j) {
      if (known.count(fingerprints[i][j])) continue;
      missing.push_back(variants[j]);
      missing_fingerprints.push_back(fingerprints[i][j]);
    }
    if (!missing.empty()) {
      const EvaluationStill still = item.load();
      if (still.structure.SideNames() != structure.SideNames()) {
        throw DataError(fmt::format(
            "{}: the structure \"{}\" has other sides than \"{}\", which the network knows; train "
            "a network for it",
            item.rig, still.structure.name(), structure.name()));
      }
      std::vector<EvaluatedCase> fresh = EvaluateStill(still, missing, segmenter);
      for (std::size_t j = 0; j < fresh.size(); ++j) {
        fresh[j].fingerprint = missing_fingerprints[j];
        fresh[j].rig = item.rig;
        fresh[j].sensors = item.sensors;
        fresh[j].seed = item.seed;
        known[missing_fingerprints[j]] = std::move(fresh[j]);
      }
      ++made;
      WriteEvaluation(run, done());
    }
    if (!run.progress) continue;
    std::string placed;
    for (const std::string& fingerprint : fingerprints[i]) {
      const EvaluatedCase& one = known.at(fingerprint);
      placed +=
          fmt::format("{}{} {}/{}", placed.empty() ? "" : ", ", one.variant,
                      std::count_if(one.results.begin(), one.results.end(),
                                    [](const EvaluatedSensor& sensor) { return sensor.placed(); }),
                      one.results.size());
    }
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
    const double left = elapsed.count() / static_cast<double>(std::max<std::size_t>(made, 1)) *
                        static_cast<double>(items.size() - i - 1);
    run.progress(fmt::format(
        "[{}/{}] {}{}{}{}: placed by {}{}", i + 1, items.size(), item.rig,
        item.sensors.empty() ? "" : " ", item.sensors,
        item.seed ? fmt::format(" seed {}", *item.seed) : "", placed,
        missing.empty() ? " (done before)" : fmt::format("; about {:.0f} s left", left)));
  }
  const std::vector<EvaluatedCase> cases = done();
  WriteEvaluation(run, cases);
  return cases;
}

std::string FormatEvaluation(const std::vector<EvaluatedCase>& cases) {
  std::string text;
  const std::vector<EvaluationSummary> summaries = SummariseCases(cases);
  if (!summaries.empty()) text += SummaryTables(summaries) + Culprits(cases);
  std::vector<const EvaluatedCase*> captures;
  for (const EvaluatedCase& one : cases) {
    if (one.sensors.empty()) captures.push_back(&one);
  }
  if (!captures.empty()) text += (text.empty() ? "" : "\n") + CaptureTable(captures);
  return text;
}

std::vector<std::uint64_t> ParseSeeds(const std::string& text) {
  const auto fail = [&]() -> ConfigError {
    return ConfigError(fmt::format(
        "--seeds {}: FIRST:END (END not included), or numbers with commas, e.g. 1000:1020", text));
  };
  const auto number = [&](const std::string& part) {
    if (part.empty() || part.size() > 18 ||
        !std::all_of(part.begin(), part.end(), [](unsigned char c) { return std::isdigit(c); })) {
      throw fail();
    }
    return static_cast<std::uint64_t>(std::stoull(part));
  };
  std::vector<std::uint64_t> seeds;
  const std::size_t colon = text.find(':');
  if (colon != std::string::npos) {
    const std::uint64_t first = number(text.substr(0, colon)), end = number(text.substr(colon + 1));
    constexpr std::uint64_t kMost = 1000000;
    if (end <= first || end - first > kMost) throw fail();
    for (std::uint64_t seed = first; seed < end; ++seed) seeds.push_back(seed);
    return seeds;
  }
  std::set<std::uint64_t> unique;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t comma = std::min(text.find(',', begin), text.size());
    seeds.push_back(number(text.substr(begin, comma - begin)));
    if (!unique.insert(seeds.back()).second) throw fail();
    begin = comma + 1;
  }
  return seeds;
}

}  // namespace volalign
