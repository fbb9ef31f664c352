#include "infer/evaluate/suite/write_suite.h"

#include <fmt/format.h>

#include <cstddef>
#include <limits>

#include "core/base/file_util.h"
#include "infer/evaluate/suite/box_plot.h"
#include "infer/evaluate/suite/table_data.h"

namespace volalign {

namespace {

void WriteBoxPlots(const std::filesystem::path& folder, const TableData& data) {
  for (std::size_t b = 0; b < data.table.blocks.size(); ++b) {
    const SuiteBlock& block = data.table.blocks[b];
    std::vector<PlotSeries> series;
    double floor = std::numeric_limits<double>::quiet_NaN();
    for (const TableRowData& row : data.rows) {
      series.push_back({row.row.label, row.cells[b].values});
      // Only a metric of points has the same floor for all methods.
      const bool of_points = block.metric == SuiteMetric::kD1 || block.metric == SuiteMetric::kD2;
      if (of_points && row.cells[b].floor) floor = *row.cells[b].floor;
    }
    const std::string unit = InPercent(block.metric) ? "" : ", m";
    WriteFileAtomically(
        folder / fmt::format("{}_{}_{}.svg", data.table.name, b + 1, WordOf(block.metric)),
        BoxPlotSvg(fmt::format("{}: {}", data.table.title, block.title),
                   WordOf(block.metric) + unit, series, floor));
  }
}

}  // namespace

std::string WriteSuite(const std::filesystem::path& folder, const SuiteConfig& suite,
                       const std::vector<CaptureScores>& scores) {
  std::string all;
  for (const SuiteTable& table : suite.tables) {
    const TableData data = MakeTable(suite, table, scores);
    const std::string markdown = FormatMarkdown(data);
    WriteFileAtomically(folder / (table.name + ".md"), markdown);
    WriteFileAtomically(folder / (table.name + ".csv"), FormatCsv(data));
    WriteFileAtomically(folder / (table.name + ".tex"), FormatLatex(data));
    WriteFileAtomically(folder / (table.name + ".json"), FormatTableJson(data));
    WriteBoxPlots(folder, data);
    all += (all.empty() ? "" : "\n") + markdown;
  }
  WriteFileAtomically(folder / "suite.md", all);
  WriteFileAtomically(folder / "suite.json", FormatScores(scores));
  return all;
}

}  // namespace volalign
