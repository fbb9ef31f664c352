#include "infer/evaluate/tables.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "infer/evaluate/statistics.h"

namespace volalign {

namespace {

std::string Cell(const ErrorStatistics& s, int count, int digits) {
  if (count == 0) return "-";
  return fmt::format("{:.{}f} / {:.{}f} / {:.{}f}", s.median, digits, s.p95, digits, s.max, digits);
}

std::string Percent(double share, int count) {
  return count == 0 ? "-" : fmt::format("{:.0f} %", 100 * share);
}

std::string SummaryTables(const std::vector<EvaluationSummary>& summaries) {
  // Placements have a column if a row has several.
  const bool several = std::any_of(summaries.begin(), summaries.end(),
                                   [](const EvaluationSummary& s) { return s.placements > 1; });
  const std::string head =
      several ? "| rig | sensors | placements | variant |" : "| rig | sensors | variant |";
  const std::string rule = several ? "|---|---|---|---|" : "|---|---|---|";
  const auto cells = [several](const EvaluationSummary& s) {
    return fmt::format("| {} | {} |{} {} |", s.rig, s.sensors,
                       several ? fmt::format(" {} |", s.placements) : "", s.variant);
  };
  std::string text =
      "Errors of placed sensors, median / 95 % / largest. As built: in the frame in which the "
      "boxes' "
      "own displacements average out.\n\n" +
      head + " initial, mm | deg | refined, mm | deg | as built, mm | deg |\n" + rule +
      "---|---|---|---|---|---|\n";
  for (const EvaluationSummary& s : summaries) {
    text += fmt::format("{} {} | {} | {} | {} | {} | {} |\n", cells(s),
                        Cell(s.initial_mm, s.measured, 1), Cell(s.initial_deg, s.measured, 2),
                        Cell(s.refined_mm, s.measured, 1), Cell(s.refined_deg, s.measured, 2),
                        Cell(s.built_refined_mm, s.measured, 1),
                        Cell(s.built_refined_deg, s.measured, 2));
  }
  text +=
      "\nLost: failed although the sides in view fix a pose. Wrong: placed more than 10 cm or 5 "
      "deg "
      "off. Intervals: share of the pose components (three of translation, three of rotation) "
      "within "
      "the covariance's 68 % and 95 % intervals.\n\n" +
      head + " placed | weak | lost | wrong | 68 % | 95 % | 68 %, as built | 95 %, as built |\n" +
      rule + "---|---|---|---|---|---|---|---|\n";
  for (const EvaluationSummary& s : summaries) {
    text += fmt::format("{} {} of {} | {} | {} of {} | {} | {} | {} | {} | {} |\n", cells(s),
                        s.placed, s.count, s.weak, s.lost, s.fixable, s.wrong,
                        Percent(s.cover68, s.measured), Percent(s.cover95, s.measured),
                        Percent(s.built_cover68, s.measured), Percent(s.built_cover95, s.measured));
  }
  return text;
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

std::string CaptureTable(const std::vector<const EvaluatedCase*>& cases) {
  std::string text =
      "| capture | sensor | variant | status | sides | initial RMS to the structure, mm | refined "
      "| "
      "on the structure |\n|---|---|---|---|---|---|---|---|\n";
  for (const EvaluatedCase* one : cases) {
    for (const EvaluatedSensor& sensor : one->results) {
      const std::string head = fmt::format(
          "| {} | {} | {} | {}{}{} ", one->rig, sensor.name, one->variant, ToString(sensor.status),
          sensor.code == SensorCode::kNone ? "" : ", ", ToString(sensor.code));
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

Table EvaluationTable(const std::vector<EvaluatedCase>& cases) {
  Table table;
  table.columns = {"rig", "sensors", "placements", "variant"};
  const std::vector<std::string> errors = {"initial_mm",  "initial_deg",      "refined_mm",
                                           "refined_deg", "built_refined_mm", "built_refined_deg"};
  for (const std::string& error : errors) {
    for (const char* of : {"_median", "_p95", "_max"}) table.columns.emplace_back(error + of);
  }
  for (const char* count : {"count", "placed", "weak", "fixable", "lost", "wrong", "measured",
                            "within_68", "within_95", "built_within_68", "built_within_95"})
    table.columns.emplace_back(count);
  const std::size_t of_summaries = table.columns.size();
  for (const char* of_capture :
       {"capture", "sensor", "status", "code", "sides", "initial_rms_mm", "rms_mm", "inliers"})
    table.columns.emplace_back(of_capture);
  for (const EvaluationSummary& s : SummariseCases(cases)) {
    std::vector<Table::Cell> row = {s.rig, s.sensors, CellOf(s.placements), s.variant};
    for (const ErrorStatistics* error :
         {&s.initial_mm, &s.initial_deg, &s.refined_mm, &s.refined_deg, &s.built_refined_mm,
          &s.built_refined_deg}) {
      for (const double value : {error->median, error->p95, error->max})
        row.push_back(s.measured > 0 ? Table::Cell(value) : Table::Cell());
    }
    for (const int count : {s.count, s.placed, s.weak, s.fixable, s.lost, s.wrong, s.measured})
      row.push_back(CellOf(count));
    for (const double share : {s.cover68, s.cover95, s.built_cover68, s.built_cover95})
      row.push_back(s.measured > 0 ? Table::Cell(share) : Table::Cell());
    row.resize(table.columns.size());
    table.rows.push_back(std::move(row));
  }
  for (const EvaluatedCase& one : cases) {
    if (!one.sensors.empty()) continue;
    for (const EvaluatedSensor& sensor : one.results) {
      std::vector<Table::Cell> row(table.columns.size());
      row[3] = one.variant;
      std::vector<Table::Cell> cells = {one.rig, sensor.name, ToString(sensor.status),
                                        ToString(sensor.code)};
      if (sensor.placed()) {
        cells.insert(cells.end(), {CellOf(static_cast<int>(sensor.sides)),
                                   1000 * sensor.initial_rms_to_structure_m,
                                   1000 * sensor.rms_to_structure_m, sensor.inlier_share});
      }
      std::move(cells.begin(), cells.end(),
                row.begin() + static_cast<std::ptrdiff_t>(of_summaries));
      table.rows.push_back(std::move(row));
    }
  }
  return table;
}

}  // namespace volalign
