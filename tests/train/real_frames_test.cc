#include "train/real_frames.h"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "core/base/file_util.h"
#include "core/formats/image_io.h"
#include "core/geometry/lens.h"
#include "core/geometry/visibility.h"
#include "core/nn/checkpoint.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/core/base/temp_folder.h"
#include "tests/train/synthetic_source.h"
#include "train/checkpoint_validation.h"
#include "train/training_data.h"

namespace volalign::real_frames_test {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

constexpr float kWall = 4;  // m, behind the structure

const Structure& Boxes() {
  static const Structure structure = ReadStructure("configs/structure.yaml");
  return structure;
}

Intrinsics Lens() { return {160, 144, 130, 131, 79.2, 71.8, {-0.08, 0.02, 0.001, -0.001}}; }
constexpr char kLens[] = R"({"width": 160, "height": 144, "fx": 130, "fy": 131, "cx": 79.2,
                             "cy": 71.8, "distortion": [-0.08, 0.02, 0.001, -0.001]})";

/// A sensor on its side, as the recipes' are, and one that stands.
Pose Seen(double roll_deg) { return LookAt({1.6, 0.4, 1.1}, {0, 0.05, 0}, roll_deg * M_PI / 180); }

/// What a sensor measures of the structure before a wall, to whole millimetres.
DepthImage Measured(const Structure& structure, const Pose& pose) {
  DepthImage depth = CastView(structure, ComputeRays(Lens()), pose).depth;
  for (float& z : depth) z = z > 0 ? std::round(z * 1000) / 1000 : kWall;
  return depth;
}

RealFrame Frame(const DepthImage& depth, const Pose& pose) {
  RealFrame frame;
  frame.name = "frame";
  frame.depth = depth;
  frame.intrinsics = Lens();
  frame.structure_from_sensor = pose;
  frame.structure = std::make_shared<const Structure>(Boxes());
  return frame;
}

int CountLabelled(const LabelImage& labels) {
  return static_cast<int>(labels.size()) -
         static_cast<int>(std::count(labels.begin(), labels.end(), 0));
}

TEST(LabelledSample, HasTheLabelsOfTheStructureAtItsSize) {
  const Pose pose = Seen(90);
  const std::unique_ptr<Sample> sample =
      LabelledSample(Frame(Measured(Boxes(), pose), pose), 80, 72, {90});
  ASSERT_TRUE(sample);
  EXPECT_TRUE(sample->structure_from_sensor.isApprox(pose));
  const ExpectedView expected = CastView(Boxes(), ComputeRays(Lens().Resized(80, 72)), pose);
  const int all = CountLabelled(expected.labels), labelled = CountLabelled(sample->labels);
  // Depth is the nearest pixel's: only where sides end may it be that of another.
  EXPECT_GT(all, 500);
  EXPECT_GT(labelled, 0.93 * all);
  for (std::size_t i = 0; i < sample->labels.size(); ++i) {
    if (sample->labels[i] > 0) {
      EXPECT_EQ(sample->labels[i], expected.labels[i]);
    }
    if (sample->depth[i] == 0) {
      EXPECT_EQ(sample->labels[i], 0);
    }
  }
  EXPECT_EQ(sample->depth(0, 0), kWall);  // background keeps its depth
}

TEST(LabelledSample, LeavesOutWhatStandsBeforeTheBoxes) {
  const Pose pose = Seen(90);
  DepthImage depth = Measured(Boxes(), pose);
  for (const auto [u, v] : Pixels({60, 50}, {90, 90})) depth(u, v) = 1.0F;
  const std::unique_ptr<Sample> sample = LabelledSample(Frame(depth, pose), 160, 144, {90});
  const LabelImage expected = CastView(Boxes(), ComputeRays(Lens()), pose).labels;
  for (const auto [u, v] : Pixels({60, 50}, {90, 90})) {
    EXPECT_EQ(sample->labels(u, v), 0);
    if (expected(u, v) > 0) {
      EXPECT_EQ(sample->depth(u, v), 0);
    }
  }
  EXPECT_GT(CountLabelled(sample->labels), 500);
}

