#include "infer/evaluate/evaluate.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "core/base/file_util.h"
#include "core/base/random.h"
#include "infer/evaluate/items.h"
#include "infer/evaluate/measure.h"
#include "infer/evaluate/statistics.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::evaluate_test {
namespace {

using namespace testing_infer;
using testing_infer::Rig;

struct Ring {
  EvaluationCapture capture;
  Rig rig;
};

/// Sensors about the structure, its boxes displaced by `offsets` where there are some.
Ring MakeRing(const std::vector<Pose>& offsets = {}, int sensors = 3) {
  const Structure nominal = PaperStructure();
  Ring ring{{}, {offsets.empty() ? nominal : nominal.Displaced(offsets), {}, {}}};
  for (int i = 0; i < sensors; ++i) ring.rig.Add(RingPose(120.0 * i + 20, 2.0, 0.3 + 0.05 * i));
  ring.capture.structure = nominal;
  ring.capture.frames = ring.rig.frames;
  ring.capture.labels = ring.rig.labels;
  return ring;
}

/// Adds a capture of the same sensors while the structure stands elsewhere, and its labels to the
/// segmenter.
void AddPlacement(const Pose& first_from_placement, Ring* ring, StoredSegmenter* segmenter) {
  Rig there{ring->rig.structure, {}, {}};
  for (const SensorFrame& frame : ring->rig.frames) {
    there.Add(frame.name, first_from_placement.inverse() * *frame.ground_truth);
    segmenter->Store(there.frames.back().depth, Certain(there.labels.back()));
  }
  ring->capture.further.push_back({there.frames, there.labels});
}

std::vector<EvaluationVariant> TwoVariants() {
  EvaluationVariant both{"auto", {}}, network{"network", {}};
  network.options.initial.method = PoseMethod::kNetwork;
  return {both, network};
}

class EvaluateFiles : public testing::Test {
 protected:
  EvaluateFiles() : ring_(MakeRing({}, 1)), segmenter_(ring_.rig.PerfectSegmenter()) {
    for (EvaluationVariant& variant : variants_) variant.options.refine.max_side_points = 300;
    run_.output = folder_ / "evaluation.json";
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
        return ring_.capture;
      };
      items.push_back(item);
    }
    return items;
  }
  std::vector<EvaluatedCase> Run(const std::vector<EvaluationItem>& items) {
    return Evaluate(items, variants_, models_, run_);
  }

  TempFolder folder_;
  Ring ring_;
  StoredSegmenter segmenter_;
  std::vector<EvaluationModel> models_{
      {{"model.safetensors", "abc"}, &segmenter_, &ring_.capture.structure}};
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
  variants_[1].options.refine.box_sigma_m = 0.006;
  Run(Items(3));
  EXPECT_EQ(loaded_, 9);
  std::vector<EvaluationItem> items = Items(3);
  items[1].identity = "another";
  Run(items);
  EXPECT_EQ(loaded_, 10);
}

TEST_F(EvaluateFiles, ReadsBackWhatItWrote) {
  std::vector<EvaluatedCase> cases = Run(Items(1));
  cases[1].placements = 4;
  WriteEvaluation(run_.output, cases, {{"m", "s"}});
  const std::vector<EvaluatedCase> read = ReadEvaluation(run_.output);
  ASSERT_EQ(read.size(), cases.size());
  EXPECT_EQ(read[1].placements, 4);
  EXPECT_EQ(FormatEvaluation(read), FormatEvaluation(cases));
  // All that it wrote is read, as what is read is written as it was.
  const std::string written = ReadFile(run_.output);
  WriteEvaluation(run_.output, read, {{"m", "s"}});
  EXPECT_EQ(ReadFile(run_.output), written);
}

/// Each model under each variant; one more model costs only what it adds.
TEST_F(EvaluateFiles, ComparesModels) {
  for (EvaluationVariant& variant : variants_)
    variant.options.initial.method = PoseMethod::kNetwork;
  Run(Items(2));
  StoredSegmenter blind;
  models_.push_back({{"runs/blind.pt", "def"}, &blind, &ring_.capture.structure});
  const std::vector<EvaluatedCase> cases = Run(Items(2));
  ASSERT_EQ(cases.size(), 8u);
  EXPECT_EQ(cases[0].variant, "model, " + variants_[0].name);
  EXPECT_EQ(cases[3].variant, "blind, " + variants_[1].name);
  EXPECT_TRUE(cases[0].results[0].placed());
  EXPECT_FALSE(cases[3].results[0].placed());
  EXPECT_EQ(cases[5].seed, 1u);
  variants_.pop_back();
  EXPECT_EQ(Run(Items(1)).at(1).variant, "blind");
  EXPECT_TRUE(Has(ReadFile(run_.output), "\"sha256\": \"def\""));
  models_[1].checkpoint.file = "other/model.safetensors";
  ExpectError<ConfigError>([&] { Run(Items(1)); }, {"other/model.safetensors", "called model too"});
}

