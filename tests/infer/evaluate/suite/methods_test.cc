#include "infer/evaluate/suite/methods.h"

#include <gtest/gtest.h>

#include "core/base/error.h"
#include "core/geometry/pose.h"
#include "tests/core/base/expect_error.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::methods_test {
namespace {

TEST(Stages, CorrectedViewsHaveTheDepthThatTheRefinementFound) {
  SuiteStill still;
  DepthImage depth(4, 3, 2.0F);
  depth(1, 1) = 0;
  still.views = {MakeSensorView(depth, testing_infer::Kinect().Resized(4, 3))};
  MethodResult result;
  result.initial = {Pose::Identity()};
  result.statistical = FramePoses{Pose(Eigen::Translation3d(1, 0, 0))};
  result.corrections = {{1.01, -0.004}};
  ASSERT_EQ(PosesAt(PoseStage::kCorrected, result), PosesAt(PoseStage::kStatistical, result));
  const std::vector<SensorView> corrected = ViewsAt(PoseStage::kCorrected, still, result);
  ASSERT_EQ(corrected.size(), 1u);
  EXPECT_NEAR(corrected[0].depth(0, 0), 1.01 * 2 - 0.004, 1e-6);
  EXPECT_EQ(corrected[0].depth(1, 1), 0);  // nothing was measured there
  for (const PoseStage stage : {PoseStage::kInitial, PoseStage::kStatistical})
    EXPECT_EQ(ViewsAt(stage, still, result)[0].depth, depth);
}

TEST(Stages, AreThoseThatTheMethodHas) {
  MethodResult result;
  result.initial = {std::nullopt};
  EXPECT_EQ(PosesAt(PoseStage::kInitial, result), &result.initial);
  for (const PoseStage stage : {PoseStage::kGraph, PoseStage::kStatistical, PoseStage::kCorrected})
    EXPECT_EQ(PosesAt(stage, result), nullptr);
  result.graph = result.initial;
  EXPECT_EQ(PosesAt(PoseStage::kGraph, result), &*result.graph);
  EXPECT_EQ(PosesAt(PoseStage::kCorrected, result), nullptr);
}

TEST(RunMethod, MarkersWantInfraredPictures) {
  SuiteStill still;
  still.views = {MakeSensorView(DepthImage(4, 3, 2.0F), testing_infer::Kinect().Resized(4, 3))};
  SuiteMethod markers;
  markers.kind = MethodKind::kMarkers;
  ExpectError<Error>([&] { RunMethod(markers, still, nullptr, SuiteConfig(), 1); }, {"infrared"});
}

// The paper's poses, from the labels that it is given, are some centimetres off, since centroids of
// what is seen are not the sides' centres.
TEST(RunMethod, TheStatisticalRefinementImprovesThePapersPoses) {
  const testing_infer::Rig rig = testing_infer::ThreeSensors();
  testing_infer::StoredSegmenter segmenter = rig.PerfectSegmenter();
  SuiteStill still;
  still.still.structure = rig.structure;
  still.still.frames = rig.frames;
  for (const SensorFrame& frame : rig.frames)
    still.views.push_back(MakeSensorView(frame.depth, frame.intrinsics));
  SuiteMethod method;
  method.kind = MethodKind::kNetwork;
  method.statistical = true;
  const MethodResult result = RunMethod(method, still, &segmenter, SuiteConfig(), 1);
  for (std::size_t i = 0; i < rig.frames.size(); ++i) {
    ASSERT_TRUE(result.initial[i] && (*result.statistical)[i]) << i;
    const Pose& truth = *rig.frames[i].ground_truth;
    EXPECT_GT(ComparePoses(*result.initial[i], truth).translation_m, 0.02) << i;
    EXPECT_LT(ComparePoses(*(*result.statistical)[i], truth).translation_m, 0.005) << i;
  }
}

}  // namespace
}  // namespace volalign::methods_test