/// A side of a box that the calibration puts a centimetre too far in: what is measured beyond its
/// edge is not called background.
TEST(LabelledSample, KnowsNoLabelJustBesideTheStructure) {
  const Pose pose = Seen(90), wrong = Eigen::Translation3d(0, 0.01, 0) * pose;
  const LabelImage truth = CastView(Boxes(), ComputeRays(Lens()), pose).labels;
  const std::unique_ptr<Sample> sample =
      LabelledSample(Frame(Measured(Boxes(), pose), wrong), 160, 144, {90});
  int called_background = 0;
  for (std::size_t i = 0; i < truth.size(); ++i)
    called_background += truth[i] > 0 && sample->labels[i] == 0 && sample->depth[i] > 0;
  EXPECT_LT(called_background, 0.01 * CountLabelled(truth));
}

TEST(LabelledSample, TurnsToTheMountingOfTheRecipe) {
  const Pose lying = Seen(90);
  for (const double roll : {90.0, 270.0}) {
    const Pose pose = Seen(roll);
    const std::unique_ptr<Sample> sample =
        LabelledSample(Frame(Measured(Boxes(), pose), pose), 160, 144, {90});
    ASSERT_TRUE(sample) << roll;
    EXPECT_LT(ComparePoses(sample->structure_from_sensor, lying).rotation_deg, 1e-6) << roll;
    EXPECT_GT(CountLabelled(sample->labels), 2000) << roll;
  }
  // Upright, it would be an image of another shape.
  const Pose standing = Seen(0);
  const RealFrame frame = Frame(Measured(Boxes(), standing), standing);
  EXPECT_FALSE(LabelledSample(frame, 160, 144, {90}));
  const std::unique_ptr<Sample> turned = LabelledSample(frame, 144, 160, {90});
  ASSERT_TRUE(turned);
  EXPECT_LT(ComparePoses(turned->structure_from_sensor, lying).rotation_deg, 1e-6);
  EXPECT_GT(CountLabelled(turned->labels), 2000);
  EXPECT_TRUE(LabelledSample(frame, 160, 144, {90, 0}));
}

constexpr char kRecipe[] =
    "data: {image_sizes: [80x72], sensors: [azure_kinect_nfov_binned], renderer: cpu}";

class ACalibration : public testing::Test {
 protected:
  ACalibration() {
    // The top box stands 20 mm beside its place, turned by 3 deg.
    std::vector<Pose> offsets(Boxes().boxes().size(), Pose::Identity());
    const Box& box = Boxes().boxes().back();
    const Eigen::Translation3d centre(box.structure_from_box.translation());
    offsets.back() = Eigen::Translation3d(0.02, 0, -0.01) * centre *
                     Eigen::AngleAxisd(3 * M_PI / 180, Eigen::Vector3d::UnitY()) * centre.inverse();
    built_ = Boxes().Displaced(offsets);
    const Pose pose = Seen(90);
    fs::create_directory(folder_ / "capture");
    WritePng(folder_ / "capture" / "a.png", FromMetres(Measured(built_, pose), 0.001));
    json sensor = {{"status", "ok"},
                   {"structure_from_sensor", ToRows(pose)},
                   {"intrinsics", json::parse(kLens)},
                   {"depth", "a.png"},
                   {"depth_scale", 0.001},
                   {"depth_gain", 1.0},
                   {"depth_offset_m", 0.0},
                   {"sensor", "azure_kinect_nfov_binned"}};
    file_ = {
        {"format", "volalign.extrinsics/1"},
        {"verdict", "ok"},
        {"structure", {{"name", "structure"}, {"sha256", Boxes().Hash()}}},
        {"capture", (folder_ / "capture" / "capture.json").string()},
        {"boxes", {{{"name", box.name}, {"translation_m", {0.02, 0, -0.01}}, {"yaw_deg", 3.0}}}},
        {"size", {{"scale", 1.0}}},
        {"sensors", {{"a", sensor}}}};
    file_["sensors"]["b"] = sensor;
    file_["sensors"]["b"]["status"] = "weak";
  }

  std::string Write() {
    const fs::path path = folder_ / "extrinsics.json";
    WriteFileAtomically(path, file_.dump());
    return path.string();
  }

  TempFolder folder_;
  Structure built_ = Boxes();
  json file_;
};

TEST_F(ACalibration, GivesTheFramesOfItsGoodSensorsWithTheBoxesAsTheyStood) {
  const std::vector<RealFrame> frames = ReadRealFrames({Write()}, Boxes());
  ASSERT_EQ(frames.size(), 1u);
  EXPECT_EQ(frames[0].sensor, "azure_kinect_nfov_binned");
  const std::unique_ptr<Sample> sample = LabelledSample(frames[0], 160, 144, {90});
  const LabelImage expected = CastView(built_, ComputeRays(Lens()), Seen(90)).labels;
  EXPECT_GT(CountLabelled(sample->labels), 0.999 * CountLabelled(expected));
  for (std::size_t i = 0; i < expected.size(); ++i) {
    if (sample->depth[i] > 0) {
      EXPECT_EQ(sample->labels[i], expected[i]) << i;
    }
  }
}