TEST_F(EvaluateFiles, RejectsAnotherStructure) {
  const Structure one = Structure::FromBoxes(
      "one", {Box::FromMinMax("box", Eigen::Vector3d::Zero(), Eigen::Vector3d::Ones())});
  ExpectError<DataError>(
      [&] {
        Evaluate(Items(1), variants_, {{{"m", "s"}, &segmenter_, &one}}, run_);
      },
      {"ring", "other sides", "\"one\""});
  WriteFileAtomically(run_.output, "{\"cases\": []}");
  ExpectError<DataError>([&] { Run(Items(1)); }, {"evaluation.json", "another folder"});
}

Vector6d Motion(double x, double z, double yaw) {
  return (Vector6d() << x, 0, z, 0, yaw, 0).finished();
}

/// Of the paper's stack, all of whose boxes stand `moved` from where they should.
RigCapture CaptureOf(const Pose& moved = Pose::Identity()) {
  RigCapture rendered;
  rendered.structure = PaperStructure();
  rendered.box_offsets.assign(rendered.structure.boxes().size(), moved);
  return rendered;
}

/// Moving every box by one rigid motion moves the sensors by its inverse, as seen from the boxes.
TEST(Items, TheFrameAsBuiltFollowsTheBoxes) {
  const Pose moved = PerturbLeft(Motion(0.006, -0.004, 0.005), Pose::Identity());
  const EvaluationCapture capture = EvaluationCaptureOf(CaptureOf(moved));
  EXPECT_LT((capture.nominal_from_built.matrix() - moved.inverse().matrix()).norm(), 1e-9);
}

TEST(Items, CapturesOfPlacementsKeepTheFrameOfTheFirst) {
  std::vector<RigCapture> captures = {
      CaptureOf(), CaptureOf(PerturbLeft(Motion(0.006, -0.004, 0.005), Pose::Identity()))};
  for (RigCapture& capture : captures) {
    capture.sensors.resize(1);
    capture.sensors[0].labels = LabelImage(2, 2);
  }
  captures[1].sensors[0].structure_from_sensor.translation().x() = 3;
  captures[1].sensors[0].labels(1, 1) = 4;
  const EvaluationCapture capture = EvaluationCaptureOf(captures);
  EXPECT_LT((capture.nominal_from_built.matrix() - Eigen::Matrix4d::Identity()).norm(), 1e-9);
  EXPECT_EQ(capture.frames.at(0).ground_truth->translation().x(), 0);
  ASSERT_EQ(capture.further.size(), 1u);
  EXPECT_EQ(capture.further[0].frames.at(0).ground_truth->translation().x(), 3);
  EXPECT_EQ(capture.further[0].labels.at(0)(1, 1), 4);
}

TEST(Items, SensorsAreCalibratedWithWhatTheCaptureStates) {
  RigCapture rendered = CaptureOf();
  CapturedSensor sensor;
  sensor.sensor = "azure_kinect_nfov_binned";
  sensor.stated_intrinsics = Kinect();
  sensor.intrinsics = Kinect();
  sensor.intrinsics.distortion = {0.1, 0, 0, 0};
  sensor.intrinsics.fx += 1;
  rendered.sensors = {sensor};
  const EvaluationCapture capture = EvaluationCaptureOf(rendered);
  EXPECT_TRUE(capture.frames.at(0).intrinsics == sensor.stated_intrinsics);
  EXPECT_EQ(capture.frames.at(0).sensor, sensor.sensor);
}

