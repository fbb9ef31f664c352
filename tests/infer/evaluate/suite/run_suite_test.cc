#include "infer/evaluate/suite/run_suite.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <filesystem>
#include <initializer_list>
#include <set>
#include <string>
#include <vector>

#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "core/geometry/pose.h"
#include "infer/evaluate/suite/methods.h"
#include "infer/evaluate/suite/scores.h"
#include "infer/evaluate/suite/suite_config.h"
#include "infer/evaluate/suite/table_data.h"
#include "render/tiles/tile_renderer.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::run_suite_test {
namespace {

namespace fs = std::filesystem;

/// Two captures of two sensors, three methods, one of which has no model, and a table. Small.
class ToySuite : public testing::Test {
 protected:
  ToySuite() {
    WriteFileAtomically(folder_ / "toy.yaml",
                        "room: false\nnoise: none\nseed: 3\nturns_deg: [0, 90]\ngroups:\n"
                        "  - {phi_deg: [10, 70], height_cm: [110], rho_cm: 200}\n");
    const std::string model = (fs::current_path() / "models/m05-lite.safetensors").string();
    WriteFileAtomically(
        folder_ / "suite.yaml",
        "datasets: [{name: toy, rigs: [toy.yaml]}]\n"
        "methods:\n  - {name: net, model: " +
            model +
            "}\n  - {name: markers, kind: markers, statistical: true}\n"
            "  - {name: missing, model: none.pt}\n  - {name: best, kind: volalign, model: " +
            model +
            "}\n"
            "tables:\n  - name: toy_table\n    title: Toy\n    blocks:\n"
            "      - {title: RMS, metric: d1, datasets: [toy]}\n"
            "      - {title: mIoU, metric: miou_authors, datasets: [toy]}\n"
            "    rows:\n"
            "      - {label: net, method: net, stage: graph}\n"
            "      - {label: markers, method: markers, stage: initial}\n"
            "      - {label: markers refined, method: markers, stage: statistical}\n"
            "      - {label: missing, method: missing}\n"
            "      - {label: best, method: best, stage: statistical}\n");
    run_.output = folder_ / "results";
    run_.workers = 2;
    run_.make_renderer = TileRenderers();
    run_.progress = [this](const std::string& line) { lines_.push_back(line); };
  }

