// The program as a user runs it: exit statuses, one-line errors, nothing half-written.

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "core/base/file_util.h"
#include "core/base/folder.h"
#include "core/config/config.h"
#include "core/formats/image_io.h"
#include "core/geometry/structure.h"
#include "core/nn/checkpoint.h"
#include "infer/calib/calibrate.h"
#include "tests/cli/run_program.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/formats/read_png.h"

namespace volalign::program_test {
namespace {

namespace fs = std::filesystem;

class Program : public testing::Test {
 protected:
  std::string Path(const std::string& name) const { return (folder_ / name).string(); }

  /// One line that begins with "error: " and holds every one of `parts`; status 1.
  static void ExpectError(const Outcome& run, const std::vector<std::string>& parts) {
    EXPECT_EQ(run.status, 1) << run.output;
    EXPECT_EQ(run.output.rfind("error: ", 0), 0u) << run.output;
    EXPECT_EQ(std::count(run.output.begin(), run.output.end(), '\n'), 1) << run.output;
    for (const std::string& part : parts) {
      EXPECT_NE(run.output.find(part), std::string::npos)
          << "'" << part << "' not in: " << run.output;
    }
  }

  /// A small noise-free capture of two sensors.
  std::string WriteSmallCapture() {
    WriteFileAtomically(
        Path("rig.yaml"),
        "room: true\nnoise: none\nseed: 3\nsensors:\n"
        "  - {name: A, sensor: azure_kinect_nfov_binned, rho_cm: 200, phi_deg: 30}\n"
        "  - {name: B, sensor: realsense_d415, rho_cm: 200, phi_deg: 80}\n");
    const Outcome run = Volalign("render --rig " + Path("rig.yaml") + " -o " + Path("capture"));
    EXPECT_EQ(run.status, 0) << run.output;
    return Path("capture/capture.json");
  }

  nlohmann::json ReadJson(const std::string& path) { return nlohmann::json::parse(ReadFile(path)); }
  void WriteJson(const std::string& path, const nlohmann::json& json) {
    WriteFileAtomically(path, json.dump(1));
  }

  void ExpectCalibrateError(const std::string& capture, const std::vector<std::string>& parts,
                            const std::string& model = "models/m05-lite.safetensors") {
    ExpectError(
        Volalign("calibrate --capture " + capture + " --model " + model + " -o " + Path("out")),
        parts);
    EXPECT_FALSE(fs::exists(Path("out/extrinsics.json")));
  }

