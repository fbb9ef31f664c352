#include "infer/evaluate/suite/suite_config.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "core/base/input_file.h"
#include "core/geometry/pose.h"
#include "infer/evaluate/suite/methods.h"
#include "infer/evaluate/suite/run_suite.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::suite_config_test {
namespace {

using namespace testing_infer;
using testing_infer::Rig;

template <class T>
std::string NamesOf(const std::vector<T>& items) {
  std::string names;
  for (const T& item : items) names += (names.empty() ? "" : " ") + item.name;
  return names;
}

class Suite : public testing::Test {
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

TEST_F(Suite, FilesAreRelativeToItsOwn) {
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

TEST_F(Suite, ATableAloneHasWhatItNeeds) {
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

// The paper's poses, from the labels that it is given, are some centimetres off, since centroids of
// what is seen are not the sides' centres.
TEST(RunMethod, TheStatisticalRefinementImprovesThePapersPoses) {
  const Rig rig = ThreeSensors();
  StoredSegmenter segmenter = rig.PerfectSegmenter();
  SuiteCapture capture;
  capture.evaluation.structure = rig.structure;
  capture.evaluation.frames = rig.frames;
  for (const SensorFrame& frame : rig.frames)
    capture.views.push_back(MakeSensorView(frame.depth, frame.intrinsics));
  SuiteMethod method;
  method.kind = MethodKind::kNetwork;
  method.statistical = true;
  const MethodResult result = RunMethod(method, capture, &segmenter, 1);
  for (std::size_t i = 0; i < rig.frames.size(); ++i) {
    const std::optional<Pose>& initial = result.poses.at(PoseStage::kInitial)[i];
    const std::optional<Pose>& refined = result.poses.at(PoseStage::kStatistical)[i];
    ASSERT_TRUE(initial && refined) << i;
    const Pose& truth = *rig.frames[i].ground_truth;
    EXPECT_GT(ComparePoses(*initial, truth).translation_m, 0.02) << i;
    EXPECT_LT(ComparePoses(*refined, truth).translation_m, 0.005) << i;
  }
}

}  // namespace
}  // namespace volalign::suite_config_test
