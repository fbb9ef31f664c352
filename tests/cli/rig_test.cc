// The program's sub-commands that look after a rig: plan and check.

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "core/base/file_util.h"
#include "tests/cli/run_program.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::rig_test {
namespace {

constexpr char kSensors[] = R"(
room: false
noise: none
sensors:
  - {name: A, sensor: azure_kinect_nfov_binned, rho_cm: 200, phi_deg: 30, height_cm: 100}
  - {name: B, sensor: azure_kinect_nfov_binned, rho_cm: 200, phi_deg: 150, height_cm: 120}
  - {name: C, sensor: azure_kinect_nfov_binned, rho_cm: 200, phi_deg: 270, height_cm: 110}
)";

class RigCommands : public testing::Test {
 protected:
  std::string Path(const std::string& name) const { return (folder_.path() / name).string(); }

 private:
  TempFolder folder_;
};

TEST_F(RigCommands, CheckFindsWhatMovedAndUpdatesIt) {
  // B was moved by 30, 40 and 0 mm and turned by 2 deg, and the stack was built up elsewhere.
  WriteFileAtomically(Path("rig.yaml"),
                      std::string(kSensors) +
                          "placements:\n  - {x_cm: 30, z_cm: -20, yaw_deg: 60, moved: [{sensor: B, "
                          "translation_mm: [30, 40, 0], rotation_deg: [0, 2, 0]}]}\n");
  ASSERT_EQ(Volalign("render --rig " + Path("rig.yaml") + " -o " + Path("stills")).status, 0);
  const std::string model = " --model models/m05-lite.safetensors ";
  ASSERT_EQ(Volalign("calibrate --capture " + Path("stills/placement_1/capture.json") + model +
                     "-o " + Path("last"))
                .status,
            0);
  const std::string check =
      "check --capture " + Path("stills/placement_2/capture.json") + model + "--extrinsics ";
  const std::string last = Path("last/extrinsics.json") + " ";
  const Outcome moved =
      Volalign(check + last + "-o " + Path("now") + " --update " + Path("updated.json"));
  EXPECT_EQ(moved.status, 3) << moved.output;
  EXPECT_NE(moved.output.find("; the other 2 agree within "), std::string::npos) << moved.output;
  EXPECT_NE(moved.output.find("the stack stands 36"), std::string::npos) << moved.output;
  const auto json = nlohmann::json::parse(ReadFile(Path("now/check.json")));
  ASSERT_EQ(json["sensors"].size(), 3u);
  EXPECT_EQ(json["sensors"][1]["name"], "B");
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_EQ(json["sensors"][i]["movement"], i == 1 ? "moved" : "stayed") << moved.output;
  EXPECT_NEAR(json["sensors"][1]["translation_m"], 0.05, 0.01) << moved.output;
  EXPECT_NEAR(json["sensors"][1]["rotation_deg"], 2, 0.2) << moved.output;
  EXPECT_EQ(ReadFile(Path("now/extrinsics.json")).empty(), false);

  const Outcome updated = Volalign(check + Path("updated.json"));
  EXPECT_EQ(updated.status, 0) << updated.output;
  EXPECT_NE(updated.output.find("nothing moved: all 3 agree"), std::string::npos) << updated.output;
}

TEST_F(RigCommands, PlanPredictsWithoutARenderer) {
  WriteFileAtomically(Path("rig.yaml"), kSensors);
  const Outcome plan = Volalign("plan " + Path("rig.yaml") + " --trials 1 -o " + Path("plan.svg"));
  EXPECT_EQ(plan.status, 0) << plan.output;
  EXPECT_NE(plan.output.find("known least"), std::string::npos);
  EXPECT_NE(ReadFile(Path("plan.svg")).find("</svg>"), std::string::npos);
  WriteFileAtomically(Path("blind.yaml"),
                      "sensors: [{name: D, rho_cm: 200, look_at_cm: [900, 0, 0]}]\n");
  const Outcome blind = Volalign("plan " + Path("blind.yaml") + " --trials 1");
  EXPECT_EQ(blind.status, 2) << blind.output;
  EXPECT_NE(blind.output.find("D: it sees no side of the stack"), std::string::npos)
      << blind.output;
}

}  // namespace
}  // namespace volalign::rig_test