  const TempFolder folder_;
};

TEST_F(Program, RendersACaptureOfEachPlacement) {
  WriteFileAtomically(Path("rig.yaml"),
                      "room: false\nnoise: none\nsensors: [{name: A, phi_deg: 0, rho_cm: 200}]\n"
                      "placements: [{x_cm: 50, z_cm: 0, yaw_deg: 90}]\n");
  const Outcome run = Volalign("render --rig " + Path("rig.yaml") + " -o " + Path("capture"));
  EXPECT_EQ(run.status, 0) << run.output;
  EXPECT_FALSE(fs::exists(Path("capture/capture.json")));
  for (const char* name : {"placement_1", "placement_2"}) {
    EXPECT_NE(run.output.find(Path("capture/") + name + "/capture.json"), std::string::npos);
  }
  // The sensor stands 1.5 m before the second place, on the side of the structure's own +z.
  const nlohmann::json truth = ReadJson(Path("capture/placement_2/capture.json"))["ground_truth"];
  EXPECT_NEAR(truth["A"][0][3].get<double>(), 0, 1e-9);
  EXPECT_NEAR(truth["A"][2][3].get<double>(), 1.5, 1e-9);
  const nlohmann::json first = ReadJson(Path("capture/placement_1/capture.json"))["ground_truth"];
  EXPECT_NEAR(first["A"][0][3].get<double>(), 2, 1e-9);
  EXPECT_EQ(truth["A"][1][3], first["A"][1][3]);
}

// What tells the paper's models apart (its table of models): attention, soft Procrustes, and the
// distances of the sensors. A resolved recipe is a recipe, and says the same when it is read again.
TEST_F(Program, RecipesResolve) {
  struct Recipe {
    const char *name, *attention, *procrustes, *farthest_cm, *width, *noise, *position_mm;
  };
  for (const Recipe& recipe : {Recipe{"m01", "false", "false", "225", "32", "paper", "0"},
                               {"m02", "true", "false", "225", "32", "paper", "0"},
                               {"m03", "true", "true", "225", "32", "paper", "0"},
                               {"m04", "true", "false", "275", "32", "paper", "0"},
                               {"m05", "true", "true", "275", "32", "paper", "0"},
                               {"m06", "true", "false", "350", "32", "paper", "0"},
                               {"m07", "true", "true", "350", "32", "paper", "0"},
                               {"m05-lite", "true", "true", "275", "8", "sensor", "3"}}) {
    SCOPED_TRACE(recipe.name);
    const Outcome run = Volalign(std::string("config show configs/") + recipe.name + ".yaml");
    ASSERT_EQ(run.status, 0) << run.output;
    const auto leaves = ConfigSource::FromString(run.output, recipe.name).leaves();
    const auto value = [&](const std::string& key) { return leaves.at(key).values.back(); };
    EXPECT_EQ(value("model.attention"), recipe.attention);
    EXPECT_EQ(value("loss.procrustes"), recipe.procrustes);
    EXPECT_EQ(value("data.pose.rho_cm"), recipe.farthest_cm);
    EXPECT_EQ(value("model.base_channels"), recipe.width);
    EXPECT_EQ(value("data.noise.model"), recipe.noise);
    EXPECT_EQ(value("data.assembly.position_mm"), recipe.position_mm);
    EXPECT_EQ(value("loss.lambda"), "0.1");
    EXPECT_EQ(value("run.batch_size"), "16");
    WriteFileAtomically(Path("resolved.yaml"), run.output);
  }
  EXPECT_EQ(Volalign("config show " + Path("resolved.yaml")).output,
            ReadFile(Path("resolved.yaml")));
}

TEST_F(Program, RendersSamplesThatCanBeLookedAt) {
  const std::string command =
      "render --config configs/m05-lite.yaml --index 998 -o " + Path("samples");
  Outcome run = Volalign(command + " --count 3");
  EXPECT_EQ(run.status, 0) << run.output;
  EXPECT_EQ(ReadJson(Path("samples/index.json")).at("count"), 3);
  EXPECT_GT(ReadPngRgb(Path("samples/contact_sheet.png")).width(), 160);
  EXPECT_EQ(ReadDepthFile(Path("samples/000000/00000999_depth.png")).width(), 160);
  EXPECT_EQ(ReadPng8(Path("samples/000001/00001000_labels.png")).width(), 160);
  run = Volalign(command + " --count 5 --threads 3");
  EXPECT_EQ(run.status, 0) << run.output;
  EXPECT_EQ(ReadJson(Path("samples/index.json")).at("count"), 5);
  EXPECT_NE(run.output.find("2 samples after 3"), std::string::npos) << run.output;
  run = Volalign(command + " --count 5 --seed 2");
  EXPECT_EQ(run.status, 1);
  EXPECT_NE(run.output.find("seed = 2 (dataset: 1)"), std::string::npos) << run.output;
}

// A node that has no EGL driver at all trains and validates on folders.
TEST_F(Program, TrainsOnADatasetWithoutARenderer) {
  const std::string small =
      " --config configs/m05-lite.yaml --set data.sensors=[azure_kinect_nfov_binned]"
      " --set data.image_sizes=[40x36] --set data.renderer=egl --set run.batch_size=2";
  const auto write = [&](const std::string& name, const std::string& seed) {
    const Outcome run =
        Volalign("render" + small + " --count 4 --seed " + seed + " -o " + Path(name));
    EXPECT_EQ(run.status, 0) << run.output;
  };
  write("train", "1");
  write("valid", "1000001");
  const std::string train =
      "train" + small + " --set model.base_channels=2 --set run.samples=6 --set run.threads=1" +
      " --set optim.warmup_samples=2 --set run.validation_samples=4 --set run.dataset=" +
      Path("train") + " -o " + Path("run");
  ASSERT_EQ(::setenv("__EGL_VENDOR_LIBRARY_FILENAMES", Path("none.json").c_str(), 1), 0);
  const Outcome blind = Volalign(train);
  const Outcome run = Volalign(train + " --set run.validation_dataset=" + Path("valid"));
  ::unsetenv("__EGL_VENDOR_LIBRARY_FILENAMES");
  ExpectError(blind, {"run.validation_dataset", "run.validation_samples=0"});
  EXPECT_EQ(run.status, 0) << run.output;
  const CheckpointMeta meta = LoadCheckpoint(Path("run/model.safetensors")).meta;
  EXPECT_EQ(meta.samples, 6);
  EXPECT_EQ(meta.network.base_channels, 2);
  EXPECT_EQ(meta.image_sizes, (std::vector<std::pair<int, int>>{{40, 36}}));
  EXPECT_EQ(meta.structure.Hash(), ReadStructure("configs/structure.yaml").Hash());
}

TEST_F(Program, ARunHoldsWhatItIsTrainedOnAndHowEachStartWasCalled) {
  const std::string stack = Path("stack.yaml"), run = Path("run");
  WriteFileAtomically(stack, ReadFile("configs/structure.yaml"));
  const std::string train =
      "train --config configs/m01.yaml --set data.structure=" + stack +
      " --set data.image_sizes=[32x18] --set data.renderer=cpu --set model.base_channels=1"
      " --set run.batch_size=2 --set run.validation_samples=0 --set run.checkpoint_every=2 -o " +
      run;
  RunningProgram killed(train);
  while (!fs::exists(run + "/states/000000000002.state"))
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  killed.Signal(SIGKILL);
  killed.Wait();
  EXPECT_NE(ReadFile(run + "/command.yaml").find("run.validation_samples=0"), std::string::npos);
  EXPECT_EQ(ReadFile(run + "/structure.yaml"), ReadFile(stack));
  EXPECT_EQ(ReadFile(run + "/intrinsics.yaml"), ReadFile("configs/intrinsics.yaml"));
  EXPECT_EQ(ReadFile(run + "/config.yaml").find("threads: 0"), std::string::npos)
      << "how many were chosen";
  // The stack's file is gone; the run has a copy.
  fs::remove(stack);
  const Outcome again = Volalign(train + " --resume --set run.samples=3000");
  EXPECT_EQ(again.status, 0) << again.output;
  EXPECT_NE(again.output.find("stack.yaml is not there"), std::string::npos) << again.output;
  EXPECT_NE(ReadFile(run + "/command-2.yaml").find("run.samples=3000"), std::string::npos);
  EXPECT_EQ(ReadFile(run + "/command.yaml").find("run.samples=3000"), std::string::npos);
  EXPECT_EQ(Volalign("validate --samples 2 --model " + run + "/model.safetensors").status, 0);
  // So has another run of the same recipe.
  const Outcome other =
      Volalign("train --config " + run + "/config.yaml --set run.samples=2 -o " + Path("other"));
  EXPECT_EQ(other.status, 0) << other.output;
}

TEST_F(Program, ASuiteSaysWhichModelsItHasNotAndEndsWithStatusTwo) {
  const std::string methods =
      "datasets: [{name: none}]\ntables: [{name: one, rows: [{label: a, method: a}]}]\n"
      "methods: [{name: a, model: nowhere/a.pt}, {name: b, model: ";
  WriteFileAtomically(Path("none.yaml"), methods + "nowhere/b.pt}]\n");
  WriteFileAtomically(Path("some.yaml"),
                      methods + fs::absolute("models/m05-lite.safetensors").string() + "}]\n");
  const std::string suite = "evaluate --suite all -o " + Path("suite") + " --suite-config ";
  ExpectError(Volalign(suite + Path("none.yaml")), {"a (", "nowhere/a.pt", "data folder"});
  const Outcome some = Volalign(suite + Path("some.yaml"));
  EXPECT_EQ(some.status, 2) << some.output;
  EXPECT_NE(some.output.find("nowhere/a.pt"), std::string::npos) << some.output;
}

/// Number of points that a PLY file's header announces, where its body has as many of `size` bytes.
std::size_t CountPlyPoints(const std::string& path, std::size_t size) {
  const std::string file = ReadFile(path);
  const std::string element = "element vertex ", end = "end_header\n";
  const std::size_t count = std::stoul(file.substr(file.find(element) + element.size()));
  EXPECT_EQ(file.size() - file.find(end) - end.size(), size * count) << path;
  return count;
}

/// Three times the error without noise that was measured (0.26 mm, and 0.008 deg). Half a pixel is
/// 4 mm at 2 m.
constexpr double kExact = 0.0007;

TEST_F(Program, CalibratesACaptureFromFiles) {
  const Outcome run =
      Volalign("calibrate --capture " + WriteSmallCapture() +
               " --model models/m05-lite.safetensors --set refine.max_overlap_points=3999 -o " +
               Path("out"));
  EXPECT_EQ(run.status, 0) << run.output;
  const nlohmann::json extrinsics = ReadJson(Path("out/extrinsics.json"));
  const nlohmann::json capture = ReadJson(Path("capture/capture.json"));
  ASSERT_EQ(extrinsics.at("sensors").size(), 2u);
  constexpr std::size_t kPointBytes = 3 * 4 + 3 + 1 + 2 * 4;
  std::size_t points = 0;
  for (const std::string name : {"A", "B"}) {
    const nlohmann::json& sensor = extrinsics["sensors"].at(name);
    // Against what the renderer wrote, without the program's own comparison.
    const nlohmann::json& truth = capture.at("ground_truth").at(name);
    const nlohmann::json& pose = sensor.at("structure_from_sensor");
    for (std::size_t row = 0; row < 3; ++row) {
      EXPECT_NEAR(pose.at(row).at(3).get<double>(), truth.at(row).at(3).get<double>(), kExact)
          << name;
    }
    EXPECT_LT(sensor.at("error").at("translation_m").get<double>(), kExact) << name;
    EXPECT_LT(sensor.at("error").at("rotation_deg").get<double>(), 0.035) << name;

    // Labels and confidences are pictures of the frame; as many are labelled as the report says.
    const LabelImage labels = ReadPng8(Path("out/labels/" + name + ".png"));
    const auto confidence = ReadPng8(Path("out/confidence/" + name + ".png"));
    ASSERT_EQ(labels.width(), sensor.at("intrinsics").at("width")) << name;
    ASSERT_EQ(confidence.size(), labels.size()) << name;
    int labelled = 0;
    for (std::size_t k = 0; k < labels.size(); ++k) {
      if (labels[k] == 0) continue;
      ++labelled;
      EXPECT_GT(confidence[k], 0) << name << " " << k;
      if (confidence[k] == 0) break;
    }
    EXPECT_EQ(labelled, sensor.at("points")) << name;
    EXPECT_GT(DecodePngRgb(ReadFile(Path("out/pictures/" + name + ".png"))).width(), labels.width())
        << name;
    const std::size_t cloud = CountPlyPoints(Path("out/clouds/" + name + ".ply"), kPointBytes);
    EXPECT_GE(cloud, static_cast<std::size_t>(labelled)) << name;
    points += cloud;
  }
  EXPECT_EQ(CountPlyPoints(Path("out/clouds/merged.ply"), kPointBytes), points);
  EXPECT_EQ(ReadFile(Path("out/rig.glb")).substr(0, 4), "glTF");
  EXPECT_NE(ReadFile(Path("out/report.html")).find("--set refine.max_overlap_points=3999 -o "),
            std::string::npos);
  // The resolved options, which --config reads again.
  EXPECT_NE(run.output.find("options.yaml"), std::string::npos) << run.output;
  const auto options =
      ReadConfig<CalibrateOptions>(ConfigSource::FromFile(Path("out/options.yaml")));
  EXPECT_EQ(options.refine.max_overlap_points, 3999);
  EXPECT_EQ(WriteConfig(options), ReadFile(Path("out/options.yaml")));
}

TEST_F(Program, CalibratesCapturesOfSeveralPlacements) {
  WriteFileAtomically(
      Path("rig.yaml"),
      std::string("room: false\nnoise: none\nsensors:\n") +
          "  - {name: A, sensor: azure_kinect_nfov_binned, rho_cm: 200, phi_deg: 30, "
          "height_cm: 60, roll_deg: 90}\n"
          "  - {name: B, sensor: azure_kinect_nfov_binned, rho_cm: 200, phi_deg: 100, "
          "height_cm: 60, roll_deg: 90}\n"
          "placements:\n  - {x_cm: 30, z_cm: -20, yaw_deg: 60}\n");
  ASSERT_EQ(Volalign("render --rig " + Path("rig.yaml") + " -o " + Path("stills")).status, 0);
  const std::string captures =
      Path("stills/placement_1/capture.json") + " " + Path("stills/placement_2/capture.json");
  const Outcome run = Volalign("calibrate --capture " + captures +
                               " --model models/m05-lite.safetensors -o " + Path("several"));
  EXPECT_EQ(run.status, 0) << run.output;
  EXPECT_NE(run.output.find("in placement_2: the stack stood +0.3"), std::string::npos)
      << run.output;
  const nlohmann::json extrinsics = ReadJson(Path("several/extrinsics.json"));
  EXPECT_EQ(extrinsics.at("capture").size(), 2u);
  const nlohmann::json& second = extrinsics.at("placements").at(1);
  EXPECT_EQ(second.at("name"), "placement_2");
  EXPECT_EQ(second.at("sensors"), (std::vector<std::string>{"A", "B"}));
  const double placement[3] = {0.3, 0, -0.2};
  for (std::size_t row = 0; row < 3; ++row) {
    EXPECT_NEAR(second.at("first_from_placement").at(row).at(3).get<double>(), placement[row],
                0.002);  // 0.6 mm
  }
  for (const char* name : {"A", "B"}) {
    EXPECT_LT(extrinsics["sensors"][name]["error"]["translation_m"].get<double>(), 0.0015)
        << name;  // 0.5 mm
    EXPECT_TRUE(std::filesystem::exists(Path("several/labels/placement_2/") + name + ".png"));
  }
  // The same picture twice is no second placement.
  const std::string twice = Path("stills/placement_1/capture.json");
  const Outcome refused = Volalign("calibrate --capture " + twice + " " + twice +
                                   " --model models/m05-lite.safetensors -o " + Path("twice"));
  EXPECT_EQ(refused.status, 1);
  EXPECT_NE(refused.output.find("same depth map"), std::string::npos) << refused.output;
}

TEST_F(Program, ASensorThatFailsGivesStatus2) {
  const std::string capture = WriteSmallCapture();
  WritePng(Path("capture/B_depth.png"), Image16(320, 180));
  const Outcome run = Volalign("calibrate --no-report --capture " + capture +
                               " --model models/m05-lite.safetensors -o " + Path("out"));
  EXPECT_EQ(run.status, 2) << run.output;
  EXPECT_FALSE(std::filesystem::exists(Path("out/report.html")));
  EXPECT_FALSE(std::filesystem::exists(Path("out/rig.glb")));
  const nlohmann::json sensors = ReadJson(Path("out/extrinsics.json")).at("sensors");
  EXPECT_EQ(sensors.at("A").at("status"), "ok");
  EXPECT_LT(sensors.at("A").at("error").at("translation_m").get<double>(), kExact);
  EXPECT_EQ(sensors.at("B").at("status"), "failed");
  EXPECT_EQ(sensors.at("B").at("code"), "no_depth");
  EXPECT_FALSE(sensors.at("B").contains("structure_from_sensor"));
  EXPECT_NE(run.output.find(sensors.at("B").at("reason").get<std::string>()), std::string::npos)
      << run.output;
}

TEST_F(Program, BadCapturesAreOneLineErrors) {
  const std::string capture = WriteSmallCapture();
  const nlohmann::json good = ReadJson(capture);

  ExpectCalibrateError(Path("nowhere.json"), {"nowhere.json", "No such file", "capture.json"});
  ExpectCalibrateError(Path("capture"), {"is a folder", "capture.json"});
  WriteFileAtomically(Path("taken"), "x");
  ExpectError(Volalign("calibrate --capture " + capture +
                       " --model models/m05-lite.safetensors -o " + Path("taken")),
              {"taken", "choose another"});

  nlohmann::json bad = good;
  bad["sensors"][0]["depth"] = "gone.png";
  WriteJson(capture, bad);
  ExpectCalibrateError(capture, {"\"A\"", "gone.png", "relative to the capture's folder"});
  bad["sensors"][0]["depth"] = "/dev/zero";
  WriteJson(capture, bad);
  ExpectCalibrateError(capture, {"\"A\"", "/dev/zero", "device"});

  bad = good;
  bad["sensors"][0]["intrinsics"]["width"] = 640;
  WriteJson(capture, bad);
  ExpectCalibrateError(capture, {"A", "320", "640"});

  bad = good;
  bad["sensors"][1]["name"] = "A";
  WriteJson(capture, bad);
  ExpectCalibrateError(capture, {"\"A\""});

  std::string text = good.dump(1);
  text.replace(text.find("\"fx\":") + 5, 0, " NaN, \"f\":");
  WriteFileAtomically(capture, text);
  ExpectCalibrateError(capture, {"capture.json"});

  WriteFileAtomically(capture, good.dump(1));
  const std::string image = ReadFile(Path("capture/A_depth.png"));
  WriteFileAtomically(Path("capture/A_depth.png"), image.substr(0, image.size() / 2));
  ExpectCalibrateError(capture, {"A_depth.png", "truncated"});
}

TEST_F(Program, EvaluatesRigsAndCaptures) {
  const std::string capture = WriteSmallCapture();
  const std::string command =
      "evaluate --model models/m05-lite.safetensors --rigs " + Path("rig.yaml") +
      " --sensors azure_kinect_nfov_binned realsense_d415 --seeds 5:7 --captures " + capture +
      " --compare refine.box_sigma_deg=0.5,0.6 -o " + Path("eval");
  const Outcome first = Volalign(command);
  EXPECT_EQ(first.status, 0) << first.output;
  const nlohmann::json json = ReadJson(Path("eval/evaluation.json"));
  // Two seeds of two sensor models, and the capture, under two variants each.
  ASSERT_EQ(json.at("cases").size(), 10u);
  for (const nlohmann::json& one : json.at("cases")) {
    EXPECT_EQ(one.at("sensors").size(), 2u);
    for (const nlohmann::json& sensor : one.at("sensors")) {
      // Depths are exact but for their millimetres, silhouettes but for a part of a pixel, which
      // tilts and bulges of the depth may make good: at most 3.3 mm and 0.092 deg were measured.
      const nlohmann::json& refined = sensor.at("error").at("refined");
      EXPECT_LT(refined.at("translation_m").get<double>(), 0.004) << one.dump();
      EXPECT_LT(refined.at("rotation_deg").get<double>(), 0.11) << one.dump();
    }
  }
  EXPECT_NE(first.output.find("| rig | azure_kinect_nfov_binned | 0.5 |"), std::string::npos)
      << first.output;
  EXPECT_NE(first.output.find("| " + capture + " | A | 0.6 | ok |"), std::string::npos)
      << first.output;

  const Outcome again = Volalign(command);
  EXPECT_EQ(again.status, 0) << again.output;
  EXPECT_NE(again.output.find("[5/5]"), std::string::npos) << again.output;
  std::size_t done = 0;
  for (std::size_t at = 0; (at = again.output.find("(done before)", at)) != std::string::npos; ++at)
    ++done;
  EXPECT_EQ(done, 5u) << again.output;
  EXPECT_EQ(ReadJson(Path("eval/evaluation.json")), json);
}

TEST_F(Program, BadModelsAreOneLineErrors) {
  const std::string capture = WriteSmallCapture();
  ExpectCalibrateError(capture, {"no.pt", "No such file"}, Path("no.pt"));

  WriteFileAtomically(Path("bad.pt"), ReadFile("models/m05-lite.safetensors").substr(0, 100000));
  ExpectCalibrateError(capture, {"bad.pt"}, Path("bad.pt"));

  // A checkpoint of another structure: the capture's has one box more.
  std::string yaml = ReadFile("configs/structure.yaml");
  yaml.resize(yaml.find("labels:"));
  const std::string last = "  - {name: top, ";
  yaml.insert(yaml.find(last),
              "  - {name: extra, x: [-280, 50], y: [810, 1215], z: [-165, 165]}\n");
  WriteFileAtomically(Path("capture/structure.yaml"), yaml);
  ExpectCalibrateError(capture, {"structure"});
}

/// Waits for a second process, which `program` is, to have begun to write there.
void WaitForDraft(const std::string& folder) {
  for (;; std::this_thread::sleep_for(std::chrono::milliseconds(1))) {
    std::error_code missing;
    for (const auto& entry : fs::directory_iterator(folder, missing)) {
      if (entry.path().filename().string().rfind("unfinished.tmp-", 0) == 0) return;
    }
  }
}

TEST_F(Program, OneProcessAtATimeWritesAResult) {
  const std::string calibrate = "calibrate --capture " + WriteSmallCapture() + " --structure " +
                                Path("capture/structure.yaml") + " --no-report -o " + Path("out");
  RunningProgram first(calibrate);
  WaitForDraft(Path("out"));
  first.Signal(SIGSTOP);
  ExpectError(Volalign(calibrate), {Path("out"), "another volalign is writing there"});
  first.Signal(SIGCONT);
  EXPECT_EQ(first.Wait().status, 0);
  EXPECT_EQ(Volalign(calibrate).status, 0);
}

/// Commands that write a folder, without -o: the name of the folder, which is in `folder`, and the
/// rest. Those behind the first need what the first writes.
std::vector<std::pair<std::string, std::string>> FolderCommands(const std::string& folder) {
  return {{"calibrated", "calibrate --capture " + folder + "/capture/capture.json --structure " +
                             folder + "/capture/structure.yaml --no-report"},
          {"converted", "convert " + folder + "/calibrated/extrinsics.json --to colmap"},
          {"rendered", "render --force --rig " + folder + "/rig.yaml"},
          {"evaluated",
           "evaluate --model models/m05-lite.safetensors --rig " + folder + "/rig.yaml --seeds 5"}};
}

TEST_F(Program, NoCommandWritesIntoAFolderThatAnotherOneWritesInto) {
  WriteSmallCapture();
  for (const auto& [name, command] : FolderCommands(folder_.path().string())) {
    SCOPED_TRACE(command);
    {
      const FolderLock other(Path(name));
      const Outcome run = Volalign(command + " -o " + Path(name));
      EXPECT_EQ(run.status, 1);
      EXPECT_NE(run.output.find(Path(name) + ": another volalign is writing there"),
                std::string::npos)
          << run.output;
      EXPECT_TRUE(fs::is_empty(Path(name)));
    }
    if (name == "calibrated") {
      EXPECT_EQ(Volalign(command + " -o " + Path(name)).status, 0);
    }
  }
}

TEST_F(Program, EndsOnSignalsWithNothingHalfWritten) {
  const std::string calibrate = "calibrate --capture " + WriteSmallCapture() + " --structure " +
                                Path("capture/structure.yaml") + " --no-report -o " + Path("out");
  for (const int number : {SIGINT, SIGTERM}) {
    RunningProgram program(calibrate);
    WaitForDraft(Path("out"));
    program.Signal(number);
    const Outcome run = program.Wait();
    EXPECT_EQ(run.status, 128 + number);
    EXPECT_NE(run.output.find("stopped by"), std::string::npos) << run.output;
    EXPECT_TRUE(fs::is_empty(Path("out")));
  }
  RunningProgram train("train --config configs/m05-lite.yaml --set run.samples=100000 -o " +
                       Path("run"));
  while (!fs::exists(Path("run/metrics.jsonl")))
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  train.Signal(SIGTERM);
  const Outcome run = train.Wait();
  EXPECT_EQ(run.status, 128 + SIGTERM);
  EXPECT_NE(run.output.find("continue with --resume"), std::string::npos) << run.output;
  EXPECT_FALSE(fs::is_empty(Path("run/states")));
}

/// Bytes of a file, or of each file of a folder, by path.
std::map<std::string, std::string> Contents(const fs::path& path) {
  std::map<std::string, std::string> contents;
  if (fs::is_regular_file(path)) contents[path.string()] = ReadFile(path);
  if (!fs::is_directory(path)) return contents;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(path)) {
    if (entry.is_regular_file()) contents[entry.path().string()] = ReadFile(entry.path());
  }
  return contents;
}

// A limit on the size of files does what a full disk does.
TEST_F(Program, AFullDiskLeavesTheEarlierResult) {
  WriteSmallCapture();
  auto commands = FolderCommands(folder_.path().string());
  commands.emplace_back("m.onnx", "export --model models/m05-lite.safetensors --format onnx");
  commands.emplace_back("p.csv", "convert " + Path("calibrated/extrinsics.json") + " --to csv");
  for (const auto& [name, command] : commands) {
    SCOPED_TRACE(command);
    const std::string whole = command + " -o " + Path(name);
    EXPECT_EQ(Volalign(whole).status, 0);
    const auto before = Contents(Path(name));
    EXPECT_FALSE(before.empty());
    for (const rlim_t bytes : {10, 100}) {
      rlimit old_limit{};
      ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &old_limit), 0);
      rlimit limit = old_limit;
      limit.rlim_cur = bytes;
      ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &limit), 0);
      const Outcome run = Volalign(whole);
      ::setrlimit(RLIMIT_FSIZE, &old_limit);
      EXPECT_EQ(run.status, 1) << bytes << ": " << run.output;
      const std::size_t error = run.output.find("error: cannot write ");
      ASSERT_NE(error, std::string::npos) << run.output;
      EXPECT_NE(run.output.find("File too large\n", error), std::string::npos) << run.output;
      EXPECT_TRUE(Contents(Path(name)) == before) << bytes << " bytes";
    }
  }
}

