// Commands that are stopped at moments drawn at random, by Ctrl-C, SIGTERM and SIGKILL: what they
// leave is whole, or nothing.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "core/base/file_util.h"
#include "tests/cli/run_program.h"
#include "tests/core/base/long_tests.h"
#include "tests/core/base/read_file.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::stopped_test {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;

constexpr char kUnfinished[] = ".tmp-";

/// Bytes of a file, or of each file of a folder, by path; with `unfinished`, of those that are
/// being written, else of all others.
std::map<std::string, std::string> Files(const fs::path& path, bool unfinished = false) {
  std::map<std::string, std::string> files;
  const auto add = [&](const fs::path& file) {
    if ((file.string().find(kUnfinished) != std::string::npos) == unfinished)
      files[file.string()] = ReadFile(file);
  };
  if (fs::is_regular_file(path)) add(path);
  if (!fs::is_directory(path)) return files;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(path)) {
    if (entry.is_regular_file() && entry.path().filename() != ".lock") add(entry.path());
  }
  return files;
}

class Stopped : public testing::Test {
 protected:
  Stopped() {
    WriteFileAtomically(
        folder_ / "rig.yaml",
        "room: true\nnoise: none\nseed: 3\nsensors:\n"
        "  - {name: A, sensor: azure_kinect_nfov_binned, rho_cm: 200, phi_deg: 30}\n"
        "  - {name: B, sensor: realsense_d415, rho_cm: 200, phi_deg: 80}\n");
    ExpectEnds("render --rig " + In("rig.yaml") + " -o " + In("capture"));
    calibrate_ = "calibrate --capture " + In("capture/capture.json") + " --structure " +
                 In("capture/structure.yaml") + " --no-report -o ";
    ExpectEnds(calibrate_ + In("calibration"));
  }
  std::string In(const std::string& name) const { return (folder_ / name).string(); }

  /// @return how long it took from the beginning of main, s
  static double ExpectEnds(const std::string& command) {
    RunningProgram program(command);
    program.WaitForMain();
    const auto start = Clock::now();
    const Outcome run = program.Wait();
    EXPECT_TRUE(run.status == 0 || run.status == 2) << command << "\n" << run.output;
    return Seconds(Clock::now() - start).count();
  }

  /// At a moment within so many seconds from the beginning of main.
  Outcome StopWithin(double seconds, const std::string& command, int number) {
    RunningProgram program(command);
    program.WaitForMain();
    std::this_thread::sleep_for(Seconds(std::uniform_real_distribution<>(0, seconds)(random_)));
    program.Signal(number);
    return program.Wait();
  }

  const TempFolder folder_;
  std::string calibrate_;
  std::mt19937 random_{1};
};

TEST_F(Stopped, EveryCommandSaysSoAndEndsWithTheSignalsStatus) {
  const std::string model = " --model models/m05-lite.safetensors ", result = " -o " + In("result");
  const std::vector<std::string> commands = {
      "render --rig " + In("rig.yaml") + result,
      "render --config configs/m05-lite.yaml --count 20" + result,
      "init " + In("capture") + " --depth-scale 0.001" + result + ".json",
      calibrate_ + In("result"),
      "check --extrinsics " + In("calibration/extrinsics.json") + " --capture " +
          In("capture/capture.json") + result,
      "convert " + In("calibration/extrinsics.json") + " --to colmap" + result,
      "evaluate" + model + "--rig " + In("rig.yaml") + " --seeds 7" + result,
      "plan " + In("rig.yaml") + result + ".svg",
      "structure build configs/structure.yaml" + result + ".glb",
      "structure check configs/structure.yaml" + result + ".svg",
      "validate" + model + "--samples 16" + result + ".json",
      "export" + model + "--format onnx" + result + ".onnx",
      "config reference",
      "doctor"};
  int stopped = 0;
  for (std::size_t k = 0; k < commands.size(); ++k) {
    const std::string& command = commands[k];
    SCOPED_TRACE(command);
    const double whole = ExpectEnds(command);
    for (const int number : {SIGINT, SIGTERM}) {
      if ((number == SIGINT) == (k % 2 == 0) && Rounds(1, 2) == 1) continue;
      bool said = false;
      for (int draw = 0; draw < 20 && !said; ++draw) {
        for (const fs::directory_entry& entry : fs::directory_iterator(folder_.path())) {
          if (entry.path().stem() == "result") fs::remove_all(entry.path());
        }
        const Outcome run = StopWithin(whole, command, number);
        if (run.status == 0 || run.status == 2) continue;  // it had ended before
        EXPECT_EQ(run.status, 128 + number) << run.output;
        said = run.output.find(number == SIGINT ? "stopped by Ctrl-C (SIGINT)\n"
                                                : "stopped by SIGTERM\n") != std::string::npos;
        EXPECT_TRUE(Files(folder_.path(), true).empty());
        ++stopped;
      }
      EXPECT_TRUE(said) << number;
    }
  }
  fmt::print("{} commands were stopped {} times\n", commands.size(), stopped);
}

