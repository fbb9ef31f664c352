#include "infer/evaluate/suite/table_data.h"

#include <algorithm>
#include <cstddef>
#include <map>

#include "infer/evaluate/statistics.h"
#include "infer/evaluate/suite/method_set.h"

namespace volalign {

namespace {

bool OfCaptures(SuiteMetric metric) {
  return metric == SuiteMetric::kD1 || metric == SuiteMetric::kD2;
}

std::optional<double> Value(SuiteMetric metric, const PoseScore& score) {
  switch (metric) {
    case SuiteMetric::kMiouAuthors:
      return score.miou_authors;
    case SuiteMetric::kMiou:
      return score.miou;
    case SuiteMetric::kMiouAuthorsAll:
      return score.miou_authors_all;
    case SuiteMetric::kRmse:
      return score.rmse_m;
    case SuiteMetric::kRmseVisible:
      return score.rmse_visible_m;
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
    const bool more = MoreIsBetter(data->table.blocks[b].metric);
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

bool MoreIsBetter(SuiteMetric metric) {
  return metric == SuiteMetric::kMiouAuthors || metric == SuiteMetric::kMiou ||
         metric == SuiteMetric::kMiouAuthorsAll;
}

bool InPercent(SuiteMetric metric) { return MoreIsBetter(metric); }

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

}  // namespace volalign
