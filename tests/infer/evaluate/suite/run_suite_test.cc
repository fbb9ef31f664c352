#include "infer/evaluate/suite/run_suite.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <initializer_list>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "infer/evaluate/suite/write_suite.h"
#include "render/tiles/tile_renderer.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"

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
    const std::string model = (fs::current_path() / "models/m05-lite.pt").string();
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
            "      - {label: best, method: best, stage: statistical}\n"
            "infrared: {supersampling: 1, full_well_electrons: 0}\n");
    run_.output = folder_ / "results";
    run_.program = "1";
    run_.workers = 2;
    run_.make_renderer = TileRenderers();
    run_.progress = [this](const std::string& line) { lines_.push_back(line); };
  }

  TempFolder folder_;
  SuiteRun run_;
  std::vector<std::string> lines_;
};

TEST_F(ToySuite, RunsResumesAndWritesItsTables) {
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
  // Everything is known: nothing is computed again, and results are the same.
  lines_.clear();
  const std::vector<CaptureScores> again = RunSuite(suite, run_);
  EXPECT_EQ(FormatScores(again), FormatScores(scores));
  for (const std::string& line : lines_) EXPECT_NE(line.find("done before"), std::string::npos);
  // What was lost is computed again, and by another program everything is.
  fs::remove(run_.output / "captures/toy/toy_turn_2.markers.json");
  lines_.clear();
  RunSuite(suite, run_);
  EXPECT_NE(lines_[0].find("done before") == std::string::npos,
            lines_[1].find("done before") == std::string::npos);

  const std::string text = WriteSuite(run_.output, suite, scores);
  EXPECT_NE(text.find("| missing (no model yet) | - | - |"), std::string::npos) << text;
  for (const char* file :
       {"toy_table.md", "toy_table.csv", "toy_table.json", "suite.md", "suite.json"}) {
    EXPECT_TRUE(fs::exists(run_.output / file)) << file;
  }
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

}  // namespace
}  // namespace volalign::run_suite_test