/// What is found beside unfinished files is all of `whole`, or nothing that says that it is there:
/// in a folder the file `last` does (core/base/folder.h).
void ExpectWholeOrNothing(const fs::path& result, const std::string& last,
                          const std::map<std::string, std::string>& whole) {
  const std::map<std::string, std::string> left = Files(result);
  if (left.empty() || (!last.empty() && left.count(last) == 0)) return;
  EXPECT_EQ(left.size(), whole.size());
  for (const auto& [name, bytes] : whole) {
    const auto found = left.find(name);
    EXPECT_TRUE(found != left.end() && found->second == bytes) << name;
  }
}

int Kills() {
  const char* wanted = std::getenv("VOLALIGN_KILLS");
  return wanted ? std::atoi(wanted) : 5;
}

TEST_F(Stopped, WhatIsKilledLeavesAWholeResultOrNone) {
  struct Case {
    std::string name, last, arguments;
  };
  const std::vector<Case> cases = {
      {"result.onnx", "", "export --model models/m05-lite.safetensors --format onnx -o "},
      {"colmap", "command.yaml",
       "convert " + In("calibration/extrinsics.json") + " --to colmap -o "},
      {"rendered", "capture.json", "render --rig " + In("rig.yaml") + " --force -o "},
      {"calibrated", "extrinsics.json", calibrate_}};
  int nothing_of_all = 0;  // a short command may have ended before each kill
  for (const auto& [name, last, arguments] : cases) {
    const std::string command = arguments + In(name);
    SCOPED_TRACE(command);
    const double seconds = ExpectEnds(command);
    const auto whole = Files(folder_ / name);
    ASSERT_FALSE(whole.empty());
    int unfinished = 0, nothing = 0;
    for (int kill = 0; kill < Kills(); ++kill) {
      fs::remove_all(folder_ / name);
      StopWithin(seconds, command, SIGKILL);
      ExpectWholeOrNothing(folder_ / name, last, whole);
      unfinished += !Files(folder_.path(), true).empty();
      nothing += Files(folder_ / name).empty();
    }
    ExpectEnds(command);
    ExpectWholeOrNothing(folder_ / name, last, whole);
    EXPECT_TRUE(Files(folder_.path(), true).empty()) << "the next run sweeps";
    fmt::print("{}: {} kills, {} left nothing, {} had unfinished files\n", name, Kills(), nothing,
               unfinished);
    nothing_of_all += nothing;
  }
  EXPECT_GT(nothing_of_all, 0);
}

/// Without what differs between runs.
nlohmann::json Scores(nlohmann::json json) {
  if (json.is_object()) {
    for (const char* key : {"timings_s", "seconds", "created", "time_s", "calibrate_s"})
      json.erase(key);
  }
  if (json.is_structured()) {
    for (nlohmann::json& part : json) part = Scores(part);
  }
  return json;
}

TEST_F(Stopped, AnEvaluationThatIsKilledGoesOn) {
  const std::string command =
      "evaluate --model models/m05-lite.safetensors --rig " + In("rig.yaml") + " --seeds 5:7 -o ";
  const double seconds = ExpectEnds(command + In("whole"));
  const auto read = [&](const std::string& name) {
    return Scores(nlohmann::json::parse(ReadFile(folder_ / name / "evaluation.json")));
  };
  const nlohmann::json whole = read("whole");
  const int kills = std::max(1, Kills() / 3);
  for (int kill = 0; kill < kills; ++kill) StopWithin(seconds, command + In("killed"), SIGKILL);
  ExpectEnds(command + In("killed"));
  EXPECT_EQ(read("killed").at("cases"), whole.at("cases"));
  EXPECT_TRUE(Files(folder_ / "killed", true).empty());
}

}  // namespace
}  // namespace volalign::stopped_test
