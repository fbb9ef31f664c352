#include "infer/evaluate/suite/scores.h"

#include <gtest/gtest.h>

#include "core/base/error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::scores_test {
namespace {

using testing_infer::Kinect;
using testing_infer::PaperStructure;
using testing_infer::RingPose;

constexpr int kMinPixels = 5;
constexpr double kOff = 0.05;  // m

/// Two sensors; the method placed the first one rightly and the second one not, and its refinement
/// moved the first one off.
class Scores : public testing::Test {
 protected:
  Scores() {
    testing_infer::Rig rig{PaperStructure(), {}, {}};
    for (const double phi : {20.0, 140.0})
      rig.Add("S" + std::to_string(rig.frames.size()), RingPose(phi), {}, Kinect().Resized(80, 72));
    still_.still.structure = rig.structure;
    still_.still.frames = rig.frames;
    still_.still.labels = rig.labels;
    for (const SensorFrame& frame : rig.frames)
      still_.views.push_back(MakeSensorView(frame, frame.intrinsics));
    const Pose truth = *rig.frames[0].ground_truth;
    result_.labels = rig.labels;
    result_.initial = {truth, std::nullopt};
    result_.graph = FramePoses{Eigen::Translation3d(kOff, 0, 0) * truth, std::nullopt};
  }
  CaptureScores Score() const { return ScoreCapture(still_, result_, kMinPixels); }

  SuiteStill still_;
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
  EXPECT_GT(placed.stages[0].labels.value().miou, 0.99);
  EXPECT_LT(placed.stages[1].labels.value().miou, 0.95);
  EXPECT_NEAR(placed.floor.value().miou, placed.stages[0].labels.value().miou, 1e-12);
  EXPECT_EQ(placed.miou_of_truth, 1);
  // The floor is of all views, placed or not.
  const ViewScores& lost = scores.views[1];
  EXPECT_FALSE(lost.stages[0].placed);
  EXPECT_FALSE(lost.stages[0].labels || lost.stages[0].error);
  EXPECT_GT(lost.floor.value().miou, 0.99);
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
  still_.still.labels.clear();
  const CaptureScores recording = Score();
  EXPECT_FALSE(recording.stages[0].d1_m);
  EXPECT_FALSE(recording.views[0].miou_of_truth);
  // A method without labels has no scores of them.
  result_.labels.clear();
  const CaptureScores without = Score();
  EXPECT_FALSE(without.views[0].stages[0].labels || without.views[0].floor);
  EXPECT_TRUE(without.views[0].stages[0].error);
  for (SensorFrame& frame : still_.still.frames) frame.ground_truth.reset();
  EXPECT_FALSE(Score().views[0].stages[0].error);
}

TEST_F(Scores, ErrorsAreInTheFrameWhereTheBoxesDisplacementsAverageOut) {
  still_.still.nominal_from_built = Pose(Eigen::Translation3d(kOff, 0, 0));
  const CaptureScores scores = Score();
  EXPECT_NEAR(scores.views[0].stages[0].error.value().translation_m, kOff, 1e-9);
  EXPECT_LT(scores.views[0].stages[1].error.value().translation_m, 1e-9);
  EXPECT_NEAR(scores.views[0].floor.value().miou, scores.views[0].stages[1].labels.value().miou,
              1e-12);
}

TEST_F(Scores, ComeBackFromTheirFile) {
  const TempFolder folder;
  CaptureScores scores = Score();
  scores.fingerprint = "abc";
  scores.dataset = "arc";
  scores.set_up = "arc8";
  scores.capture = "arc8_turn_1";
  scores.method = "net";
  scores.seconds = 1.5;
  WriteScores(folder / "scores.json", scores);
  const CaptureScores read = ReadScores(folder / "scores.json");
  EXPECT_EQ(FormatScores({read}), FormatScores({scores}));
  EXPECT_EQ(read.fingerprint, "abc");
  EXPECT_EQ(read.views[1].name, "S1");
  EXPECT_FALSE(read.views[1].stages[0].placed);
  EXPECT_EQ(read.stages[1].d1_m, scores.stages[1].d1_m);
  EXPECT_THROW(ReadScores(folder.Write("other.json", "{}")), DataError);
}

}  // namespace
}  // namespace volalign::scores_test