/// GOMP_SPINCOUNT of each start of `train` with this OMP_WAIT_POLICY, as libgomp says it.
std::vector<std::string> SpinCounts(const char* policy) {
  const char* const before = std::getenv("OMP_WAIT_POLICY");
  const std::string kept = before != nullptr ? before : "";
  unsetenv("OMP_WAIT_POLICY");
  if (policy != nullptr) setenv("OMP_WAIT_POLICY", policy, 1);
  setenv("OMP_DISPLAY_ENV", "verbose", 1);
  const std::string output = Volalign("train --config no_such_file.yaml -o no_such_run").output;
  unsetenv("OMP_DISPLAY_ENV");
  unsetenv("OMP_WAIT_POLICY");
  if (before != nullptr) setenv("OMP_WAIT_POLICY", kept.c_str(), 1);
  EXPECT_NE(output.find("error: cannot read no_such_file.yaml"), std::string::npos) << output;
  const std::regex pattern("GOMP_SPINCOUNT = '([0-9]+)'");
  std::vector<std::string> counts;
  for (auto at = std::sregex_iterator(output.begin(), output.end(), pattern);
       at != std::sregex_iterator(); ++at)
    counts.push_back((*at)[1]);
  return counts;
}

TEST(Train, WaitsPassivelyUnlessToldOtherwise) {
  const std::vector<std::string> counts = SpinCounts(nullptr);
  ASSERT_EQ(counts.size(), 2u);  // it starts itself again
  EXPECT_NE(counts[0], "0");
  EXPECT_EQ(counts[1], "0");
  const std::vector<std::string> told = SpinCounts("ACTIVE");
  ASSERT_EQ(told.size(), 1u);
  EXPECT_NE(told[0], "0");
}

}  // namespace
}  // namespace volalign::program_test