class RigFiles : public testing::Test {
 protected:
  void SetUp() override {
    for (const char* name : {"rig_ring.yaml", "arc.yaml"})
      series_.files.push_back(
          Write(name,
                "seed: 4\nstructure_yaw_deg: 10\nsensors:\n"
                "  - {name: A, sensor: realsense_d415, image_size: 320x180}\n"));
  }
  std::string Write(const std::string& name, const std::string& yaml) {
    return folder_.Write(name, yaml).string();
  }
  std::vector<EvaluationItem> Items() { return RigItems(ReadRigs(series_), series_, nullptr); }
  std::vector<std::string> Names() {
    std::vector<std::string> names;
    for (const EvaluationItem& item : Items())
      names.push_back(item.rig + "/" + item.sensors + "/" + std::to_string(*item.seed));
    return names;
  }
  /// structure_yaw_deg of the first item's rig, from its identity, the resolved rig.
  double Yaw() {
    const std::string identity = Items().at(0).identity;
    const std::string key = "structure_yaw_deg: ";
    return std::stod(identity.substr(identity.find(key) + key.size()));
  }

  TempFolder folder_;
  RigSeries series_;
};

TEST_F(RigFiles, EveryRigWithEverySensorAndSeed) {
  EXPECT_EQ(Names(), (std::vector<std::string>{"ring/as the rig/4", "arc/as the rig/4"}));
  series_.sensors = {"realsense_d415", "azure_kinect_nfov_binned"};
  series_.seeds = {7, 8};
  series_.files.resize(1);
  EXPECT_EQ(Names(), (std::vector<std::string>{"ring/realsense_d415/7", "ring/realsense_d415/8",
                                               "ring/azure_kinect_nfov_binned/7",
                                               "ring/azure_kinect_nfov_binned/8"}));
}

TEST_F(RigFiles, EachSeedTurnsTheStructureByAGoldenAngle) {
  // 360 deg (1 - 1 / golden ratio) a seed, four of them, on top of the rig's 10 deg.
  const double golden = 360 * (1 - 2 / (1 + std::sqrt(5.0)));
  EXPECT_NEAR(Yaw(), std::fmod(10 + 4 * golden, 360), 1e-6);
  series_.keep_yaw = true;
  EXPECT_EQ(Yaw(), 10);
}

TEST_F(RigFiles, EveryNumberOfPlacementsInTurn) {
  series_.files.resize(1);
  series_.placements = {1, 3};
  series_.seeds = {7, 8};
  std::vector<int> numbers;
  std::vector<std::string> identities;
  for (const EvaluationItem& item : Items()) {
    numbers.push_back(item.placements);
    identities.push_back(item.identity);
  }
  EXPECT_EQ(numbers, (std::vector<int>{1, 1, 3, 3}));
  // One placement is the rig as it was.
  series_.placements.clear();
  const std::vector<EvaluationItem> plain = Items();
  EXPECT_EQ(plain.at(0).identity, identities[0]);
  EXPECT_EQ(plain.at(1).identity, identities[1]);
  EXPECT_NE(identities[2], identities[3]);
  // A rig's own placements come first; what it has too many of is left out.
  series_.files = {Write("rig_own.yaml",
                         "sensors: [{name: A}]\nplacements:\n  - {x_cm: 31, z_cm: 0}\n"
                         "  - {x_cm: 47, z_cm: 0}\n")};
  series_.seeds.clear();
  series_.keep_yaw = true;
  EXPECT_EQ(Items().at(0).placements, 3);
  series_.placements = {2, 5};
  const std::vector<EvaluationItem> own = Items();
  EXPECT_TRUE(Has(own.at(0).identity, "x_cm: 31"));
  EXPECT_FALSE(Has(own.at(0).identity, "x_cm: 47"));
  EXPECT_TRUE(Has(own.at(1).identity, "x_cm: 47"));
  EXPECT_EQ(own.at(1).placements, 5);
}

TEST_F(RigFiles, BadRigsAreErrors) {
  series_.changes = {"room_=1"};
  ExpectError<ConfigError>([&] { ReadRigs(series_); }, {"room_"});
  series_.changes.clear();
  series_.files[1] = series_.files[0];
  ExpectError<ConfigError>([&] { ReadRigs(series_); }, {"two are named ring"});
}

TEST(Items, ParsesSeeds) {
  EXPECT_EQ(ParseSeeds("3:6"), (std::vector<std::uint64_t>{3, 4, 5}));
  EXPECT_EQ(ParseSeeds("7"), (std::vector<std::uint64_t>{7}));
  EXPECT_EQ(ParseSeeds("9,1"), (std::vector<std::uint64_t>{9, 1}));
  for (const char* bad : {"", "3:", ":3", "3:3", "5:2", "a", "1,,2", "1,1", "-1", "1.5", "1:2:3"}) {
    ExpectError<ConfigError>([&] { ParseSeeds(bad); }, {"--seeds"});
  }
}