TEST_F(ACalibration, IsRefusedWhereItIsNotAcceptedOrOfAnotherStructure) {
  const auto refused = [&](const char* key, const json& value, const std::string& part) {
    const json before = file_;
    file_[json::json_pointer(key)] = value;
    const std::string path = Write();
    ExpectError<ConfigError>([&] { ReadRealFrames({path}, Boxes()); }, {path, part});
    file_ = before;
  };
  refused("/verdict", "weak", "verdict weak");
  refused("/structure/sha256", "0", "another structure");
  refused("/capture", {"a.json", "b.json"}, "several captures");
  refused("/sensors/a/status", "failed", "no sensor");
  file_["sensors"]["a"]["depth"] = "none.png";
  const std::string path = Write();
  ExpectError<IoError>([&] { ReadRealFrames({path}, Boxes()); }, {"none.png"});
}

TEST_F(ACalibration, IsMixedIntoTrainingOrHeldOut) {
  TrainConfig config = ConfigOf(kRecipe);
  config.data.real.calibrations = {Write()};
  config.data.real.share = 0.4;
  config.run.batch_size = 5;
  const TrainingData mixed = OpenTrainingData(config);
  config.data.real.calibrations.clear();
  config.data.real.validation = {Write()};
  const TrainingData held = OpenTrainingData(config);

  const auto source = mixed.open_training(0), rendered = held.open_training(0);
  const auto later = mixed.open_training(50);
  int real = 0;
  for (int batch = 0; batch < 20; ++batch) {
    const std::vector<Sample> samples = source(), others = rendered();
    const std::vector<Sample> again = batch < 10 ? samples : later();
    for (std::size_t i = 0; i < samples.size(); ++i) {
      EXPECT_EQ(samples[i].index, others[i].index);
      EXPECT_TRUE(samples[i].depth == again[i].depth);  // whatever was drawn before
      const bool is_real =
          ComparePoses(samples[i].structure_from_sensor, Seen(90)).rotation_deg < 1;
      real += is_real;
      if (!is_real) {
        EXPECT_TRUE(samples[i].depth == others[i].depth);
      }
    }
  }
  EXPECT_NEAR(real, 40, 15);  // three standard deviations of 100 draws
  EXPECT_NE(mixed.identity, held.identity);

  EXPECT_EQ(held.validation_frames, 1);
  const std::vector<Sample> scored = held.open_validation()();
  ASSERT_EQ(scored.size(), 1u);
  EXPECT_GT(CountLabelled(scored[0].labels), 500);

  config.data.real.calibrations = config.data.real.validation;
  ExpectError<ConfigError>([&] { OpenTrainingData(config); }, {"validation would see"});
  config.data.real.calibrations.clear();
  config.data.image_sizes = {"160x90"};
  config.data.sensors = {"realsense_d415"};
  ExpectError<ConfigError>([&] { OpenTrainingData(config); }, {"a.png", "image_sizes"});
}

TEST_F(ACalibration, HasACheckpointScoredOnItsFrames) {
  TrainConfig config = ConfigOf(kRecipe);
  config.data.real.validation = {Write()};
  LoadedModel model = LoadCheckpoint("models/m05-lite.safetensors");
  const ValidationResult result = ValidateCheckpoint(model, config, 1000);
  ASSERT_EQ(result.samples, 1);
  EXPECT_EQ(result.scores.at(0).sensor, "azure_kinect_nfov_binned");
  EXPECT_NEAR(result.scores.at(0).rho_m, std::hypot(1.6, 1.1), 1e-6);
}

/// So that --resume refuses them.
TEST_F(ACalibration, OfOtherDepthIsAnotherSetOfSamples) {
  TrainConfig config = ConfigOf(kRecipe);
  config.data.real.calibrations = {Write()};
  const std::string identity = OpenTrainingData(config).identity;
  EXPECT_EQ(OpenTrainingData(config).identity, identity);
  DepthImage depth = Measured(built_, Seen(90));
  depth(3, 4) += 0.001F;
  WritePng(folder_ / "capture" / "a.png", FromMetres(depth, 0.001));
  EXPECT_NE(OpenTrainingData(config).identity, identity);
}

}  // namespace
}  // namespace volalign::real_frames_test
