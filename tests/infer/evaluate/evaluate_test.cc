#include "infer/evaluate/evaluate.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "core/error.h"
#include "core/file_util.h"
#include "core/random.h"
#include "tests/core/expect_error.h"
#include "tests/core/temp_folder.h"
#include "tests/infer/synthetic.h"

namespace volalign {
namespace {

using testing_infer::Certain;
using testing_infer::PaperStructure;
using testing_infer::RingPose;
using testing_infer::StoredSegmenter;

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

struct Ring {
  EvaluationStill still;
  testing_infer::Rig rig;
};

/// Sensors about the structure, its boxes displaced by `offsets` where there are some.
Ring MakeRing(const std::vector<Pose>& offsets = {}, int sensors = 3) {
  const Structure nominal = PaperStructure();
  Ring ring{{}, {offsets.empty() ? nominal : nominal.Displaced(offsets), {}, {}}};
  for (int i = 0; i < sensors; ++i) {
    ring.rig.Add("S" + std::to_string(i), RingPose(120.0 * i + 20, 2.0, 0.3 + 0.05 * i));
  }
  ring.still.structure = nominal;
  ring.still.frames = ring.rig.frames;
  ring.still.labels = ring.rig.labels;
  return ring;
}

std::vector<EvaluationVariant> TwoVariants() {
  EvaluationVariant exposed{"exposed", {}}, centre{"centre", {}};
  centre.options.initial.keypoints = KeypointKind::kCentre;
  return {exposed, centre};
}

TEST(Evaluate, LeftDifferenceUndoesPerturbLeft) {
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

/// Moving every box by one rigid motion moves the sensors by its inverse, as seen from the boxes.
TEST(Evaluate, TheFrameAsBuiltFollowsTheBoxes) {
  Vector6d motion;
  motion << 0.006, 0, -0.004, 0, 0.005, 0;
  const Pose moved = PerturbLeft(motion, Pose::Identity());
  RigCapture capture;
  capture.structure = PaperStructure();
  capture.box_offsets.assign(capture.structure.boxes().size(), moved);
  const EvaluationStill still = StillOf(capture);
  EXPECT_LT((still.nominal_from_built.matrix() - moved.inverse().matrix()).norm(), 1e-9);

  Ring ring = MakeRing(capture.box_offsets);
  ring.still.nominal_from_built = still.nominal_from_built;
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

TEST(Evaluate, TheNetworkSeesEachFrameOnce) {
  Ring ring = MakeRing();
  CountingSegmenter segmenter(ring.rig.PerfectSegmenter());
  const std::vector<EvaluatedCase> cases = EvaluateStill(ring.still, TwoVariants(), segmenter);
  EXPECT_EQ(segmenter.frames, 3);
  ASSERT_EQ(cases.size(), 2u);
  EXPECT_EQ(cases[0].variant, "exposed");
  EXPECT_EQ(cases[1].variant, "centre");
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

TEST(Evaluate, ASensorThatSeesEnoughAndFailsIsLost) {
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
  std::vector<EvaluatedCase> cases = EvaluateStill(ring.still, {{"volalign", {}}}, segmenter);
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

EvaluatedSensor Measured(double initial_mm, double refined_mm, double deg) {
  EvaluatedSensor sensor;
  sensor.name = "S";
  sensor.status = "ok";
  sensor.sides_fix_pose = true;
  sensor.nominal = EvaluatedSensor::Errors{
      {initial_mm / 1000, 2 * deg}, {refined_mm / 1000, deg}, Vector6d::Zero()};
  return sensor;
}

TEST(Evaluate, SummariesAreTheDefinitions) {
  EvaluatedCase ring{"", "ring", "kinect", "a", 1, {}, {}};
  for (int i = 1; i <= 21; ++i) ring.results.push_back(Measured(10 * i, i, 0.01 * i));
  EvaluatedCase arc{"", "arc", "kinect", "a", 1, {Measured(5, 150, 0.1), Measured(5, 1, 6)}, {}};
  arc.results[0].status = "weak";
  EvaluatedCase other{"", "ring", "d415", "a", 1, {Measured(7, 7, 7)}, {}};
  const std::vector<EvaluationSummary> all = SummariseCases({ring, arc, other});
  std::vector<std::string> names;
  for (const EvaluationSummary& s : all) names.push_back(s.rig + "/" + s.sensors);
  EXPECT_EQ(names, (std::vector<std::string>{"ring/kinect", "ring/d415", "arc/kinect",
                                             "all rigs/kinect", "all rigs/d415", "all rigs/all"}));
  EXPECT_NEAR(all[0].refined_mm.median, 11, 1e-9);
  EXPECT_NEAR(all[0].refined_mm.p95, 20, 1e-9);
  EXPECT_NEAR(all[0].refined_mm.max, 21, 1e-9);
  EXPECT_NEAR(all[0].initial_mm.median, 110, 1e-9);
  EXPECT_NEAR(all[0].refined_deg.max, 0.21, 1e-9);
  EXPECT_NEAR(all[0].initial_deg.max, 0.42, 1e-9);
  EXPECT_EQ(all[0].wrong, 0);
  EXPECT_EQ(all[2].wrong, 2);
  EXPECT_EQ(all[2].weak, 1);
  EXPECT_EQ(all[5].count, 24);
  EXPECT_EQ(all[5].wrong, 3);
}

TEST(Evaluate, IntervalsOfNormalErrorsCoverWhatTheySay) {
  RandomStream random(3, 0, "evaluate_test");
  EvaluatedCase one{"", "ring", "kinect", "a", 1, {}, {}};
  for (int i = 0; i < 4000; ++i) {
    EvaluatedSensor sensor = Measured(1, 1, 1);
    sensor.built = sensor.nominal;
    for (int j = 0; j < 6; ++j) {
      sensor.sigma[j] = 0.001 * (j + 1);
      sensor.nominal->delta[j] = random.Normal(0, sensor.sigma[j]);
      sensor.built->delta[j] = 2 * sensor.nominal->delta[j];
    }
    one.results.push_back(sensor);
  }
  const EvaluationSummary summary = SummariseCases({one}).at(0);
  EXPECT_NEAR(summary.cover68, 0.68, 0.01);
  EXPECT_NEAR(summary.cover95, 0.95, 0.005);
  // P(|z| < 0.4972) and P(|z| < 0.98) of the standard normal.
  EXPECT_NEAR(summary.built_cover68, 0.381, 0.01);
  EXPECT_NEAR(summary.built_cover95, 0.673, 0.01);
}

class EvaluateFiles : public testing::Test {
 protected:
  EvaluateFiles() : ring_(MakeRing({}, 1)), segmenter_(ring_.rig.PerfectSegmenter()) {
    for (EvaluationVariant& variant : variants_) {
      variant.options.refine.outer_iterations = 1;
      variant.options.refine.max_side_points = 300;
    }
    run_.output = folder_ / "evaluation.json";
    run_.model_file = "model.pt";
    run_.model_sha256 = "abc";
    run_.program = "1";
    run_.progress = [this](const std::string& line) { lines_.push_back(line); };
  }

  std::vector<EvaluationItem> Items(int count) {
    std::vector<EvaluationItem> items;
    for (int i = 0; i < count; ++i) {
      EvaluationItem item;
      item.rig = "ring";
      item.sensors = "kinect";
      item.seed = static_cast<std::uint64_t>(i);
      item.identity = std::to_string(i);
      item.load = [this, i] {
        if (i == fail_at_) throw IoError("gone");
        ++loaded_;
        return ring_.still;
      };
      items.push_back(item);
    }
    return items;
  }
  std::vector<EvaluatedCase> Run(const std::vector<EvaluationItem>& items) {
    return Evaluate(items, variants_, segmenter_, ring_.still.structure, run_);
  }

  TempFolder folder_;
  Ring ring_;
  StoredSegmenter segmenter_;
  EvaluateRun run_;
  std::vector<EvaluationVariant> variants_ = TwoVariants();
  std::vector<std::string> lines_;
  int loaded_ = 0, fail_at_ = -1;
};

TEST_F(EvaluateFiles, AKilledRunContinues) {
  fail_at_ = 2;
  ExpectError<IoError>([&] { Run(Items(3)); }, {"gone"});
  EXPECT_EQ(loaded_, 2);
  EXPECT_EQ(ReadEvaluation(run_.output).size(), 4u);
  fail_at_ = -1;
  const std::vector<EvaluatedCase> cases = Run(Items(3));
  EXPECT_EQ(loaded_, 3);
  ASSERT_EQ(cases.size(), 6u);
  EXPECT_EQ(cases[5].seed, 2u);
  EXPECT_EQ(lines_.size(), 2u + 3u);

  const std::string written = ReadFile(run_.output);
  Run(Items(3));
  EXPECT_EQ(loaded_, 3);
  EXPECT_EQ(ReadFile(run_.output), written);

  // Whatever the outcome depends on makes it new.
  run_.program = "2";
  Run(Items(3));
  EXPECT_EQ(loaded_, 6);
  variants_[1].options.refine.edge_weight = 3;
  Run(Items(3));
  EXPECT_EQ(loaded_, 9);
  std::vector<EvaluationItem> items = Items(3);
  items[1].identity = "another";
  Run(items);
  EXPECT_EQ(loaded_, 10);
}

TEST_F(EvaluateFiles, ReadsBackWhatItWrote) {
  const std::vector<EvaluatedCase> cases = Run(Items(1)), read = ReadEvaluation(run_.output);
  ASSERT_EQ(read.size(), cases.size());
  for (std::size_t i = 0; i < cases.size(); ++i) {
    EXPECT_EQ(read[i].rig, cases[i].rig);
    EXPECT_EQ(read[i].sensors, cases[i].sensors);
    EXPECT_EQ(read[i].variant, cases[i].variant);
    EXPECT_EQ(read[i].seed, cases[i].seed);
    EXPECT_EQ(read[i].timings_s, cases[i].timings_s);
    for (std::size_t j = 0; j < cases[i].results.size(); ++j) {
      const EvaluatedSensor &a = cases[i].results[j], &b = read[i].results[j];
      EXPECT_EQ(a.status, b.status);
      EXPECT_EQ(a.sides, b.sides);
      EXPECT_EQ(a.sides_fix_pose, b.sides_fix_pose);
      EXPECT_EQ(a.rms_to_structure_m, b.rms_to_structure_m);
      EXPECT_EQ(a.sigma, b.sigma);
      ASSERT_TRUE(a.nominal && b.nominal && a.built && b.built);
      EXPECT_EQ(a.nominal->delta, b.nominal->delta);
      EXPECT_EQ(a.built->refined.translation_m, b.built->refined.translation_m);
      EXPECT_EQ(a.nominal->initial.rotation_deg, b.nominal->initial.rotation_deg);
    }
  }
  EXPECT_EQ(FormatEvaluation(read), FormatEvaluation(cases));
}

TEST_F(EvaluateFiles, RejectsAnotherStructure) {
  const Structure one = Structure::FromBoxes(
      "one", {Box::FromMinMax("box", Eigen::Vector3d::Zero(), Eigen::Vector3d::Ones())});
  ExpectError<DataError>([&] { Evaluate(Items(1), variants_, segmenter_, one, run_); },
                         {"ring", "other sides", "\"one\""});
  WriteFileAtomically(run_.output, "{\"cases\": []}");
  ExpectError<DataError>([&] { Run(Items(1)); }, {"evaluation.json", "another folder"});
}

TEST(Evaluate, ParsesSeeds) {
  EXPECT_EQ(ParseSeeds("3:6"), (std::vector<std::uint64_t>{3, 4, 5}));
  EXPECT_EQ(ParseSeeds("7"), (std::vector<std::uint64_t>{7}));
  EXPECT_EQ(ParseSeeds("9,1"), (std::vector<std::uint64_t>{9, 1}));
  for (const char* bad : {"", "3:", ":3", "3:3", "5:2", "a", "1,,2", "1,1", "-1", "1.5", "1:2:3"}) {
    ExpectError<ConfigError>([&] { ParseSeeds(bad); }, {"--seeds"});
  }
}

}  // namespace
}  // namespace volalign
