#include "infer/evaluate/suite/table_data.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <map>

#include "core/json/json_archive.h"
#include "core/json/table.h"
#include "infer/evaluate/statistics.h"
#include "infer/evaluate/suite/methods.h"

namespace volalign {

namespace {

bool OfCaptures(SuiteMetric metric) {
  return metric == SuiteMetric::kD1 || metric == SuiteMetric::kD2;
}

/// The larger, the better, and in percent: the paper prints them so.
bool IsShare(SuiteMetric metric) { return metric == SuiteMetric::kMiouAuthors; }

std::optional<double> Value(SuiteMetric metric, const PoseScore& score) {
  switch (metric) {
    case SuiteMetric::kMiouAuthors:
      return score.miou_authors;
    case SuiteMetric::kRmse:
      return score.rmse_m;
    case SuiteMetric::kD1:
    case SuiteMetric::kD2:
      break;
  }
  return std::nullopt;
}

/// A method's captures of a block that have the stage, and its index there.
struct StageOfCapture {
  const CaptureScores* capture;
  std::size_t stage;
};
std::vector<StageOfCapture> Select(const SuiteRow& row, const SuiteBlock& block,
                                   const std::vector<CaptureScores>& scores) {
  std::vector<StageOfCapture> selected;
  for (const std::string& dataset : block.datasets) {
    for (const CaptureScores& capture : scores) {
      if (capture.dataset != dataset || capture.method != row.method) continue;
      for (std::size_t s = 0; s < capture.stages.size(); ++s) {
        if (capture.stages[s].stage == ToString(row.stage)) selected.push_back({&capture, s});
      }
    }
  }
  return selected;
}

double MeanOf(const std::vector<double>& values) { return Summarise(values).mean; }

TableCell MakeCell(SuiteMetric metric, const std::vector<StageOfCapture>& selected) {
  TableCell cell;
  std::vector<int> groups;
  std::vector<double> floors;
  std::map<std::string, int> set_ups;
  for (const auto& [capture, stage] : selected) {
    const int group =
        set_ups.emplace(capture->set_up, static_cast<int>(set_ups.size())).first->second;
    const auto add = [&](const std::optional<double>& value, std::vector<double>* values) {
      if (!value) return;
      values->push_back(*value);
      if (values == &cell.values) groups.push_back(group);
    };
    if (OfCaptures(metric)) {
      const bool first = metric == SuiteMetric::kD1;
      const StageScores& of = capture->stages[stage];
      add(first ? of.d1_m : of.d2_m, &cell.values);
      add(first ? capture->d1_floor_m : capture->d2_floor_m, &floors);
      continue;
    }
    for (const ViewScores& view : capture->views) {
      const std::optional<PoseScore>& labels = view.stages.at(stage).labels;
      if (labels) add(Value(metric, *labels), &cell.values);
      if (view.floor) add(Value(metric, *view.floor), &floors);
    }
  }
  cell.column = Column(cell.values, groups);
  if (!floors.empty()) cell.floor = MeanOf(floors);
  return cell;
}

TableTruth MakeTruth(const std::vector<StageOfCapture>& selected) {
  TableTruth truth;
  std::vector<double> mm, deg, miou;
  for (const auto& [capture, stage] : selected) {
    for (const ViewScores& view : capture->views) {
      const ViewPoseScore& pose = view.stages.at(stage);
      ++truth.views;
      if (!pose.placed) ++truth.lost;
      if (view.miou_of_truth) miou.push_back(*view.miou_of_truth);
      if (!pose.error) continue;
      ++truth.measured;
      mm.push_back(1000 * pose.error->translation_m);
      deg.push_back(pose.error->rotation_deg);
      if (IsWrong(*pose.error)) ++truth.wrong;
    }
  }
  truth.mean_mm = Summarise(mm).mean;
  truth.median_mm = Summarise(mm).median;
  truth.mean_deg = Summarise(deg).mean;
  truth.median_deg = Summarise(deg).median;
  if (!miou.empty()) truth.miou_of_truth = MeanOf(miou);
  return truth;
}

void FillDistances(TableData* data) {
  for (std::size_t b = 0; b < data->table.blocks.size(); ++b) {
    std::optional<double> best;
    const bool more = IsShare(data->table.blocks[b].metric);
    for (const TableRowData& row : data->rows) {
      const TableCell& cell = row.cells[b];
      if (cell.values.empty() || row.row.paper.empty()) continue;
      if (!best || (more ? cell.column.mean > *best : cell.column.mean < *best))
        best = cell.column.mean;
    }
    for (TableRowData& row : data->rows) {
      TableCell& cell = row.cells[b];
      if (best && !cell.values.empty())
        cell.distance = *best == 0 ? 0 : cell.column.mean / *best - 1;
    }
  }
}

}  // namespace

TableData MakeTable(const SuiteConfig& suite, const SuiteTable& table,
                    const std::vector<CaptureScores>& scores) {
  TableData data{table, {}};
  for (const SuiteRow& row : table.rows) {
    TableRowData of;
    of.row = row;
    const auto method = std::find_if(suite.methods.begin(), suite.methods.end(),
                                     [&](const SuiteMethod& m) { return m.name == row.method; });
    of.has_model = HasModel(*method);
    for (const SuiteBlock& block : table.blocks) {
      const std::vector<StageOfCapture> selected = Select(row, block, scores);
      of.cells.push_back(MakeCell(block.metric, selected));
      of.cells.back().applicable =
          std::any_of(block.datasets.begin(), block.datasets.end(),
                      [&](const std::string& name) { return IsApplicable(*method, name); });
      of.truth.push_back(MakeTruth(selected));
    }
    data.rows.push_back(std::move(of));
  }
  FillDistances(&data);
  return data;
}

namespace {

constexpr const char* kColumns[4] = {"Mean", "STD", "RSD", "to best"};

/// Our four cells of a block in the paper's form; "-" for none.
std::vector<std::string> Cells(const TableCell& cell, SuiteMetric metric) {
  if (!cell.applicable) return {"N/A", "N/A", "N/A", "N/A"};
  if (cell.values.empty()) return {"-", "-", "-", "-"};
  const ColumnStatistics& c = cell.column;
  const std::string distance = cell.distance ? fmt::format("{:+.2f}%", 100 * *cell.distance) : "-";
  const bool percent = IsShare(metric);
  const auto number = [&](double x) {
    return percent ? fmt::format("{:.2f}%", 100 * x) : fmt::format("{:.4f}", x);
  };
  if (c.count < 2) return {number(c.mean), "-", "-", distance};  // one value has no spread
  return {number(c.mean), number(c.std), fmt::format("{:.{}f}%", 100 * c.rsd, percent ? 1 : 2),
          distance};
}

std::string Floor(const TableCell& cell, SuiteMetric metric) {
  if (!cell.floor) return "-";
  return IsShare(metric) ? fmt::format("{:.2f}%", 100 * *cell.floor)
                         : fmt::format("{:.4f}", *cell.floor);
}

/// The paper's cell of a row, or "".
std::string Paper(const SuiteRow& row, std::size_t block, std::size_t column) {
  return row.paper.empty() ? "" : row.paper.at(4 * block + column);
}

std::string Label(const TableRowData& row) {
  return row.row.label + (row.has_model ? "" : " (no model yet)");
}

std::string MainTable(const TableData& data) {
  std::string head = "| |", rule = "|---|";
  for (const SuiteBlock& block : data.table.blocks) {
    for (const char* column : kColumns) {
      head += fmt::format(" {} {} |", block.title, column);
      rule += "---|";
    }
    head += fmt::format(" {} floor |", block.title);
    rule += "---|";
  }
  std::string text = head + "\n" + rule + "\n";
  for (const TableRowData& row : data.rows) {
    text += fmt::format("| {} |", Label(row));
    for (std::size_t b = 0; b < row.cells.size(); ++b) {
      const SuiteMetric metric = data.table.blocks[b].metric;
      const std::vector<std::string> cells = Cells(row.cells[b], metric);
      for (std::size_t c = 0; c < cells.size(); ++c) {
        const std::string paper = Paper(row.row, b, c);
        text += fmt::format(" {}{} |", cells[c], paper.empty() ? "" : " (" + paper + ")");
      }
      text += fmt::format(" {} |", Floor(row.cells[b], metric));
    }
    text += "\n";
  }
  return text;
}

std::string TruthTable(const TableData& data) {
  std::string text =
      "| | views or captures | lost views | wrong views | mm, mean | median | deg, mean | median | "
      "labels' mIoU | RSD within set-ups |\n|---|---|---|---|---|---|---|---|---|---|\n";
  for (const TableRowData& row : data.rows) {
    for (std::size_t b = 0; b < row.cells.size(); ++b) {
      const TableTruth& truth = row.truth[b];
      if (truth.views == 0) continue;
      const std::string errors =
          truth.measured == 0 ? "- | - | - | -"
                              : fmt::format("{:.1f} | {:.1f} | {:.2f} | {:.2f}", truth.mean_mm,
                                            truth.median_mm, truth.mean_deg, truth.median_deg);
      text += fmt::format(
          "| {}, {} | {} | {} of {} | {} of {} | {} | {} | {} |\n", Label(row),
          data.table.blocks[b].title, row.cells[b].values.size(), truth.lost, truth.views,
          truth.wrong, truth.measured, errors,
          truth.miou_of_truth ? fmt::format("{:.2f}%", 100 * *truth.miou_of_truth) : "-",
          row.cells[b].column.rsd_within
              ? fmt::format("{:.2f}%", 100 * *row.cells[b].column.rsd_within)
              : "-");
    }
  }
  return text;
}

}  // namespace

std::string FormatMarkdown(const TableData& data) {
  std::string text = fmt::format("## {}: {}\n\n", data.table.name, data.table.title);
  if (!data.table.note.empty()) text += data.table.note + "\n\n";
  text +=
      "In brackets: the paper's figures, of its recordings. Floor: the same metric at the true "
      "poses on the same frames. To best: distance to the best mean among the paper's rows.\n\n";
  text += MainTable(data);
  text +=
      "\nThese columns compare with the true poses of rendering. Lost: no pose. Wrong: over 10 cm "
      "or 5 deg off. Errors of placed views, in the frame in which the boxes' own displacements "
      "average out. Labels' mIoU: the predicted against the true labels, over the classes present. "
      "RSD within set-ups: mean of the set-ups' own STD / mean, of those with several "
      "captures.\n\n";
  return text + TruthTable(data);
}

// The keys of table JSON.

template <class Archive>
void Describe(Archive& ar, ColumnStatistics& column) {
  ar("count", column.count);
  ar("mean", column.mean);
  ar("std", column.std);
  ar("rsd", column.rsd);
  ar.Optional("rsd_within", column.rsd_within);
}

template <class Archive>
void Describe(Archive& ar, TableCell& cell) {
  ar("applicable", cell.applicable);
  ar("column", cell.column);
  ar.Optional("to_best", cell.distance);
  ar.Optional("floor", cell.floor);
  ar("values", cell.values);
}

template <class Archive>
void Describe(Archive& ar, TableTruth& truth) {
  ar("views", truth.views);
  ar("lost", truth.lost);
  ar("measured", truth.measured);
  ar("wrong", truth.wrong);
  ar("mean_mm", truth.mean_mm);
  ar("median_mm", truth.median_mm);
  ar("mean_deg", truth.mean_deg);
  ar("median_deg", truth.median_deg);
  ar.Optional("miou_of_truth", truth.miou_of_truth);
}

template <class Archive>
void Describe(Archive& ar, TableRowData& row) {
  ar("label", row.row.label);
  ar("method", row.row.method);
  std::string stage = ToString(row.row.stage);
  ar("stage", stage);
  ar("paper", row.row.paper);
  ar("has_model", row.has_model);
  ar("blocks", row.cells);
  ar("truth", row.truth);
}

template <class Archive>
void Describe(Archive& ar, TableData& data) {
  ar("table", data.table.name);
  ar("title", data.table.title);
  ar("rows", data.rows);
}

std::string FormatTableCsv(const TableData& data) {
  Table csv;
  csv.columns = {"row",           "method",    "stage",      "block",      "metric",
                 "count",         "mean",      "std",        "rsd",        "rsd_within",
                 "to_best",       "floor",     "paper_mean", "paper_std",  "paper_rsd",
                 "paper_to_best", "views",     "lost",       "measured",   "wrong",
                 "mean_mm",       "median_mm", "mean_deg",   "median_deg", "miou_of_truth"};
  const auto given = [](bool present, double value) {
    return present ? Table::Cell(value) : Table::Cell();
  };
  const auto optional = [](const std::optional<double>& value) {
    return value ? Table::Cell(*value) : Table::Cell();
  };
  for (const TableRowData& row : data.rows) {
    for (std::size_t b = 0; b < row.cells.size(); ++b) {
      const SuiteBlock& block = data.table.blocks[b];
      const TableCell& cell = row.cells[b];
      const TableTruth& t = row.truth[b];
      const bool any = !cell.values.empty(), errors = t.measured > 0;
      csv.rows.push_back(
          {row.row.label, row.row.method, std::string(ToString(row.row.stage)), block.title,
           std::string(ToString(block.metric)), CellOf(cell.values.size()),
           given(any, cell.column.mean), given(any, cell.column.std), given(any, cell.column.rsd),
           optional(cell.column.rsd_within), optional(cell.distance), optional(cell.floor)});
      for (std::size_t c = 0; c < 4; ++c) csv.rows.back().emplace_back(Paper(row.row, b, c));
      for (const int count : {t.views, t.lost, t.measured, t.wrong})
        csv.rows.back().push_back(CellOf(count));
      for (const double error : {t.mean_mm, t.median_mm, t.mean_deg, t.median_deg})
        csv.rows.back().push_back(given(errors, error));
      csv.rows.back().push_back(optional(t.miou_of_truth));
    }
  }
  return FormatTable(csv, TableFormat::kCsv);
}

std::string FormatTableJson(const TableData& data) {
  return WriteDescribed(data, data.table.name + ".json", 1);
}

}  // namespace volalign
