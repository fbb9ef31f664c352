#include <fmt/format.h>

#include <cstddef>
#include <string>
#include <vector>

#include "core/base/text.h"
#include "core/json/json_archive.h"
#include "infer/evaluate/suite/table_data.h"

namespace volalign {

namespace {

constexpr const char* kColumns[4] = {"Mean", "STD", "RSD", "to best"};

/// Our four cells of a block in the paper's form; "-" for none.
std::vector<std::string> Cells(const TableCell& cell, SuiteMetric metric) {
  if (!cell.applicable) return {"N/A", "N/A", "N/A", "N/A"};
  if (cell.values.empty()) return {"-", "-", "-", "-"};
  const ColumnStatistics& c = cell.column;
  const std::string distance = cell.distance ? fmt::format("{:+.2f}%", 100 * *cell.distance) : "-";
  const bool percent = InPercent(metric);
  const auto number = [&](double x) {
    return percent ? fmt::format("{:.2f}%", 100 * x) : fmt::format("{:.4f}", x);
  };
  if (c.count < 2) return {number(c.mean), "-", "-", distance};  // one value has no spread
  return {number(c.mean), number(c.std), fmt::format("{:.{}f}%", 100 * c.rsd, percent ? 1 : 2),
          distance};
}

std::string Floor(const TableCell& cell, SuiteMetric metric) {
  if (!cell.floor) return "-";
  return InPercent(metric) ? fmt::format("{:.2f}%", 100 * *cell.floor)
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

std::string FormatCsv(const TableData& data) {
  std::string text =
      "row,method,stage,block,metric,count,mean,std,rsd,rsd_within,to_best,floor,paper_mean,"
      "paper_std,paper_rsd,paper_to_best,views,lost,measured,wrong,mean_mm,median_mm,mean_deg,"
      "median_deg,miou_of_truth\n";
  const auto optional = [](const std::optional<double>& value) {
    return value ? fmt::format("{}", *value) : std::string();
  };
  for (const TableRowData& row : data.rows) {
    for (std::size_t b = 0; b < row.cells.size(); ++b) {
      const SuiteBlock& block = data.table.blocks[b];
      const TableCell& cell = row.cells[b];
      const TableTruth& t = row.truth[b];
      const bool any = !cell.values.empty();
      const auto number = [](bool present, double value) {
        return present ? fmt::format("{}", value) : std::string();
      };
      text += fmt::format("{},{},{},{},{},{},", CsvQuoted(row.row.label), row.row.method,
                          ToString(row.row.stage), CsvQuoted(block.title), ToString(block.metric),
                          cell.values.size());
      text += fmt::format("{},{},{},{},{},{},", number(any, cell.column.mean),
                          number(any, cell.column.std), number(any, cell.column.rsd),
                          optional(cell.column.rsd_within), optional(cell.distance),
                          optional(cell.floor));
      for (std::size_t c = 0; c < 4; ++c) text += Paper(row.row, b, c) + ",";
      const bool errors = t.measured > 0;
      text += fmt::format("{},{},{},{},{},{},{},{},{}\n", t.views, t.lost, t.measured, t.wrong,
                          number(errors, t.mean_mm), number(errors, t.median_mm),
                          number(errors, t.mean_deg), number(errors, t.median_deg),
                          optional(t.miou_of_truth));
    }
  }
  return text;
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

std::string FormatTableJson(const TableData& data) {
  return WriteDescribed(data, data.table.name + ".json", 1);
}

}  // namespace volalign
