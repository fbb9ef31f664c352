#include "infer/evaluate/suite/table_data.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace volalign::table_data_test {
namespace {

CaptureScores Capture(const std::string& set_up, const std::string& method, double d1,
                      const std::vector<double>& miou) {
  CaptureScores capture;
  capture.dataset = "arc";
  capture.set_up = set_up;
  capture.method = method;
  capture.stages = {{"initial", d1, 2 * d1}, {"graph", d1 / 2, d1}};
  capture.d1_floor_m = 0.01;
  for (const double value : miou) {
    ViewScores view;
    PoseScore labels;
    labels.miou_authors = value;
    view.floor = labels;
    view.floor->miou_authors = 1;
    view.stages.resize(2);
    view.stages[0] = {true, labels, PoseError{0.02, 0.5}};
    view.stages[1] = {true, labels, PoseError{0.2, 0.5}};
    capture.views.push_back(view);
  }
  ViewScores lost;
  lost.stages.resize(2);
  capture.views.push_back(lost);
  return capture;
}

SuiteConfig Suite() {
  SuiteConfig suite;
  SuiteMethod a, b, c;
  a.name = "a";
  a.kind = b.kind = MethodKind::kMarkers;
  b.name = "b";
  c.name = "c";
  c.model = "/no/such/model.pt";
  suite.methods = {a, b, c};
  SuiteTable table;
  table.name = "table5";
  table.title = "Dataset arc";
  table.blocks = {{"RMS", SuiteMetric::kD1, {"arc"}}, {"mIoU", SuiteMetric::kMiouAuthors, {"arc"}}};
  const std::vector<std::string> cells{"1%", "2", "3", "4", "5", "6", "7", "8"};
  table.rows = {{"first_row", "b", PoseStage::kInitial, cells},
                {"second", "a", PoseStage::kInitial, cells},
                {"ours", "a", PoseStage::kGraph, {}},
                {"none", "c", PoseStage::kInitial, cells}};
  suite.tables = {table};
  return suite;
}

std::vector<CaptureScores> Scores() {
  return {Capture("near", "a", 0.02, {0.5, 0.7}), Capture("far", "a", 0.04, {0.9}),
          Capture("far", "b", 0.06, {0.8})};
}

TEST(TableData, CellsAreThoseOfTheirCapturesAndViews) {
  const SuiteConfig suite = Suite();
  const TableData data = MakeTable(suite, suite.tables[0], Scores());
  ASSERT_EQ(data.rows.size(), 4u);
  const TableRowData& a = data.rows[1];
  EXPECT_EQ(a.cells[0].values, (std::vector<double>{0.02, 0.04}));
  EXPECT_EQ(a.cells[1].values, (std::vector<double>{0.5, 0.7, 0.9}));
  EXPECT_DOUBLE_EQ(a.cells[0].column.mean, 0.03);
  EXPECT_FALSE(a.cells[0].column.rsd_within.has_value());  // one capture of each set-up
  EXPECT_DOUBLE_EQ(*a.cells[0].floor, 0.01);
  EXPECT_DOUBLE_EQ(*a.cells[1].floor, 1);
  // The best of the paper's rows, not of ours, is the one that distances count from.
  EXPECT_DOUBLE_EQ(*a.cells[0].distance, 0);
  EXPECT_NEAR(*data.rows[0].cells[0].distance, 1, 1e-12);
  EXPECT_NEAR(*data.rows[2].cells[0].distance, -0.5, 1e-12);
  EXPECT_NEAR(*a.cells[1].distance, 0.7 / 0.8 - 1, 1e-12);
  EXPECT_EQ(a.truth[0].views, 5);
  EXPECT_EQ(a.truth[0].lost, 2);
  EXPECT_EQ(a.truth[0].wrong, 0);
  EXPECT_EQ(data.rows[2].truth[0].wrong, 3);
  EXPECT_DOUBLE_EQ(a.truth[0].mean_mm, 20);
  EXPECT_FALSE(data.rows[3].has_model);
  EXPECT_TRUE(data.rows[3].cells[0].values.empty());
}

TEST(TableData, FilesHaveRowsAndColumnsInOrder) {
  const SuiteConfig suite = Suite();
  const TableData data = MakeTable(suite, suite.tables[0], Scores());
  const std::string markdown = FormatMarkdown(data);
  EXPECT_LT(markdown.find("| first_row |"), markdown.find("| second |"));
  EXPECT_NE(markdown.find("| second | 0.0300 (1%) | 0.0100 (2) | 33.33% (3) | +0.00% (4) | 0.0100 |"
                          " 70.00% (5) | 16.33% (6) | 23.3% (7) | -12.50% (8) | 100.00% |"),
            std::string::npos)
      << markdown;
  EXPECT_NE(markdown.find("none (no model yet)"), std::string::npos);
  const std::string csv = FormatCsv(data);
  EXPECT_NE(csv.find("\n\"second\",a,initial,\"RMS\",d1,2,0.03,0.01,"), std::string::npos) << csv;
  EXPECT_NE(FormatTableJson(data).find("\"to_best\""), std::string::npos);
}

}  // namespace
}  // namespace volalign::table_data_test
