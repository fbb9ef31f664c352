// Samples against those recorded in tests/render/golden, on whichever machine this runs.
// Intrinsics are equal to the last bit: they come from Philox and from arithmetic that IEEE-754
// fixes. Poses pass through the C library's functions and are equal to 1e-12, images through OpenGL
// too, so they are compared within bounds:
//   - depth before a sensor's rounding (noise model paper) within 0.2 mm on 99.9 % of the pixels;
//   - depth in whole millimetres (noise model sensor) equal on 99 %, as the rounding turns the
//     least difference into a whole step near a half, and within a step on 99.9 %;
//   - labels equal on 99.9 %.
// After a change of scenes, noise models or random draws that is meant, record them anew and look
// at the difference before committing it:
//   VOLALIGN_WRITE_GOLDEN=1 ctest --test-dir build/release -R '^render/golden$'

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/base/file_util.h"
#include "core/formats/image_io.h"
#include "core/json/json_archive.h"
#include "render/egl/renderers.h"
#include "render/sample.h"
#include "tests/core/base/read_file.h"
#include "tests/render/test_scene.h"

namespace volalign::golden_test {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr std::uint64_t kSeed = 77;
constexpr double kStep = 2e-4;  // m, of recorded depths; 16 bits of it reach 13 m
constexpr double kSensorStep = 1e-3;

struct Case {
  const char* noise;
  const char* sensor;
  const char* image_size;  // odd sizes of the sensor's aspect ratio
  std::uint64_t index;
};
constexpr char kD415[] = "realsense_d415", kAzure[] = "azure_kinect_nfov_binned";
constexpr Case kCases[] = {{"sensor", kD415, "73x41", 0},
                           {"sensor", kAzure, "51x46", 2},
                           {"paper", kD415, "73x41", 4},
                           {"paper", kAzure, "51x46", 5}};

fs::path Folder() { return "tests/render/golden"; }
bool Rounded(const Case& c) { return std::string(c.noise) == "sensor"; }
std::string Stem(const Case& c) { return std::string(c.noise) + std::to_string(c.index); }

class GoldenTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    const std::unique_ptr<DepthRenderer> owned = GlRenderers()();
    DepthRenderer& renderer = *owned;
    samples_.clear();
    for (const Case& c : kCases) {
      const SampleConfig config = SamplesOf(c.sensor, c.image_size, c.noise);
      samples_.push_back(Synthesize(MakeSampleContext(config, 16), renderer, kSeed, c.index));
    }
    if (std::getenv("VOLALIGN_WRITE_GOLDEN")) {
      Record();
      ADD_FAILURE() << "recorded anew; look at the difference, and test without the variable";
    }
  }

  static void Record() {
    fs::remove_all(Folder());
    std::string lines;  // one of each sample
    for (std::size_t i = 0; i < std::size(kCases); ++i) {
      const Sample& sample = samples_[i];
      const Json json = {{"name", Stem(kCases[i])},
                         {"sensor", sample.sensor},
                         {"intrinsics", DescribedJson(sample.intrinsics, "intrinsics")},
                         {"structure_from_sensor", ToRows(sample.structure_from_sensor)}};
      lines += (i > 0 ? ",\n" : "") + json.dump();
      WritePng(Folder() / (Stem(kCases[i]) + "_depth.png"), FromMetres(sample.depth, kStep));
      WritePng(Folder() / (Stem(kCases[i]) + "_labels.png"), sample.labels);
    }
    WriteFileAtomically(Folder() / "golden.json", "[" + lines + "]\n");
  }

  /// Shares of the pixels whose depth is as recorded, within `tolerance` m.
  static double DepthShare(bool rounded, double tolerance) {
    long equal = 0, all = 0;
    for (std::size_t i = 0; i < std::size(kCases); ++i) {
      if (Rounded(kCases[i]) != rounded) continue;
      const fs::path path = Folder() / (Stem(kCases[i]) + "_depth.png");
      const DepthImage golden = ToMetres(ReadDepthFile(path), kStep);
      const DepthImage& depth = samples_[i].depth;
      EXPECT_EQ(golden.width(), depth.width());
      EXPECT_EQ(golden.height(), depth.height());
      if (golden.size() != depth.size()) return 0;
      all += static_cast<long>(golden.size());
      for (std::size_t k = 0; k < golden.size(); ++k)
        equal += (golden[k] > 0) == (depth[k] > 0) && std::abs(golden[k] - depth[k]) <= tolerance;
    }
    return static_cast<double>(equal) / static_cast<double>(all);
  }

  inline static std::vector<Sample> samples_;
};

TEST_F(GoldenTest, PosesAndIntrinsicsAreEqual) {
  const Json golden = Json::parse(ReadFile(Folder() / "golden.json"));
  ASSERT_EQ(golden.size(), std::size(kCases));
  for (std::size_t i = 0; i < samples_.size(); ++i) {
    SCOPED_TRACE(Stem(kCases[i]));
    EXPECT_EQ(golden[i].at("name"), Stem(kCases[i]));
    EXPECT_EQ(golden[i].at("sensor"), samples_[i].sensor);
    EXPECT_EQ(golden[i].at("intrinsics"), DescribedJson(samples_[i].intrinsics, "intrinsics"));
    const auto rows = golden[i].at("structure_from_sensor").get<std::vector<std::vector<double>>>();
    for (int row = 0; row < 4; ++row) {
      for (int column = 0; column < 4; ++column)
        EXPECT_NEAR(rows.at(row).at(column),
                    samples_[i].structure_from_sensor.matrix()(row, column), 1e-12);
    }
  }
}

TEST_F(GoldenTest, DepthIsWithinTwoTenthsOfAMillimetre) {
  const double share = DepthShare(false, 1e-4 + 0.51 * kStep);
  RecordProperty("share", std::to_string(share));
  EXPECT_GE(share, 0.999);
}

TEST_F(GoldenTest, RoundedDepthIsEqualButForTheRounding) {
  EXPECT_GE(DepthShare(true, 0.1 * kSensorStep), 0.99);
  EXPECT_GE(DepthShare(true, 1.1 * kSensorStep), 0.999);
}

TEST_F(GoldenTest, LabelsAreEqual) {
  long equal = 0, all = 0, structure = 0;
  for (std::size_t i = 0; i < std::size(kCases); ++i) {
    const LabelImage golden = ReadPng8(Folder() / (Stem(kCases[i]) + "_labels.png"));
    ASSERT_EQ(golden.width(), samples_[i].labels.width());
    ASSERT_EQ(golden.height(), samples_[i].labels.height());
    all += static_cast<long>(golden.size());
    for (std::size_t k = 0; k < golden.size(); ++k) {
      equal += golden[k] == samples_[i].labels[k];
      structure += golden[k] != 0;
    }
  }
  EXPECT_GT(structure, 1000);
  EXPECT_GE(static_cast<double>(equal) / static_cast<double>(all), 0.999);
}

}  // namespace
}  // namespace volalign::golden_test