  TempFolder folder_;
  SuiteRun run_;
  std::vector<std::string> lines_;
};

TEST_F(ToySuite, RunsAndWritesItsTables) {
  const SuiteConfig suite = SelectTables(ReadSuite((folder_ / "suite.yaml").string()), "toy_table");
  const std::vector<CaptureScores> scores = RunSuite(suite, run_);
  ASSERT_EQ(scores.size(), 6u);  // two captures by the three methods that have a model
  EXPECT_EQ(lines_.size(), 2u);
  for (const CaptureScores& capture : scores) {
    SCOPED_TRACE(capture.capture + " " + capture.method);
    ASSERT_EQ(capture.views.size(), 2u);
    ASSERT_FALSE(capture.stages.empty());
    const std::size_t last = capture.stages.size() - 1;
    const bool graph = capture.method == "net";
    EXPECT_EQ(capture.stages[last].stage, graph ? "graph" : "corrected");
    // Depth is exact; bounds are three times what comes out. Point-to-plane errors alone leave a
    // view open along the planes that it sees.
    EXPECT_LT(capture.stages[last].d1_m.value(), graph ? 0.0135 : 0.006);
    EXPECT_LT(capture.d1_floor_m.value(), 0.005);  // the surface is sampled at 5 mm
    EXPECT_GT(capture.stages[last].d2_m.value(), capture.stages[last].d1_m.value());
    for (const ViewScores& view : capture.views) {
      EXPECT_TRUE(view.stages[last].placed);
      EXPECT_LT(view.stages[last].error.value().translation_m, graph ? 0.1 : 0.006);
      EXPECT_EQ(view.floor.has_value(), capture.method != "markers");  // those have no labels
    }
  }
  EXPECT_EQ(ReadFile(run_.output / "captures/toy/toy_turn_2.markers.json").find("{"), 0u);
  const std::string text = WriteSuite(run_.output, suite, scores);
  EXPECT_TRUE(Has(text, "| missing (no model yet) | - | - |"));
  for (const char* file : {"toy_table.csv", "toy_table.json", "suite.md", "suite.json"})
    EXPECT_TRUE(fs::exists(run_.output / file)) << file;
}

TEST_F(ToySuite, SaysWhatIsWrong) {
  const std::string path = (folder_ / "suite.yaml").string();
  const SuiteConfig suite = ReadSuite(path);
  ExpectError<ConfigError>([&] { SelectTables(suite, "table9"); }, {"table9", "toy_table"});
  const std::string text = ReadFile(path);
  const auto expect = [&](const std::string& from, const std::string& to,
                          std::initializer_list<std::string> parts) {
    std::string changed = text;
    changed.replace(changed.find(from), from.size(), to);
    WriteFileAtomically(folder_ / "wrong.yaml", changed);
    ExpectError<ConfigError>([&] { ReadSuite((folder_ / "wrong.yaml").string()); }, parts);
  };
  expect("datasets: [toy]", "datasets: [boy]", {"toy_table", "boy"});
  expect("method: markers, stage: initial", "method: ghosts", {"toy_table", "ghosts"});
  expect("stage: graph", "stage: graph, paper: [a, b]", {"net", "2 cells"});
  expect("name: markers", "name: net", {"net stands twice"});
}

using namespace testing_infer;
using testing_infer::Rig;

constexpr int kMinPixels = 5;
constexpr double kOff = 0.05;  // m

/// Two sensors; the method placed the first one rightly and the second one not, and its refinement
/// moved the first one off.
class Scores : public testing::Test {
 protected:
  Scores() {
    Rig rig{PaperStructure(), {}, {}};
    for (const double phi : {20.0, 140.0}) rig.Add(RingPose(phi), {}, Kinect().Resized(80, 72));
    capture_.evaluation.structure = rig.structure;
    capture_.evaluation.frames = rig.frames;
    capture_.evaluation.labels = rig.labels;
    for (const SensorFrame& frame : rig.frames)
      capture_.views.push_back(MakeSensorView(frame, frame.intrinsics));
    const Pose truth = *rig.frames[0].ground_truth;
    result_.labels = rig.labels;
    result_.poses[PoseStage::kInitial] = {truth, std::nullopt};
    result_.poses[PoseStage::kGraph] = {Eigen::Translation3d(kOff, 0, 0) * truth, std::nullopt};
  }
  CaptureScores Score() const { return ScoreCapture(capture_, result_, kMinPixels); }