TEST(Measure, ErrorsAsBuiltAreThoseFromTheBoxes) {
  const Vector6d motion = Motion(0.006, -0.004, 0.005);
  const Pose moved = PerturbLeft(motion, Pose::Identity());
  Ring ring = MakeRing(std::vector<Pose>(PaperStructure().boxes().size(), moved));
  ring.capture.nominal_from_built = moved.inverse();
  StoredSegmenter segmenter = ring.rig.PerfectSegmenter();
  const std::vector<EvaluatedCase> cases =
      EvaluateCapture(ring.capture, {{"volalign", {}}}, segmenter);
  for (std::size_t i = 0; i < 3; ++i) {
    const EvaluatedSensor& sensor = cases.at(0).results.at(i);
    const Eigen::Vector3d position = ring.rig.frames[i].ground_truth->translation();
    ASSERT_TRUE(sensor.nominal && sensor.built);
    EXPECT_TRUE(Within(sensor.built->refined, 1.5e-3, 0.05)) << sensor.name;
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
  AddPlacement(PerturbLeft(Motion(0.3, -0.2, 0.6), Pose::Identity()), &ring, &segmenter);
  // S2 sees the structure at its second place alone.
  std::fill(ring.capture.frames[2].depth.begin(), ring.capture.frames[2].depth.end(), 2.0F);
  std::fill(ring.capture.labels[2].begin(), ring.capture.labels[2].end(), 0);
  const std::vector<EvaluatedCase> cases =
      EvaluateCapture(ring.capture, {{"volalign", {}}}, segmenter);
  ASSERT_EQ(cases.at(0).results.size(), 3u);
  for (const EvaluatedSensor& sensor : cases[0].results) {
    EXPECT_EQ(sensor.sides_fix_pose, true) << sensor.name;
    ASSERT_TRUE(sensor.nominal) << sensor.name << " " << ToString(sensor.code);
    EXPECT_TRUE(Within(sensor.nominal->refined, 3e-3, 0.1)) << sensor.name;
  }
}

TEST(Measure, EachVariantIsAsIfItWereAlone) {
  Ring ring = MakeRing();
  StoredSegmenter segmenter = ring.rig.PerfectSegmenter();
  const std::vector<EvaluatedCase> cases = EvaluateCapture(ring.capture, TwoVariants(), segmenter);
  ASSERT_EQ(cases.size(), 2u);
  EXPECT_EQ(cases[0].variant, "auto");
  EXPECT_EQ(cases[1].variant, "network");
  for (std::size_t i = 0; i < 2; ++i) {
    StoredSegmenter own = ring.rig.PerfectSegmenter();
    const CalibrationResult alone =
        Calibrate(ring.capture.frames, ring.capture.structure, own, TwoVariants()[i].options);
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
  for (std::uint8_t& label : ring.capture.labels[2]) {
    if (ring.capture.structure.SideNames().at(0) !=
        (label ? ring.capture.structure.SideOfLabel(label).name : std::string())) {
      label = 0;
    }
  }
  CalibrateOptions options;
  options.initial.method = PoseMethod::kNetwork;  // geometry would find all three
  std::vector<EvaluatedCase> cases =
      EvaluateCapture(ring.capture, {{"volalign", options}}, segmenter);
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
  EXPECT_TRUE(Has(text, "sensor S1: lost (no_structure)"));
  EXPECT_FALSE(Has(text, "sensor S2"));
}

EvaluatedSensor Measured(double initial_mm, double refined_mm, double deg) {
  EvaluatedSensor sensor;
  sensor.name = "S";
  sensor.status = SensorStatus::kOk;
  sensor.sides_fix_pose = true;
  sensor.nominal =
      EvaluatedErrors{{initial_mm / 1000, 2 * deg}, {refined_mm / 1000, deg}, Vector6d::Zero()};
  return sensor;
}

TEST(Statistics, SummariesAreTheDefinitions) {
  EvaluatedCase ring{"", "ring", "kinect", "a", 1, {}, {}};
  for (int i = 1; i <= 21; ++i) ring.results.push_back(Measured(10 * i, i, 0.01 * i));
  EvaluatedCase arc{"", "arc", "kinect", "a", 1, {Measured(5, 150, 0.1), Measured(5, 1, 6)}, {}};
  arc.results[0].status = SensorStatus::kWeak;
  EvaluatedCase other{"", "ring", "d415", "a", 1, {Measured(7, 7, 7)}, {}};
  const std::vector<EvaluationSummary> all = SummariseCases({ring, arc, other});
  std::vector<std::string> names;
  names.reserve(all.size());
  for (const EvaluationSummary& s : all) names.push_back(s.rig + "/" + s.sensors);
  EXPECT_EQ(names, (std::vector<std::string>{"ring/kinect", "ring/d415", "arc/kinect",
                                             "all rigs/kinect", "all rigs/d415", "all rigs/all"}));
  EXPECT_NEAR(all[0].nominal.refined_mm.median, 11, 1e-9);
  EXPECT_NEAR(all[0].nominal.refined_mm.p95, 20, 1e-9);
  EXPECT_NEAR(all[0].nominal.refined_mm.max, 21, 1e-9);
  EXPECT_NEAR(all[0].nominal.initial_mm.median, 110, 1e-9);
  EXPECT_NEAR(all[0].nominal.refined_deg.max, 0.21, 1e-9);
  EXPECT_NEAR(all[0].nominal.initial_deg.max, 0.42, 1e-9);
  EXPECT_EQ(all[0].wrong, 0);
  EXPECT_EQ(all[2].wrong, 2);
  EXPECT_EQ(all[2].weak, 1);
  EXPECT_EQ(all[5].count, 24);
  EXPECT_EQ(all[5].wrong, 3);
}

TEST(Statistics, PlacementsHaveRowsOfTheirOwn) {
  EvaluatedCase one{"", "ring", "kinect", "a", 1, {Measured(9, 4, 0.1)}, {}};
  EvaluatedCase four = one;
  four.placements = 4;
  four.results[0] = Measured(9, 2, 0.1);
  const std::vector<EvaluationSummary> all = SummariseCases({one, four});
  ASSERT_EQ(all.size(), 2u);
  EXPECT_EQ(all[0].placements, 1);
  EXPECT_NEAR(all[0].nominal.refined_mm.median, 4, 1e-9);
  EXPECT_EQ(all[1].placements, 4);
  EXPECT_NEAR(all[1].nominal.refined_mm.median, 2, 1e-9);
  const std::string text = FormatEvaluation({one, four});
  EXPECT_TRUE(Has(text, "rig   sensors  placements  variant  initial mm",
                  "ring  kinect            4  a               9.0",
                  "ring  kinect            4  a            1       1"));
}

TEST(Statistics, IntervalsOfNormalErrorsCoverWhatTheySay) {
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
  EXPECT_NEAR(summary.nominal.cover68, 0.68, 0.01);
  EXPECT_NEAR(summary.nominal.cover95, 0.95, 0.005);
  // P(|z| < 0.4972) and P(|z| < 0.98) of the standard normal.
  EXPECT_NEAR(summary.built.cover68, 0.381, 0.01);
  EXPECT_NEAR(summary.built.cover95, 0.673, 0.01);
}

TEST(Variants, OneAValueOverTheSharedOptions) {
  ConfigSource source;
  source.Set("refine.box_sigma_m=0.007");
  const auto variants = ReadVariants(source, "initial.method=geometry,network");
  ASSERT_EQ(variants.size(), 2u);
  EXPECT_EQ(variants[0].name, "geometry");
  EXPECT_EQ(variants[0].options.initial.method, PoseMethod::kGeometry);
  EXPECT_EQ(variants[1].name, "network");
  EXPECT_EQ(variants[1].options.initial.method, PoseMethod::kNetwork);
  for (const EvaluationVariant& variant : variants)
    EXPECT_EQ(variant.options.refine.box_sigma_m, 0.007);
  const auto alone = ReadVariants(source, "");
  ASSERT_EQ(alone.size(), 1u);
  EXPECT_EQ(alone[0].name, "volalign");
  EXPECT_EQ(alone[0].options.refine.box_sigma_m, 0.007);
}

TEST(Variants, BadOnesAreErrors) {
  for (const char* bad : {"initial.method", "=1", "initial.method=", "refine.box_sigma_m=0.1,0.1",
                          "refine.box_sigmas_m=0.1"}) {
    ExpectError<ConfigError>([&] { ReadVariants(ConfigSource(), bad); });
  }
}

}  // namespace
}  // namespace volalign::evaluate_test
