#include "infer/evaluate/measure.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "core/base/random.h"
#include "infer/evaluate/statistics.h"
#include "infer/evaluate/tables.h"
#include "tests/infer/evaluate/stills.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::measure_test {
namespace {

using testing_infer::Certain;
using testing_infer::MakeRing;
using testing_infer::PaperStructure;
using testing_infer::Ring;
using testing_infer::StoredSegmenter;
using testing_infer::TwoVariants;

/// Counts the frames that reach the network behind it.
class CountingSegmenter : public Segmenter {
 public:
  explicit CountingSegmenter(StoredSegmenter inner) : inner_(std::move(inner)) {}
  std::vector<SegmentationResult> Segment(
      const std::vector<SegmentationRequest>& requests) override {
    frames += static_cast<int>(requests.size());
    return inner_.Segment(requests);
  }
  int frames = 0;

 private:
  StoredSegmenter inner_;
};

TEST(Measure, LeftDifferenceUndoesPerturbLeft) {
  RandomStream random(1, 0, "evaluate_test");
  for (int i = 0; i < 20; ++i) {
    Vector6d delta, start;
    for (int j = 0; j < 6; ++j) {
      delta[j] = random.Normal(0, 0.3);
      start[j] = random.Normal();
    }
    const Pose from = PerturbLeft(start, Pose::Identity());
    EXPECT_LT((LeftDifference(from, PerturbLeft(delta, from)) - delta).norm(), 1e-9);
  }
}

TEST(Measure, ErrorsAsBuiltAreThoseFromTheBoxes) {
  Vector6d motion;
  motion << 0.006, 0, -0.004, 0, 0.005, 0;
  const Pose moved = PerturbLeft(motion, Pose::Identity());
  Ring ring = MakeRing(std::vector<Pose>(PaperStructure().boxes().size(), moved));
  ring.still.nominal_from_built = moved.inverse();
  StoredSegmenter segmenter = ring.rig.PerfectSegmenter();
  const std::vector<EvaluatedCase> cases = EvaluateStill(ring.still, {{"volalign", {}}}, segmenter);
  for (std::size_t i = 0; i < 3; ++i) {
    const EvaluatedSensor& sensor = cases.at(0).results.at(i);
    const Eigen::Vector3d position = ring.rig.frames[i].ground_truth->translation();
    ASSERT_TRUE(sensor.nominal && sensor.built);
    EXPECT_LT(sensor.built->refined.translation_m, 1.5e-3) << sensor.name;
    EXPECT_LT(sensor.built->refined.rotation_deg, 0.05) << sensor.name;
    EXPECT_NEAR(sensor.nominal->refined.rotation_deg, 0.005 * 180 / M_PI, 0.05) << sensor.name;
    EXPECT_NEAR(sensor.nominal->refined.translation_m,
                (moved.inverse() * position - position).norm(), 1.5e-3)
        << sensor.name;
    EXPECT_LT((sensor.nominal->delta - motion).norm(), 3e-3) << sensor.name;
  }
}

TEST(Measure, SensorsAreMeasuredInTheFirstPlacement) {
  Ring ring = MakeRing();
  StoredSegmenter segmenter = ring.rig.PerfectSegmenter();
  Vector6d motion;
  motion << 0.3, 0, -0.2, 0, 0.6, 0;
  AddPlacement(PerturbLeft(motion, Pose::Identity()), &ring, &segmenter);
  // S2 sees the structure at its second place alone.
  std::fill(ring.still.frames[2].depth.begin(), ring.still.frames[2].depth.end(), 2.0F);
  std::fill(ring.still.labels[2].begin(), ring.still.labels[2].end(), 0);
  const std::vector<EvaluatedCase> cases = EvaluateStill(ring.still, {{"volalign", {}}}, segmenter);
  ASSERT_EQ(cases.at(0).results.size(), 3u);
  for (const EvaluatedSensor& sensor : cases[0].results) {
    EXPECT_EQ(sensor.sides_fix_pose, true) << sensor.name;
    ASSERT_TRUE(sensor.nominal) << sensor.name << " " << ToString(sensor.code);
    EXPECT_LT(sensor.nominal->refined.translation_m, 3e-3) << sensor.name;
    EXPECT_LT(sensor.nominal->refined.rotation_deg, 0.1) << sensor.name;
  }
}

TEST(Measure, TheNetworkSeesEachFrameOnce) {
  Ring ring = MakeRing();
  CountingSegmenter segmenter(ring.rig.PerfectSegmenter());
  const std::vector<EvaluatedCase> cases = EvaluateStill(ring.still, TwoVariants(), segmenter);
  EXPECT_EQ(segmenter.frames, 3);
  ASSERT_EQ(cases.size(), 2u);
  EXPECT_EQ(cases[0].variant, "network");
  EXPECT_EQ(cases[1].variant, "paper");
  // As if each variant had run alone.
  for (std::size_t i = 0; i < 2; ++i) {
    StoredSegmenter own = ring.rig.PerfectSegmenter();
    const CalibrationResult alone =
        Calibrate(ring.still.frames, ring.still.structure, own, TwoVariants()[i].options);
    for (std::size_t j = 0; j < 3; ++j) {
      EXPECT_DOUBLE_EQ(cases[i].results[j].nominal->refined.translation_m,
                       alone.sensors[j].error->translation_m);
      EXPECT_DOUBLE_EQ(cases[i].results[j].nominal->initial.translation_m,
                       alone.sensors[j].initial_error->translation_m);
    }
  }
}

TEST(Measure, ASensorThatSeesEnoughAndFailsIsLost) {
  Ring ring = MakeRing();
  StoredSegmenter segmenter;
  // S0 is segmented well, S1 not at all, S2 truly shows one side and is not segmented either.
  segmenter.Store(ring.rig.frames[0].depth, Certain(ring.rig.labels[0]));
  for (std::uint8_t& label : ring.still.labels[2]) {
    if (ring.still.structure.SideNames().at(0) !=
        (label ? ring.still.structure.SideOfLabel(label).name : std::string())) {
      label = 0;
    }
  }
  CalibrateOptions options;
  options.initial.method = PoseMethod::kNetwork;  // geometry would find all three
  std::vector<EvaluatedCase> cases = EvaluateStill(ring.still, {{"volalign", options}}, segmenter);
  cases[0].rig = "ring";
  cases[0].sensors = "kinect";
  const std::vector<EvaluationSummary> summaries = SummariseCases(cases);
  ASSERT_EQ(summaries.size(), 1u);
  EXPECT_EQ(summaries[0].count, 3);
  EXPECT_EQ(summaries[0].placed, 1);
  EXPECT_EQ(summaries[0].fixable, 2);
  EXPECT_EQ(summaries[0].lost, 1);
  EXPECT_EQ(summaries[0].wrong, 0);
  const std::string text = FormatEvaluation(cases);
  EXPECT_NE(text.find("sensor S1: lost (no_structure)"), std::string::npos) << text;
  EXPECT_EQ(text.find("sensor S2"), std::string::npos) << text;
}

}  // namespace
}  // namespace volalign::measure_test
