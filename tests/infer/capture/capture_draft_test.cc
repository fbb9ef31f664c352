#include "infer/capture/capture_draft.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/formats/image_io.h"
#include "core/geometry/typical_intrinsics.h"
#include "infer/capture/capture.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::capture_draft_test {
namespace {

constexpr char kIntrinsics[] =
    R"({"width": 4, "height": 3, "fx": 5, "fy": 5.5, "cx": 1.5, "cy": 1})";

class CaptureDraftTest : public ::testing::Test {
 protected:
  void WriteDepth(const std::string& name) { WritePng(folder_ / name, Image16(4, 3, 2000)); }
  void WriteText(const std::string& name, const std::string& text) {
    WriteFileAtomically(folder_ / name, text);
  }
  nlohmann::json Draft(const CaptureDraftOptions& options = {}) {
    draft_ = DraftCapture(folder_.path(), folder_.path(), options);
    return nlohmann::json::parse(draft_.json).at("sensors");
  }
  static bool Mentions(const std::vector<std::string>& sentences, const std::string& a,
                       const std::string& b) {
    return std::any_of(sentences.begin(), sentences.end(), [&](const std::string& sentence) {
      return sentence.find(a) != std::string::npos && sentence.find(b) != std::string::npos;
    });
  }

  TempFolder folder_;
  CaptureDraft draft_;
};

TEST_F(CaptureDraftTest, AFolderASensor) {
  WriteDepth("left/depth_9.png");
  WriteDepth("left/depth_10.png");
  WriteDepth("left/ir_9.png");
  WriteText("left/calib.yaml",
            "image_width: 4\nimage_height: 3\nK: [5, 0, 1.5, 0, 5.5, 1, 0, 0, 1]\n");
  WriteDepth("right/0001.png");
  CaptureDraftOptions options;
  options.depth_scale = 0.001;
  options.sensor = "kinect_v2";
  const nlohmann::json sensors = Draft(options);
  ASSERT_EQ(sensors.size(), 2u);
  EXPECT_EQ(sensors[0]["name"], "left");
  EXPECT_EQ(sensors[0]["depth"],
            (std::vector<std::string>{"left/depth_9.png", "left/depth_10.png"}));
  EXPECT_EQ(sensors[0]["sensor"], "kinect_v2");
  EXPECT_EQ(sensors[0]["depth_scale"], 0.001);
  EXPECT_EQ(sensors[0]["intrinsics"]["fy"], 5.5);
  EXPECT_EQ(sensors[1]["name"], "right");
  EXPECT_EQ(sensors[1]["depth"], "right/0001.png");
  // Another sensor's intrinsics are not taken for its own.
  EXPECT_FALSE(sensors[1].contains("intrinsics"));
  EXPECT_EQ(draft_.unknown.size(), 1u);
  EXPECT_TRUE(Mentions(draft_.unknown, "right", "intrinsics"));
  EXPECT_TRUE(Mentions(draft_.found, "left out", "ir_9.png"));
  EXPECT_TRUE(Mentions(draft_.found, "left: ", "the typical one of kinect_v2"));
}

TEST_F(CaptureDraftTest, SaysWhichLensIsAssumedAndWhy) {
  const auto write = [&](const std::string& name, const std::string& distortion) {
    WriteDepth(name + "_depth.png");
    WriteText(name + "_intrinsics.json",
              R"({"width": 4, "height": 3, "fx": 5, "fy": 5, "cx": 1.5, "cy": 1, "distortion": )" +
                  distortion + "}");
  };
  write("A", "[]");
  write("B", "[0, 0, 0, 0]");
  write("C", "[0.1, 0, 0, 0]");
  write("D", "[]");
  CaptureDraftOptions options;
  options.depth_scale = 0.001;
  Draft(options);
  EXPECT_TRUE(Mentions(draft_.found, "A, D: the lens is taken as unknown", "no kind of sensor"));
  EXPECT_TRUE(Mentions(draft_.found, "B: taken as rectified", "all zeros"));
  EXPECT_TRUE(Mentions(draft_.found, "C: the lens is that of the distortion", ""));
  options.sensor = "azure_kinect_wfov_binned";
  Draft(options);
  EXPECT_TRUE(Mentions(draft_.found, "A, D: ", "the typical one of azure_kinect_wfov_binned"));
  EXPECT_TRUE(Mentions(draft_.found, "B: taken as rectified", "all zeros"));
  options.sensor = "oak_d";
  Draft(options);
  EXPECT_TRUE(Mentions(draft_.found, "A, D: taken as rectified", "oak_d delivers rectified"));
  options.sensor = "femto_bolt";
  ExpectError<ConfigError>([&] { Draft(options); }, {"femto_bolt", "orbbec_femto", "oak_d"});
}

TEST_F(CaptureDraftTest, AFlatFolder) {
  WriteDepth("KA03_Depth.png");
  WriteDepth("cam_1_depth_0001.png");
  WriteDepth("cam_1_depth_0002.png");
  WriteDepth("cam2.png");
  WriteDepth("depth_KA07.png");
  WriteDepth("KA03_color.png");
  WriteDepth("KA03_Labels.png");
  WriteText("KA03.json", kIntrinsics);
  WriteText("intrinsics.json", kIntrinsics);
  WriteText("notes.json", "{\"by\": \"me\"}");
  const nlohmann::json sensors = Draft();
  ASSERT_EQ(sensors.size(), 4u);
  std::map<std::string, nlohmann::json> by_name;
  for (const nlohmann::json& sensor : sensors) by_name[sensor["name"]] = sensor;
  EXPECT_EQ(by_name["cam_1"]["depth"].size(), 2u);
  EXPECT_EQ(by_name["cam2"]["depth"], "cam2.png");
  EXPECT_EQ(by_name["KA07"]["depth"], "depth_KA07.png");
  EXPECT_EQ(by_name["KA03"]["depth"], "KA03_Depth.png");
  for (const nlohmann::json& sensor : sensors) {
    EXPECT_TRUE(sensor.contains("intrinsics")) << sensor;
    EXPECT_FALSE(sensor.contains("depth_scale")) << "units are never guessed";
    EXPECT_TRUE(Mentions(draft_.unknown, sensor["name"].get<std::string>() + ": depth_scale",
                         "2 m at 0.001"));
  }
  EXPECT_TRUE(Mentions(draft_.found, "KA03", "of KA03.json"));
  EXPECT_TRUE(Mentions(draft_.found, "cam2", "of intrinsics.json"));
  EXPECT_TRUE(Mentions(draft_.found, "cam2", "rectified"));
}

TEST_F(CaptureDraftTest, RecordingsStateAll) {
  std::filesystem::copy("tests/infer/formats/recordings/realsense.bag", folder_ / "front.bag");
  std::filesystem::create_directories(folder_ / "back");
  std::filesystem::copy("tests/infer/formats/recordings/kinect.mkv", folder_ / "back/output.mkv");
  const nlohmann::json sensors = Draft();
  EXPECT_TRUE(draft_.unknown.empty()) << draft_.unknown.front();
  EXPECT_EQ(sensors[0]["name"], "front");
  EXPECT_EQ(sensors[0]["depth_scale"], 0.0001);
  EXPECT_EQ(sensors[0]["serial"], "918512071234");
  EXPECT_EQ(sensors[1]["name"], "back");
  EXPECT_EQ(sensors[1]["depth"], "back/output.mkv");
  EXPECT_EQ(sensors[1]["intrinsics"]["distortion"].size(), 8u);
  // What it writes can be read.
  WriteText("capture.json", draft_.json);
  const Capture capture = ReadCapture(folder_ / "capture.json");
  EXPECT_EQ(capture.sensors.size(), 2u);
  EXPECT_EQ(capture.sensors[1].depth_scale, 0.001);
}

TEST_F(CaptureDraftTest, NamesThatNoCaptureCanHaveAreSaid) {
  WriteDepth("-rf_depth.png");
  EXPECT_EQ(Draft()[0]["name"], "sensor");
  WriteDepth(
      "K\xfc"
      "che_depth.png");
  ExpectError<DataError>([&] { Draft(); }, {"K\\xfc"
                                            "che_depth.png",
                                            "not UTF-8", "rename"});
}

TEST_F(CaptureDraftTest, TypicalIntrinsicsAreAskedForAndMarked) {
  WriteDepth("own_depth.png");
  WriteText("own_intrinsics.json", kIntrinsics);
  WriteDepth("typical_depth.png");
  CaptureDraftOptions options;
  options.depth_scale = 0.001;
  options.sensor = "kinect_v1";
  options.structure = folder_ / "boxes.yaml";
  options.typical = true;
  nlohmann::json sensors = Draft(options);
  EXPECT_EQ(nlohmann::json::parse(draft_.json)["structure"], "boxes.yaml");
  EXPECT_FALSE(sensors[0].contains("typical_intrinsics"));
  EXPECT_EQ(sensors[0]["intrinsics"]["fx"], 5);
  // By the pool for 640x480.
  const std::optional<Intrinsics> typical = TypicalIntrinsics("kinect_v1", 4, 3);
  ASSERT_TRUE(typical);
  EXPECT_NEAR(typical->fx, 580.0 * 4 / 640, 0.2);
  EXPECT_EQ(sensors[1]["intrinsics"]["fx"], typical->fx);
  EXPECT_FALSE(sensors[1]["intrinsics"].contains("distortion"));
  EXPECT_EQ(sensors[1]["typical_intrinsics"], true);
  EXPECT_TRUE(Mentions(draft_.found, "typical: ", "its pose will be weak"));
  WriteText("capture.json", draft_.json);
  const Capture capture = ReadCapture(folder_ / "capture.json");
  EXPECT_FALSE(capture.sensors[0].typical_intrinsics);
  EXPECT_TRUE(capture.sensors[1].typical_intrinsics);
  options.sensor = "kinect_v2";
  EXPECT_FALSE(Draft(options)[1].contains("intrinsics"));
  EXPECT_TRUE(Mentions(draft_.unknown, "typical: ", "typical intrinsics of kinect_v2 at 4x3"));
}

TEST_F(CaptureDraftTest, SaysWhatIsAmiss) {
  ExpectError<IoError>([&] { DraftCapture(folder_ / "none", folder_.path(), {}); }, {"none"});
  ExpectError<DataError>([&] { Draft(); }, {"no depth that can be read"});
  WritePng(folder_ / "picture.png", LabelImage(4, 3, 1));
  ExpectError<DataError>([&] { Draft(); }, {"no depth that can be read", "8 bits"});
  // Intrinsics of another resolution.
  WriteDepth("A_depth.png");
  WriteText("A.json", R"({"width": 8, "height": 6, "fx": 5, "fy": 5, "cx": 3, "cy": 2})");
  Draft();
  EXPECT_TRUE(Mentions(draft_.unknown, "A: intrinsics", "8x6"));
  // Frames of several names: which are depth?
  WriteDepth("B/first_1.png");
  WriteDepth("B/second_1.png");
  Draft();
  EXPECT_TRUE(Mentions(draft_.unknown, "B", "which of its images"));
}

// An option that would do nothing is refused, and said where it does something for others alone.
TEST_F(CaptureDraftTest, OptionsTakeEffectOrAreRefused) {
  std::filesystem::copy("tests/infer/formats/recordings/realsense.bag", folder_ / "front.bag");
  WriteText("k.json", kIntrinsics);
  CaptureDraftOptions options;
  options.depth_scale = 0.001;
  ExpectError<ConfigError>([&] { Draft(options); }, {"--depth-scale", "front has 0.0001 m"});
  options = {};
  options.depth_scale = 0.0001f;  // the same
  EXPECT_EQ(Draft(options)[0]["depth_scale"], 0.0001);
  options = {};
  options.intrinsics = folder_ / "k.json";
  ExpectError<ConfigError>([&] { Draft(options); },
                           {"--intrinsics", "front has those of /device_0"});
  options = {};
  options.sensor = "kinect_v2";
  ExpectError<ConfigError>([&] { Draft(options); }, {"--sensor", "front is a realsense_d415"});
  WriteDepth("other_depth.png");
  options.depth_scale = 0.001;
  options.intrinsics = folder_ / "k.json";
  const nlohmann::json sensors = Draft(options);
  EXPECT_EQ(sensors[0]["name"], "other");
  EXPECT_EQ(sensors[0]["sensor"], "kinect_v2");
  EXPECT_EQ(sensors[0]["depth_scale"], 0.001);
  EXPECT_EQ(sensors[1]["depth_scale"], 0.0001);
  for (const char* option : {"--depth-scale", "--intrinsics", "--sensor"})
    EXPECT_TRUE(Mentions(draft_.found, option, "front")) << option;
}

TEST_F(CaptureDraftTest, FilesOfIntrinsicsThatAreNotUnderstood) {
  WriteDepth("A_depth.png");
  WriteText("A_intrinsics.txt", std::string("\xff\xfew\0", 4));
  WriteText("A.xml", "<?xml version=\"1.0\"?>");
  WriteText("calibration.json", "{\"focal\": 1}");
  Draft();
  for (const char* part : {"A_intrinsics.txt: its text is UTF-16", "A.xml: it is XML",
                           "calibration.json: it has none of the forms"})
    EXPECT_TRUE(Mentions(draft_.unknown, "A: intrinsics", part)) << part;
}

TEST_F(CaptureDraftTest, FramesOfOneSensorInAFlatFolder) {
  const auto write = [&](const std::string& name, int depth) {
    Image16 image(4, 3);
    for (std::size_t i = 0; i < image.size(); ++i)
      image[i] = static_cast<std::uint16_t>(depth + 300 * static_cast<int>(i));
    WritePng(folder_ / name, image);
  };
  // Whatever their numbers are, other views are other sensors.
  write("001_depth.png", 1000);
  write("002_depth.png", 3000);
  EXPECT_EQ(Draft().size(), 2u);
  write("002_depth.png", 1003);
  nlohmann::json sensors = Draft();
  ASSERT_EQ(sensors.size(), 1u);
  EXPECT_EQ(sensors[0]["name"], "depth");
  EXPECT_EQ(sensors[0]["depth"].size(), 2u);
  // Of rs-convert, and by the times of a logger.
  write("cam_Depth_1623335560.12345.png", 1000);
  write("cam_Depth_1623335560.45678.png", 1000);
  write("1623335560123.png", 2000);
  write("1623335560156.png", 2004);
  write("frame-1.depth.png", 4000);
  write("frame-2.depth.png", 4004);
  // Numbers of sensors.
  write("KA01_depth.png", 1500);
  write("KA02_depth.png", 1500);
  std::map<std::string, std::size_t> frames;
  for (const nlohmann::json& sensor : Draft())
    frames[sensor["name"]] = sensor["depth"].is_array() ? sensor["depth"].size() : 1;
  EXPECT_EQ(frames["cam"], 2u);
  EXPECT_EQ(frames["frame"], 2u);
  EXPECT_EQ(frames["KA01"], 1u);
  EXPECT_EQ(frames["KA02"], 1u);
}

TEST_F(CaptureDraftTest, PartsOfOneRecording) {
  for (const char* part : {"r_0.db3", "r_1.db3", "other.db3"})
    std::filesystem::copy("tests/infer/formats/recordings/realsense.db3", folder_ / part);
  WriteText("metadata.yaml",
            "rosbag2_bagfile_information:\n  relative_file_paths:\n    - r_0.db3\n    - r_1.db3\n");
  const nlohmann::json sensors = Draft();
  ASSERT_EQ(sensors.size(), 1u);
  EXPECT_TRUE(Mentions(draft_.found, "left out", "r_1.db3: a later part of the recording r_0.db3"));
  // Of the same device, with the same view.
  EXPECT_TRUE(Mentions(draft_.found, "left out", "sees the same"));
}

}  // namespace
}  // namespace volalign::capture_draft_test
