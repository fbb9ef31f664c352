#include "infer/evaluate/statistics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>

#include "core/geometry/metrics.h"

namespace volalign {

namespace {

constexpr char kAllRigs[] = "all rigs", kAllSensors[] = "all";
/// Columns of EvaluationTable: the last that every row has, and the first of each part.
constexpr std::size_t kVariant = 3, kErrors = 4, kCounts = 22, kOfCapture = 33;
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
    out.nominal = nominal_.Result();
    out.built = built_.Result();
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
    PoseStatistics Result() const {
      const double components = std::max<double>(1, 6.0 * static_cast<double>(initial_mm.size()));
      return {StatisticsOf(initial_mm),  StatisticsOf(initial_deg), StatisticsOf(refined_mm),
              StatisticsOf(refined_deg), in68 / components,         in95 / components};
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

Table EvaluationTable(const std::vector<EvaluatedCase>& cases) {
  Table table;
  table.columns = {"rig", "sensors", "placements", "variant"};
  const auto add_errors = [&](const std::string& key, const std::string& title, int digits) {
    table.columns.emplace_back(key + "_median", title, 1, digits);
    table.columns.emplace_back(key + "_p95", "95 %", 1, digits);
    table.columns.emplace_back(key + "_max", "max", 1, digits);
  };
  add_errors("initial_mm", "initial mm", 1);
  add_errors("initial_deg", "deg", 2);
  add_errors("refined_mm", "refined mm", 1);
  add_errors("refined_deg", "deg", 2);
  add_errors("built_refined_mm", "as built mm", 1);
  add_errors("built_refined_deg", "deg", 2);
  const std::vector<Table::Column> others = {"count",
                                             "placed",
                                             "weak",
                                             "fixable",
                                             "lost",
                                             "wrong",
                                             "measured",
                                             {"within_68", "68 %", 100, 0},
                                             {"within_95", "95 %", 100, 0},
                                             {"built_within_68", "68 % as built", 100, 0},
                                             {"built_within_95", "95 % as built", 100, 0},
                                             "capture",
                                             "sensor",
                                             "status",
                                             "code",
                                             "sides",
                                             {"initial_rms_mm", "initial RMS mm", 1, 1},
                                             {"rms_mm", "RMS mm", 1, 1},
                                             {"inliers", "inliers %", 100, 0}};
  table.columns.insert(table.columns.end(), others.begin(), others.end());
  for (const EvaluationSummary& s : SummariseCases(cases)) {
    std::vector<Table::Cell> row = {s.rig, s.sensors, CellOf(s.placements), s.variant};
    const auto measured = [&](double value) {
      return s.measured > 0 ? Table::Cell(value) : Table::Cell();
    };
    for (const ErrorStatistics* error :
         {&s.nominal.initial_mm, &s.nominal.initial_deg, &s.nominal.refined_mm,
          &s.nominal.refined_deg, &s.built.refined_mm, &s.built.refined_deg}) {
      for (const double value : {error->median, error->p95, error->max})
        row.push_back(measured(value));
    }
    for (const int count : {s.count, s.placed, s.weak, s.fixable, s.lost, s.wrong, s.measured})
      row.push_back(CellOf(count));
    for (const PoseStatistics* poses : {&s.nominal, &s.built}) {
      row.push_back(measured(poses->cover68));
      row.push_back(measured(poses->cover95));
    }
    row.resize(table.columns.size());
    table.rows.push_back(std::move(row));
  }
  for (const EvaluatedCase& one : cases) {
    if (!one.sensors.empty()) continue;
    for (const EvaluatedSensor& sensor : one.results) {
      std::vector<Table::Cell> row(kOfCapture);
      row[kVariant] = one.variant;
      row.insert(row.end(), {one.rig, sensor.name, ToString(sensor.status), ToString(sensor.code)});
      if (sensor.placed()) {
        row.insert(row.end(), {CellOf(sensor.sides), 1000 * sensor.initial_rms_to_structure_m,
                               1000 * sensor.rms_to_structure_m, sensor.inlier_share});
      }
      row.resize(table.columns.size());
      table.rows.push_back(std::move(row));
    }
  }
  return table;
}

namespace {

/// The rows that have a value in column `first`, with that column and the others before `end`; ""
/// without such rows.
std::string Part(Table table, std::size_t first, std::size_t end) {
  table.rows.erase(std::remove_if(table.rows.begin(), table.rows.end(),
                                  [&](const std::vector<Table::Cell>& row) {
                                    return std::holds_alternative<std::monostate>(row[first]);
                                  }),
                   table.rows.end());
  for (std::size_t i = kVariant + 1; i < table.columns.size(); ++i) {
    if (i < first || i >= end) table.columns[i].title.clear();
  }
  return table.rows.empty() ? "" : "\n" + FormatTable(table, TableFormat::kText);
}

/// Sensors that were lost or placed wrong.
std::string Culprits(const std::vector<EvaluatedCase>& cases) {
  std::string text;
  for (const EvaluatedCase& one : cases) {
    for (const EvaluatedSensor& sensor : one.results) {
      const bool lost = IsLost(sensor), wrong = IsWrong(sensor);
      if (!lost && !wrong) continue;
      text += fmt::format("- {} {}{}{}, {}, sensor {}: ", one.rig, one.sensors,
                          one.seed ? fmt::format(" seed {}", *one.seed) : "",
                          one.placements > 1 ? fmt::format(", {} placements", one.placements) : "",
                          one.variant, sensor.name);
      text += lost ? fmt::format("lost ({})\n", ToString(sensor.code))
                   : fmt::format("{}, but {:.0f} mm and {:.1f} deg off\n", ToString(sensor.status),
                                 1000 * sensor.nominal->refined.translation_m,
                                 sensor.nominal->refined.rotation_deg);
    }
  }
  return text.empty() ? text : "\nLost or wrong:\n\n" + text;
}

}  // namespace

std::string FormatEvaluation(const std::vector<EvaluatedCase>& cases) {
  const Table table = EvaluationTable(cases);
  std::string text;
  if (const std::string errors = Part(table, kErrors, kCounts); !errors.empty()) {
    text =
        "Errors of placed sensors: median, 95 %, largest. As built: in the frame in which the "
        "boxes' own displacements average out.\n" +
        errors;
  }
  if (const std::string counts = Part(table, kCounts, kOfCapture); !counts.empty()) {
    text +=
        "\nFixable: the sides in view fix a pose. Lost: failed although fixable. Wrong: placed "
        "more than 10 cm or 5 deg off. 68 %, 95 %: share of the pose components within these "
        "intervals of the covariance.\n" +
        counts;
  }
  return text + Culprits(cases) + Part(table, kOfCapture, table.columns.size());
}

}  // namespace volalign
