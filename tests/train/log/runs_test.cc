#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/base/file_util.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "train/log/run_folder.h"
#include "train/log/run_log.h"

namespace volalign::runs_test {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

/// A run folder with a validation at 10 and one at 20 samples, as a killed run leaves it.
void WriteRun(const std::filesystem::path& dir, int seed, double lr, double miou) {
  WriteFileAtomically(dir / "config.yaml",
                      fmt::format("optim: {{lr: {}}}\nrun: {{seed: {}, samples: 40}}\n", lr, seed));
  std::string rows;
  for (const int samples : {10, 20}) {
    rows += json{{"type", "train"},
                 {"step", samples / 5},
                 {"samples", samples},
                 {"loss", 30.0 / samples},
                 {"loss_seg", seed * 10.0 / samples},
                 {"samples_per_s", 4.0},
                 {"step_s", {{"data", 0.1}}}}
                .dump() +
            "\n";
    json validation = {
        {"type", "validation"}, {"samples", samples}, {"miou", miou + 1.0 / samples}};
    if (samples == 10) validation["keypoint_rmse_m"] = 0.1;  // later no sample has a pose
    rows += validation.dump() + "\n";
  }
  WriteFileAtomically(dir / "metrics.jsonl", rows + "{\"type\":\"tr");
}

TEST(Runs, RowsOfOtherValuesNameTheLine) {
  const TempFolder folder;
  WriteRun(folder / "a", 1, 0.001, 0.5);
  const std::filesystem::path log = folder / "a" / "metrics.jsonl";
  for (const std::string row : {R"({"type":"train","samples":"x"})", R"({"type":1,"samples":1})",
                                R"({"type":"train","samples":1e300})", "[]", "nonsense"}) {
    WriteFileAtomically(log, row + "\n{}\n");
    ExpectError<DataError>([&] { ReadRuns({folder.path().string()}); }, {log.string() + ":1"});
  }
}

TEST(Runs, AFolderThatCannotBeLookedIntoIsSaid) {
  const TempFolder folder;
  WriteRun(folder / "a", 1, 0.001, 0.5);
  std::filesystem::create_directory(folder / "loop");
  std::filesystem::create_symlink("config.yaml", folder / "loop/config.yaml");  // to itself
  std::vector<std::string> passed_over;
  EXPECT_EQ(ReadRuns({folder.path().string()}, &passed_over).size(), 1u);
  ASSERT_EQ(passed_over.size(), 1u);
  EXPECT_EQ(passed_over[0].rfind((folder / "loop").string() + ": ", 0), 0u) << passed_over[0];
}

TEST(Runs, AreListedAndCompared) {
  const TempFolder folder;
  WriteRun(folder / "a1", 1, 0.001, 0.5);
  WriteRun(folder / "a2", 2, 0.001, 0.7);
  WriteRun(folder / "b1", 1, 0.002, 0.6);
  const std::vector<LoggedRun> runs = ReadRuns({folder.path().string()});
  ASSERT_EQ(runs.size(), 3u);
  EXPECT_EQ(runs[1].name, (folder / "a2").string());
  EXPECT_EQ(runs[1].samples, 20);

  const json list = json::parse(FormatTable(ListRuns(runs), TableFormat::kJson));
  ASSERT_EQ(list.size(), 3u);
  EXPECT_EQ(list[0].at("samples"), 20);
  EXPECT_EQ(list[0].at("of"), 40);
  EXPECT_EQ(list[0].at("loss"), 1.5);
  EXPECT_DOUBLE_EQ(list[0].at("miou"), 0.55);
  EXPECT_DOUBLE_EQ(list[0].at("best miou"), 0.6);
  EXPECT_EQ(list[0].at("samples_per_s"), 4);
  EXPECT_FALSE(list[0].contains("loss_seg"));  // of a validation, which these rows lack
  EXPECT_FALSE(list[0].contains("keypoint_rmse_m"));

  const std::vector<RunGroup> groups = GroupRuns(runs);
  ASSERT_EQ(groups.size(), 2u);
  EXPECT_EQ(groups[0].runs.size(), 2u);
  using Keys = std::map<std::string, std::string>;
  EXPECT_EQ(groups[0].differences, (Keys{{"optim.lr", "0.001"}}));
  EXPECT_EQ(groups[1].differences, (Keys{{"optim.lr", "0.002"}}));
  const Table table = CompareRuns(groups);
  const json compared = json::parse(FormatTable(table, TableFormat::kJson));
  EXPECT_EQ(compared[0].at("optim.lr"), "0.001");
  EXPECT_EQ(compared[0].at("runs"), 2);
  EXPECT_NEAR(compared[0].at("miou").get<double>(), 0.65, 1e-12);
  EXPECT_NEAR(compared[0].at("miou std").get<double>(), 0.2 / std::sqrt(2.0), 1e-12);
  EXPECT_FALSE(compared[1].contains("miou std"));
  const std::string csv = FormatTable(table, TableFormat::kCsv);
  EXPECT_EQ(csv.substr(0, 33), "run,optim.lr,runs,samples,miou,mi") << csv;
  EXPECT_TRUE(Has(csv, "/a1,0.001,2,20,0.65,0.141421356"));
}

TEST(Runs, ShowTheKeysThatAreWanted) {
  std::vector<LoggedRun> runs(3);
  for (int i = 0; i < 3; ++i) {
    LoggedRun& run = runs[static_cast<std::size_t>(i)];
    run.config = {{"data.key7", std::to_string(i / 2)},
                  {"data.key8", std::to_string(i)},
                  {"model.kind", "paper"}};
  }
  std::vector<RunGroup> groups = GroupRuns(runs);
  ASSERT_EQ(groups.size(), 3u);
  using Keys = std::map<std::string, std::string>;
  EXPECT_EQ(groups[2].differences, (Keys{{"data.key7", "1"}, {"data.key8", "2"}}));
  ShowKeys({"model.kind", "data.key7"}, &groups);
  EXPECT_EQ(groups[2].differences, (Keys{{"data.key7", "1"}, {"model.kind", "paper"}}));
  ExpectError<ConfigError>([&] { ShowKeys({"model.width"}, &groups); }, {"--keys model.width"});
}

TEST(Runs, SayWhatIsNoRun) {
  const TempFolder folder;
  ExpectError<IoError>([&] { ReadRuns({folder.path().string()}); }, {"metrics.jsonl"});
}

void Touch(const fs::path& path) { std::ofstream(path) << "x"; }

TEST(RunFolder, KeepsTheNewestStates) {
  const TempFolder folder;
  const RunFolder run(folder / "a/b");
  for (const int samples : {9, 1000, 20}) Touch(run.State(samples));
  Touch(run.dir() / "states" / "notes.txt");
  Touch(run.dir() / "states" / "12.pt");
  EXPECT_EQ(run.States(), (std::vector<std::int64_t>{1000, 20, 9}));
  run.KeepStates(2);
  EXPECT_EQ(run.States(), (std::vector<std::int64_t>{1000, 20}));
  EXPECT_TRUE(fs::exists(run.dir() / "states" / "notes.txt"));
}

TEST(RunFolder, BeginsAfterAStateWithoutWhatCameLaterOrWasNotFinished) {
  const TempFolder folder;
  const RunFolder run(folder / "run");
  for (const int samples : {10, 20, 30}) Touch(run.State(samples));
  const fs::path half_state = run.State(30).string() + ".tmp-1",
                 half_model = run.model().string() + ".tmp-1";
  for (const fs::path& path : {half_state, half_model, run.model()}) Touch(path);
  run.BeginAfter(20);
  EXPECT_EQ(run.States(), (std::vector<std::int64_t>{20, 10}));
  EXPECT_FALSE(fs::exists(half_state));
  EXPECT_FALSE(fs::exists(half_model));
  EXPECT_TRUE(fs::exists(run.model()));
}

}  // namespace
}  // namespace volalign::runs_test
