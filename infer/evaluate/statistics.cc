#include "infer/evaluate/statistics.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>

#include "core/geometry/metrics.h"

namespace volalign {

namespace {

constexpr char kAllRigs[] = "all rigs", kAllSensors[] = "all";
constexpr double kWrongM = 0.1, kWrongDeg = 5;
// Half widths, in standard deviations, of a normal distribution's central intervals.
constexpr double kSigma68 = 0.994457883, kSigma95 = 1.959963985;

ErrorStatistics StatisticsOf(const std::vector<double>& values) {
  if (values.empty()) return {};
  const Summary summary = Summarise(values);
  return {summary.median, summary.p95, *std::max_element(values.begin(), values.end())};
}

/// Rig, sensors, number of placements, variant.
using Key = std::tuple<std::string, std::string, int, std::string>;

/// Gathers sensors into a summary.
class Tally {
 public:
  explicit Tally(const Key& key) {
    std::tie(summary_.rig, summary_.sensors, summary_.placements, summary_.variant) = key;
  }

  void Add(const EvaluatedSensor& sensor) {
    ++summary_.count;
    if (sensor.sides_fix_pose.value_or(false)) ++summary_.fixable;
    if (IsLost(sensor)) ++summary_.lost;
    if (IsWrong(sensor)) ++summary_.wrong;
    if (!sensor.placed()) return;
    ++summary_.placed;
    if (sensor.status == SensorStatus::kWeak) ++summary_.weak;
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

    void Add(const EvaluatedErrors& errors, const Vector6d& sigma) {
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

/// Keeps values in order of appearance.
template <class T>
void Note(const T& value, std::vector<T>* seen) {
  if (std::find(seen->begin(), seen->end(), value) == seen->end()) seen->push_back(value);
}

/// The rows of a summary, in order.
std::vector<Key> SummaryRows(const std::vector<const EvaluatedCase*>& cases) {
  std::vector<std::string> rigs, models;
  std::vector<std::pair<int, std::string>> settings;  // number of placements, variant
  for (const EvaluatedCase* one : cases) {
    Note(one->rig, &rigs);
    Note(one->sensors, &models);
    Note({one->placements, one->variant}, &settings);
  }
  if (rigs.size() > 1) rigs.emplace_back(kAllRigs);
  std::vector<Key> rows;
  for (const std::string& rig : rigs) {
    for (const std::string& model : models) {
      for (const auto& [count, variant] : settings) {
        rows.emplace_back(rig, model, count, variant);
      }
    }
  }
  if (models.size() > 1) {
    for (const auto& [count, variant] : settings) {
      rows.emplace_back(kAllRigs, kAllSensors, count, variant);
    }
  }
  return rows;
}

}  // namespace

bool IsLost(const EvaluatedSensor& sensor) {
  return !sensor.placed() && sensor.sides_fix_pose.value_or(false);
}

bool IsWrong(const PoseError& error) {
  return error.translation_m > kWrongM || error.rotation_deg > kWrongDeg;
}

bool IsWrong(const EvaluatedSensor& sensor) {
  return sensor.nominal && IsWrong(sensor.nominal->refined);
}

std::vector<EvaluationSummary> SummariseCases(const std::vector<EvaluatedCase>& cases) {
  std::vector<const EvaluatedCase*> with_truth;
  for (const EvaluatedCase& one : cases) {
    if (HasTruth(one)) with_truth.push_back(&one);
  }
  const std::vector<Key> rows = SummaryRows(with_truth);
  std::map<Key, Tally> tallies;
  for (const Key& key : rows) tallies.emplace(key, Tally(key));
  for (const EvaluatedCase* one : with_truth) {
    for (const Key& key : {Key{one->rig, one->sensors, one->placements, one->variant},
                           Key{kAllRigs, one->sensors, one->placements, one->variant},
                           Key{kAllRigs, kAllSensors, one->placements, one->variant}}) {
      const auto tally = tallies.find(key);
      if (tally == tallies.end()) continue;
      for (const EvaluatedSensor& sensor : one->results) tally->second.Add(sensor);
    }
  }
  std::vector<EvaluationSummary> summaries;
  for (const Key& key : rows) {
    const EvaluationSummary summary = tallies.at(key).Result();
    if (summary.count > 0) summaries.push_back(summary);
  }
  return summaries;
}

}  // namespace volalign