  SuiteCapture capture_;
  MethodResult result_;
};

TEST_F(Scores, EachStageIsMeasuredAgainstTheTruth) {
  const CaptureScores scores = Score();
  ASSERT_EQ(scores.stages.size(), 2u);
  EXPECT_EQ(scores.stages[0].stage, "initial");
  EXPECT_EQ(scores.stages[1].stage, "graph");
  EXPECT_LT(scores.stages[0].d1_m.value(), 0.004);  // the surface is sampled at 5 mm
  EXPECT_GT(scores.stages[1].d1_m.value(), 0.01);
  EXPECT_GT(scores.stages[0].d2_m.value(), 0.1);  // one sensor sees a part of the surface
  ASSERT_EQ(scores.views.size(), 2u);
  EXPECT_EQ(scores.views[1].name, "S1");
  const ViewScores& placed = scores.views[0];
  ASSERT_EQ(placed.stages.size(), 2u);
  EXPECT_LT(placed.stages[0].error.value().translation_m, 1e-9);
  EXPECT_NEAR(placed.stages[1].error.value().translation_m, kOff, 1e-9);
  EXPECT_GT(placed.stages[0].labels.value().miou_authors, 0.99);
  EXPECT_LT(placed.stages[1].labels.value().miou_authors, 0.98);
  EXPECT_NEAR(placed.floor.value().miou_authors, placed.stages[0].labels.value().miou_authors,
              1e-12);
  EXPECT_EQ(placed.miou_of_truth, 1);
  // The floor is of all views, placed or not.
  const ViewScores& lost = scores.views[1];
  EXPECT_FALSE(lost.stages[0].placed);
  EXPECT_FALSE(lost.stages[0].labels || lost.stages[0].error);
  EXPECT_GT(lost.floor.value().miou_authors, 0.99);
  EXPECT_LT(scores.d1_floor_m.value(), 0.004);
  EXPECT_LT(scores.d2_floor_m.value(), scores.stages[0].d2_m.value());
}

TEST_F(Scores, PointsAreThoseOnTheStructureWhateverTheMethodLabelled) {
  const CaptureScores right = Score();
  for (LabelImage& labels : result_.labels) labels = LabelImage(80, 72);
  const CaptureScores blind = Score();
  EXPECT_EQ(blind.stages[0].d1_m, right.stages[0].d1_m);
  EXPECT_LT(blind.views[0].miou_of_truth.value(), 0.2);
  // Of a recording, whose labels nobody knows, those that it labelled: none.
  capture_.evaluation.labels.clear();
  const CaptureScores recording = Score();
  EXPECT_FALSE(recording.stages[0].d1_m);
  EXPECT_FALSE(recording.views[0].miou_of_truth);
  // A method without labels has no scores of them.
  result_.labels.clear();
  const CaptureScores without = Score();
  EXPECT_FALSE(without.views[0].stages[0].labels || without.views[0].floor);
  EXPECT_TRUE(without.views[0].stages[0].error);
  for (SensorFrame& frame : capture_.evaluation.frames) frame.ground_truth.reset();
  EXPECT_FALSE(Score().views[0].stages[0].error);
}

TEST_F(Scores, ErrorsAreInTheFrameWhereTheBoxesDisplacementsAverageOut) {
  capture_.evaluation.nominal_from_built = Pose(Eigen::Translation3d(kOff, 0, 0));
  const CaptureScores scores = Score();
  EXPECT_NEAR(scores.views[0].stages[0].error.value().translation_m, kOff, 1e-9);
  EXPECT_LT(scores.views[0].stages[1].error.value().translation_m, 1e-9);
  EXPECT_NEAR(scores.views[0].floor.value().miou_authors,
              scores.views[0].stages[1].labels.value().miou_authors, 1e-12);
}

CaptureScores ScoresOf(const std::string& set_up, const std::string& method, double d1,
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
  c.model = "/no/such/model.safetensors";
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

std::vector<CaptureScores> SomeScores() {
  return {ScoresOf("near", "a", 0.02, {0.5, 0.7}), ScoresOf("far", "a", 0.04, {0.9}),
          ScoresOf("far", "b", 0.06, {0.8})};
}

TEST(TableData, CellsAreThoseOfTheirCapturesAndViews) {
  const SuiteConfig suite = Suite();
  const TableData data = MakeTable(suite, suite.tables[0], SomeScores());
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
  const TableData data = MakeTable(suite, suite.tables[0], SomeScores());
  const std::string markdown = FormatMarkdown(data);
  EXPECT_LT(markdown.find("| first_row |"), markdown.find("| second |"));
  EXPECT_TRUE(Has(markdown,
                  "| second | 0.0300 (1%) | 0.0100 (2) | 33.33% (3) | +0.00% (4) | 0.0100 |"
                  " 70.00% (5) | 16.33% (6) | 23.3% (7) | -12.50% (8) | 100.00% |",
                  "none (no model yet)"));
  EXPECT_TRUE(Has(FormatTableJson(data), "\"to_best\""));
  EXPECT_TRUE(Has(FormatTableCsv(data), "\nsecond,a,initial,RMS,d1,2,0.03,0.01,"));
}

using namespace testing_infer;
using testing_infer::Rig;

template <class T>
std::string NamesOf(const std::vector<T>& items) {
  std::string names;
  for (const T& item : items) names += (names.empty() ? "" : " ") + item.name;
  return names;
}

class SuiteFile : public testing::Test {
 protected:
  SuiteConfig Read() {
    return ReadSuite(folder_
                         .Write("suite.yaml",
                                "datasets:\n"
                                "  - {name: arc, rigs: [rigs/arc.yaml], captures: [../c.json]}\n"
                                "  - {name: ring, rigs: [/abs/ring.yaml]}\n"
                                "methods:\n"
                                "  - {name: net, model: models/net.pt, datasets: [arc]}\n"
                                "  - {name: markers, kind: markers}\n"
                                "tables:\n"
                                "  - name: one\n"
                                "    blocks: [{title: RMS, metric: d1, datasets: [arc]}]\n"
                                "    rows: [{label: net, method: net, stage: graph}]\n"
                                "  - name: two\n"
                                "    blocks: [{title: RMS, metric: d2, datasets: [ring]}]\n"
                                "    rows: [{label: markers, method: markers}]\n")
                         .string());
  }

  TempFolder folder_;
};

TEST_F(SuiteFile, FilesAreRelativeToItsOwn) {
  const SuiteConfig suite = Read();
  EXPECT_EQ(suite.datasets[0].rigs[0], (folder_ / "rigs/arc.yaml").string());
  EXPECT_EQ(suite.datasets[0].captures[0], (folder_.path().parent_path() / "c.json").string());
  EXPECT_EQ(suite.datasets[1].rigs[0], "/abs/ring.yaml");
  EXPECT_EQ(suite.methods[0].model, (folder_ / "models/net.pt").string());
  EXPECT_EQ(suite.methods[1].model, "");
  EXPECT_TRUE(IsApplicable(suite.methods[0], "arc"));
  EXPECT_FALSE(IsApplicable(suite.methods[0], "ring"));
  EXPECT_TRUE(IsApplicable(suite.methods[1], "ring"));
  EXPECT_STREQ(ToString(suite.tables[0].rows[0].stage), "graph");
  EXPECT_STREQ(ToString(suite.tables[1].blocks[0].metric), "d2");
}

TEST_F(SuiteFile, ATableAloneHasWhatItNeeds) {
  const SuiteConfig all = SelectTables(Read(), "all"), two = SelectTables(Read(), "two");
  EXPECT_EQ(NamesOf(all.tables), "one two");
  EXPECT_EQ(NamesOf(all.datasets), "arc ring");
  EXPECT_EQ(NamesOf(two.tables), "two");
  EXPECT_EQ(NamesOf(two.datasets), "ring");
  EXPECT_EQ(NamesOf(two.methods), "markers");
}

// The file that is shipped: the paper's tables, in its order of rows.
TEST(PaperSuite, IsThePapers) {
  const SuiteConfig suite = ReadSuite("configs/paper/suite.yaml");
  ASSERT_EQ(suite.tables.size(), 6u);
  const auto paper_rows = [&](std::size_t table) {
    std::string rows;
    for (const SuiteRow& row : suite.tables[table].rows) {
      if (!row.paper.empty()) rows += (rows.empty() ? "" : " ") + row.label;
    }
    return rows;
  };
  EXPECT_EQ(paper_rows(0), "m01 m05 m04 m02 m03 m07 m06");
  EXPECT_EQ(paper_rows(1), "m05 m04 m07 m06");
  EXPECT_EQ(paper_rows(2), "m05 m04 m07 m06");
  EXPECT_EQ(paper_rows(3),
            "markerbased_refined markerless_refined markerbased_initial markerless_initial");
  EXPECT_EQ(NamesOf(suite.tables), "table2 table3 table4 table5 table6 table4_level");
}

class SuiteItemsTest : public testing::Test {
 protected:
  SuiteItemsTest() {
    dataset_.name = "toy";
    dataset_.rigs = {folder_
                         .Write("ring.yaml",
                                "room: false\nnoise: none\nseed: 3\nturns_deg: [0, 10, 20, 30]\n"
                                "sensors:\n"
                                "  - {name: A, sensor: azure_kinect_nfov_binned, phi_deg: 10}\n"
                                "  - {name: B, sensor: azure_kinect_nfov_binned, phi_deg: 70}\n")
                         .string()};
  }
  std::string CapturesOf(int most) const {
    std::string names;
    for (const SuiteItem& item : SuiteItems(dataset_, structure_, most))
      names += item.capture + " ";
    return names;
  }

  TempFolder folder_;
  Structure structure_ = PaperStructure();
  SuiteDataset dataset_;
};

TEST_F(SuiteItemsTest, AreTheTurnsOfARigOrSomeOfThemEvenlyTaken) {
  EXPECT_EQ(CapturesOf(0), "ring_turn_1 ring_turn_2 ring_turn_3 ring_turn_4 ");
  EXPECT_EQ(CapturesOf(9), CapturesOf(0));
  EXPECT_EQ(CapturesOf(2), "ring_turn_1 ring_turn_3 ");
  for (const SuiteItem& item : SuiteItems(dataset_, structure_, 0)) {
    EXPECT_EQ(item.dataset, "toy");
    EXPECT_EQ(item.set_up, "ring");
    EXPECT_TRUE(item.rig);
  }
  dataset_.captures = {(folder_ / "none.json").string()};
  EXPECT_THROW(SuiteItems(dataset_, structure_, 0), IoError);
}

TEST(HasModel, AlsoInTheDataFolder) {
  const TempFolder folder;
  SuiteMethod method;
  method.model = "models/of_the_suite.pt";
  EXPECT_FALSE(HasModel(method));
  std::filesystem::create_directory(folder / "models");
  folder.Write("models/of_the_suite.pt", "weights");
  const std::string before = DataFolder();
  SetDataFolder(folder.path().string());
  EXPECT_TRUE(HasModel(method));
  SetDataFolder(before);
  method.kind = MethodKind::kMarkers;
  EXPECT_TRUE(HasModel(method));
}

TEST(Applies, ToItsDatasetsAndMarkersToRenderedCaptures) {
  SuiteMethod net, markers;
  net.datasets = {"arc"};
  markers.kind = MethodKind::kMarkers;
  SuiteItem rendered, recorded;
  rendered.dataset = recorded.dataset = "arc";
  rendered.rig.emplace();
  EXPECT_TRUE(Applies(net, rendered));
  EXPECT_TRUE(Applies(net, recorded));
  EXPECT_TRUE(Applies(markers, rendered));
  EXPECT_FALSE(Applies(markers, recorded));
  rendered.dataset = "ring";
  EXPECT_FALSE(Applies(net, rendered));
  EXPECT_TRUE(Applies(markers, rendered));
}

TEST(Stages, CorrectedViewsHaveTheDepthThatTheRefinementFound) {
  SuiteCapture capture;
  DepthImage depth(4, 3, 2.0F);
  depth(1, 1) = 0;
  capture.views = {MakeSensorView(depth, Kinect().Resized(4, 3))};
  MethodResult result;
  result.corrections = {{1.01, -0.004}};
  const std::vector<SensorView> corrected = ViewsAt(PoseStage::kCorrected, capture, result);
  ASSERT_EQ(corrected.size(), 1u);
  EXPECT_NEAR(corrected[0].depth(0, 0), 1.01 * 2 - 0.004, 1e-6);
  EXPECT_EQ(corrected[0].depth(1, 1), 0);  // nothing was measured there
  for (const PoseStage stage : {PoseStage::kInitial, PoseStage::kStatistical})
    EXPECT_EQ(ViewsAt(stage, capture, result)[0].depth, depth);
}

TEST(RunMethod, MarkersWantInfraredPictures) {
  SuiteCapture capture;
  capture.views = {MakeSensorView(DepthImage(4, 3, 2.0F), Kinect().Resized(4, 3))};
  SuiteMethod markers;
  markers.kind = MethodKind::kMarkers;
  ExpectError<Error>([&] { RunMethod(markers, capture, nullptr, 1); }, {"infrared"});
}

}  // namespace
}  // namespace volalign::run_suite_test
