#include "infer/capture/capture.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "core/base/file_util.h"
#include "core/formats/image_io.h"
#include "core/geometry/camera.h"
#include "infer/capture/capture_draft.h"
#include "infer/capture/mean_depth.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/formats/write_pgm.h"

namespace volalign::capture_test {
namespace {

constexpr char kCamera[] = R"({"width": 4, "height": 3, "fx": 5, "fy": 5.5, "cx": 1.5, "cy": 1})";
const std::string kIntrinsics = std::string(R"("intrinsics": )") + kCamera;

class CaptureTest : public ::testing::Test {
 protected:
  void SetUp() override {
    Image16 image(4, 3);
    for (std::size_t i = 0; i < image.size(); ++i) image[i] = static_cast<std::uint16_t>(1000 + i);
    WritePgm(folder_ / "a.pgm", image);
    WritePng(folder_ / "b.png", image);
  }

  std::filesystem::path Write(const std::string& json) {
    WriteFileAtomically(folder_ / "capture.json", json);
    return folder_ / "capture.json";
  }
  std::filesystem::path WriteSensor(const std::string& fields) {
    return Write(R"({"depth_scale": 0.001, "sensors": [{"name": "A", )" + fields + "}]}");
  }
  void ExpectBad(const std::filesystem::path& path, std::initializer_list<std::string> parts) {
    ExpectError<DataError>([&] { ReadCapture(path); }, parts);
  }

  TempFolder folder_;
};

TEST_F(CaptureTest, ReadsPriorsOfPoses) {
  const std::string pose = "[[0,0,1,1],[1,0,0,2],[0,1,0,3],[0,0,0,1]]";
  const auto write = [&](const std::string& prior) {
    return WriteSensor(R"("depth": "a.pgm", "prior": )" + prior + ", " + kIntrinsics);
  };
  const auto read = [&](const std::string& prior) {
    return *ReadCapture(write(prior)).sensors[0].prior;
  };
  const std::string sigmas = R"("sigma_m": 0.5, "sigma_deg": 7)";
  const PosePrior plain = read(R"({"structure_from_sensor": )" + pose + ", " + sigmas + "}");
  EXPECT_EQ(plain.world, PriorWorld::kStructure);
  EXPECT_EQ(plain.world_from_sensor.translation(), Eigen::Vector3d(1, 2, 3));
  const PosePrior full =
      read(R"({"world_from_sensor": )" + pose + R"(, "scale": "free", )" + sigmas + "}");
  EXPECT_EQ(full.world, PriorWorld::kScaleFree);
  EXPECT_DOUBLE_EQ(full.sigma_m, 0.5);
  EXPECT_DOUBLE_EQ(full.sigma_deg, 7);
  EXPECT_EQ(read(R"({"world_from_sensor": )" + pose + ", " + sigmas + "}").world,
            PriorWorld::kMetric);
  ExpectBad(write(R"({"world_from_sensor": )" + pose + "}"), {"sigma_m"});
  ExpectBad(write("{}"), {"\"A\"", "prior", "world_from_sensor"});
  ExpectBad(write(R"({"structure_from_sensor": )" + pose + R"(, "scale": "free"})"), {"scale"});
  ExpectBad(write(R"({"world_from_sensor": )" + pose + R"(, "sigma": 1})"), {"sigma"});
  ExpectBad(write(R"({"world_from_sensor": [[1]]})"), {"world_from_sensor"});
}

TEST_F(CaptureTest, ReadsEveryField) {
  const CaptureFile capture = ReadCapture(Write(std::string(R"({
    "format": "volalign.capture/1", "depth_scale": 0.001, "structure": "s.glb",
    "sensors": [
      {"name": "A", "depth": "a.pgm", "quarter_turns": 3, "serial": "0001", "renderer": "tiles", "sensor": "a kind of its own", )") +
                                                kIntrinsics + R"(},
      {"name": "B", "depth": "b.png", "depth_scale": 0.0001, "quarter_turns": "auto", )" +
                                                kIntrinsics + R"(}],
    "ground_truth": {"B": [[0,0,1,1],[1,0,0,2],[0,1,0,3],[0,0,0,1]]} })"));
  ASSERT_EQ(capture.sensors.size(), 2u);
  EXPECT_EQ(*capture.structure, folder_ / "s.glb");
  const SensorFrame &a = capture.sensors[0], &b = capture.sensors[1];
  EXPECT_EQ(a.name, "A");
  EXPECT_EQ(a.serial, "0001");
  EXPECT_EQ(a.renderer, "tiles");
  EXPECT_EQ(a.sensor, "a kind of its own");
  EXPECT_EQ(b.sensor, "");
  EXPECT_EQ(a.quarter_turns, 3);
  EXPECT_EQ(b.quarter_turns, kAutoTurns);
  EXPECT_DOUBLE_EQ(a.intrinsics.fy, 5.5);
  EXPECT_FLOAT_EQ(a.depth(1, 2), 1.009f);
  EXPECT_FLOAT_EQ(b.depth(1, 2), 0.1009f);
  EXPECT_FALSE(a.ground_truth.has_value());
  ASSERT_TRUE(b.ground_truth.has_value());
  EXPECT_EQ(*b.ground_truth * Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(1, 3, 3));
}

TEST_F(CaptureTest, AListOfFramesIsTheMeanOfWhatTheyMeasured) {
  // Near the median, whose deviation of the others is the second of three: see SetMeanDepth.
  std::string list;
  for (const std::uint16_t depth : {1000, 1010, 1020}) {
    const std::string name = std::to_string(depth) + ".pgm";
    WritePgm(folder_ / name, Image16(4, 3, depth));
    list += (list.empty() ? "\"" : ", \"") + name + "\"";
  }
  const SensorFrame frame =
      ReadCapture(WriteSensor("\"depth\": [" + list + "], " + kIntrinsics)).sensors[0];
  EXPECT_FLOAT_EQ(frame.depth[5], 1.010f);
  EXPECT_FLOAT_EQ(frame.depth_sigma[5], 0.010f / std::sqrt(3.0f));
  EXPECT_EQ(frame.depth_files.size(), 3u);
}

TEST_F(CaptureTest, SaysWhatIsWrongWithTheJson) {
  const std::string depth = "\"depth\": \"a.pgm\", ";
  ExpectBad(Write("{\"sensors\": [}"), {"capture.json", "not valid JSON", "line 1"});
  ExpectBad(Write("{\"format\": \"volalign.capture/9\", \"sensors\": []}"),
            {"volalign.capture/9", "volalign.capture/1"});
  ExpectBad(Write("[]"), {"object"});
  ExpectBad(Write("{\"depth_scale\": 0.001, \"sensors\": []}"), {"sensors is empty"});
  ExpectBad(Write("{\"depth_scale\": 0.001}"), {"\"sensors\"", "missing"});
  ExpectBad(WriteSensor(depth + "\"quarter_turns\": 4, " + kIntrinsics),
            {"sensor \"A\"", "quarter_turns = 4"});
  ExpectBad(WriteSensor(depth + "\"sensor\": \"azure\\nkinect\", " + kIntrinsics),
            {"sensor \"A\"", "azure\\x0akinect", "control character"});
  ExpectBad(WriteSensor(depth + "\"depth_scale\": -1, " + kIntrinsics), {"depth_scale = -1"});
  ExpectBad(WriteSensor(depth + "\"depth_scale\": \"mm\", " + kIntrinsics),
            {"depth_scale", "finite number"});
  ExpectBad(WriteSensor("\"depth\": [], " + kIntrinsics), {"depth is an empty list"});
  ExpectBad(WriteSensor("\"depth\": \"a.pgm\""), {"sensor \"A\"", "\"intrinsics\"", "missing"});
  const std::string sensor = R"({"name": "A", "depth": "a.pgm", )" + kIntrinsics + "}";
  ExpectBad(Write(R"({"sensors": [)" + sensor + "]}"), {"sensor \"A\"", "no depth_scale"});
  // What is misspelled is missing, too, but not what one looks for.
  ExpectBad(WriteSensor(R"("depth": "a.pgm", "intrinsic": {"width": 4})"),
            {"sensor \"A\"", "\"intrinsic\"", "did you mean \"intrinsics\"?"});
  ExpectBad(Write(R"({"sensor": []})"), {"\"sensor\"", "did you mean \"sensors\"?"});
  ExpectBad(
      WriteSensor(R"("depth": "a.pgm", "intrinsics": {"width": 4, "height": 3, "fx": 5, "fy": 5,
      "cx": 1.5, "cy": 1, "distortion": [-9, 0, 0, 0]})"),
      {"capture.json", "sensor \"A\"", "distortion", "k1 k2 p1"});
  ExpectBad(Write("{\"depth_scale\": 0.001, \"sensors\": [" + sensor + ", " + sensor + "]}"),
            {"two sensors are named \"A\""});
  ExpectBad(Write("{\"depth_scale\": 0.001, \"sensors\": [" + sensor +
                  "], \"ground_truth\": {\"B\": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}}"),
            {"ground_truth", "\"B\""});
  ExpectBad(Write("{\"depth_scale\": 0.001, \"sensors\": [" + sensor +
                  "], \"ground_truth\": {\"A\": [[2,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}}"),
            {"ground_truth: A"});
}

TEST_F(CaptureTest, SensorNamesServeAsFileNames) {
  for (const std::string& name : std::vector<std::string>{
           "", "a/b", "..", "overview", "merged", "A\\u001b[31mRED", "A\\n0 9 9 9 0 0 0 1",
           "A\\u009b", "-rf", "A\\u202egnp", std::string(101, 'a')}) {
    ExpectBad(Write(R"({"depth_scale": 0.001, "sensors": [{"name": ")" + name +
                    R"(", "depth": "a.pgm", )" + kIntrinsics + "}]}"),
              {"file name"});
  }
}

TEST_F(CaptureTest, TextsThatAreCarriedOnArePlain) {
  for (const std::string key : {"serial", "renderer", "sensor"}) {
    for (const std::string& text : {std::string("a\\u001b[31m\\n"), std::string(100000, 'a')})
      ExpectBad(
          WriteSensor(fmt::format(R"("depth": "a.pgm", "{}": "{}", )", key, text) + kIntrinsics),
          {key + " = \"a", "plain text"});
  }
}

TEST_F(CaptureTest, SaysWhatIsWrongWithTheImages) {
  const auto of = [&](const std::string& camera) {
    return WriteSensor(R"("depth": "a.pgm", "intrinsics": {)" + camera +
                       R"("fy": 5, "cx": 1, "cy": 1})");
  };
  ExpectBad(of(R"("width": 3, "height": 4, "fx": 5, )"), {"sensor \"A\"", "a.pgm", "4x3", "3x4"});
  ExpectBad(of(R"("width": 4, "height": 3, "fx": 5, "distortion": [0.1, 0.2, 0.3], )"),
            {"sensor \"A\"", "intrinsics", "distortion"});
  ExpectBad(of(R"("width": 4, "height": 3, "fx": 0, )"), {"sensor \"A\"", "intrinsics"});
  const std::string whole = ReadFile(folder_ / "a.pgm");
  WriteFileAtomically(folder_ / "cut.pgm", whole.substr(0, whole.size() - 5));
  ExpectBad(WriteSensor("\"depth\": \"cut.pgm\", " + kIntrinsics), {"sensor \"A\"", "cut.pgm"});
  ExpectError<IoError>([&] { ReadCapture(folder_ / "nowhere.json"); }, {"nowhere.json"});
  for (const char* no_file : {"none.pgm", "/dev/zero", "/tmp"}) {
    ExpectError<IoError>(
        [&] {
          ReadCapture(WriteSensor(fmt::format("\"depth\": \"{}\", {}", no_file, kIntrinsics)));
        },
        {"sensor \"A\"", no_file});
  }
}

TEST_F(CaptureTest, HasAtMostAThousandSensors) {
  std::string sensors;
  for (int i = 0; i < 1001; ++i)
    sensors +=
        fmt::format(R"({}{{"name": "S{}", "depth": "a.pgm", {}}})", i ? ", " : "", i, kIntrinsics);
  ExpectBad(Write("{\"depth_scale\": 0.001, \"sensors\": [" + sensors + "]}"),
            {"1001 sensors", "at most 1000"});
}

TEST_F(CaptureTest, KeysOfRecordingsAreNotPassedOver) {
  ExpectBad(WriteSensor("\"depth\": \"a.pgm\", \"frames\": 3, " + kIntrinsics),
            {"sensor \"A\"", "frames", "recording"});
  ExpectBad(Write("\xff\xfe{"), {"capture.json", "UTF-16", "UTF-8"});
}

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
    return std::any_of(sentences.begin(), sentences.end(),
                       [&](const std::string& sentence) { return Has(sentence, a, b); });
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
  EXPECT_TRUE(Mentions(draft_.found, "A, D: the lens is unknown and will be estimated",
                       "no kind of sensor"));
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
  WriteText("KA03.json", kCamera);
  WriteText("intrinsics.json", kCamera);
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
  const CaptureFile capture = ReadCapture(folder_ / "capture.json");
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
  WriteText("own_intrinsics.json", kCamera);
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
  const CaptureFile capture = ReadCapture(folder_ / "capture.json");
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
  WriteText("k.json", kCamera);
  const auto refused = [&](const CaptureDraftOptions& of, const char* option, const char* why) {
    ExpectError<ConfigError>([&] { Draft(of); }, {option, why});
  };
  CaptureDraftOptions scale, camera, options;
  scale.depth_scale = 0.001;
  refused(scale, "--depth-scale", "front has 0.0001 m");
  scale.depth_scale = 0.0001f;  // the same
  EXPECT_EQ(Draft(scale)[0]["depth_scale"], 0.0001);
  camera.intrinsics = folder_ / "k.json";
  refused(camera, "--intrinsics", "front has those of /device_0");
  options.sensor = "kinect_v2";
  refused(options, "--sensor", "front is a realsense_d415");
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

namespace fs = std::filesystem;

std::vector<std::string> Names(const std::vector<fs::path>& paths) {
  std::vector<std::string> names;
  for (const fs::path& path : paths) names.push_back(path.filename().string());
  return names;
}

using Words = std::vector<std::string>;

TEST(LookInto, TellsFilesApartByNameAndContent) {
  const TempFolder folder;
  for (const char* image : {"frame_10.png", "frame_9.PNG", "frame_9b.tiff", "cam_ir_1.png",
                            "a-colour.png", "firing.png", "labels.png"})
    folder.Write(image, "");
  const std::string intrinsics =
      R"("width": 640, "height": 480, "fx": 1, "fy": 1, "cx": 1, "cy": 1)";
  folder.Write("one.bag", "#ROSBAG V2.0\n");
  folder.Write("k.json", "{" + intrinsics + "}");
  folder.Write("capture.json",
               "{\"format\": \"" + std::string(kCaptureFormat) + "\", " + intrinsics + "}");
  folder.Write("rig.json", "{\"sensors\": [{" + intrinsics + "}]}");
  folder.Write("k.dat", "{" + intrinsics + "}");
  folder.Write("notes.txt", "nothing");
  folder.Write("damaged.mcap", "nothing");
  fs::create_directory(folder / "sub.png");
  const FolderContent found = LookInto(folder.path());
  EXPECT_EQ(Names(found.images),
            (Words{"firing.png", "frame_9.PNG", "frame_9b.tiff", "frame_10.png"}));
  EXPECT_EQ(found.left_out, (Words{"a-colour.png", "cam_ir_1.png", "labels.png"}));
  EXPECT_EQ(Names(found.recordings), Words{"one.bag"});
  EXPECT_EQ(Names(found.intrinsics), Words{"k.json"});
  ASSERT_EQ(found.not_read.size(), 1u);
  EXPECT_EQ(found.not_read[0].rfind("damaged.mcap: ", 0), 0u);
  ASSERT_EQ(found.not_understood.size(), 1u);
  EXPECT_EQ(found.not_understood[0].rfind("notes.txt: ", 0), 0u);
}

TEST(IsNamedAsFrame, TellsFramesFromSensors) {
  for (const char* frame : {"000001", "000001_depth", "frame_7", "img3", "1623335560123",
                            "1305031102.160407", "frame-000000.depth"})
    EXPECT_TRUE(IsNamedAsFrame(frame)) << frame;
  for (const char* sensor : {"1", "01", "KA03", "cam_2", "918512071234", "918512071234_depth", "a"})
    EXPECT_FALSE(IsNamedAsFrame(sensor)) << sensor;
}

TEST(ComesBefore, CountsNumbersAsNumbers) {
  const Words order = {"a", "a1", "a02", "a2b", "a10", "a10b1", "a10b11", "b"};
  for (std::size_t i = 0; i < order.size(); ++i) {
    for (std::size_t j = 0; j < order.size(); ++j)
      EXPECT_EQ(ComesBefore(order[i], order[j]), i < j) << order[i] << " " << order[j];
  }
  EXPECT_TRUE(ComesBefore("z/a1", "b/a2"));  // the names alone
}

TEST(NameBesideDepth, IsTheSensorsOfTheFile) {
  EXPECT_EQ(NameBesideDepth("KA03_Depth_0007"), "KA03");
  EXPECT_EQ(NameBesideDepth("Left-depth"), "Left");
  EXPECT_EQ(NameBesideDepth("depth_Cam2"), "Cam2");
  EXPECT_EQ(NameBesideDepth("Depth12"), "");
  EXPECT_EQ(NameBesideDepth("cam2_z16"), "cam2");
  EXPECT_EQ(NameBesideDepth("a.depthmap - 12"), "a");
  EXPECT_EQ(NameBesideDepth("depth depth_x"), "depth_x");
  EXPECT_EQ(NameBesideDepth("depth_depth_1"), "depth");
  EXPECT_FALSE(NameBesideDepth("depthx"));
  EXPECT_FALSE(NameBesideDepth("frame_0007"));
  EXPECT_EQ(WithoutNumber("frame_0007"), "frame_");
  EXPECT_EQ(WithoutNumber("a1b"), "a1b");
  EXPECT_EQ(WithoutNumber("007"), "");
}

/// Of images of one row: in each, the value that `value(image, column)` gives.
template <class Value>
std::vector<StoredDepth> Rows(int images, int columns, const Value& value, bool whole = true) {
  std::vector<StoredDepth> rows;
  for (int k = 0; k < images; ++k) {
    Image<float> row(columns, 1);
    for (int i = 0; i < columns; ++i) row(i, 0) = static_cast<float>(value(k, i));
    rows.push_back({row, whole});
  }
  return rows;
}

SensorFrame MeanOf(const std::vector<StoredDepth>& images, double scale) {
  SensorFrame frame;
  frame.depth_scale = scale;
  SetMeanDepth(images, &frame);
  return frame;
}
/// The values of one pixel in several files.
SensorFrame PixelMean(const std::vector<double>& values, double scale, bool whole = true) {
  return MeanOf(Rows(
                    static_cast<int>(values.size()), 1,
                    [&](int k, int) { return values[static_cast<std::size_t>(k)]; }, whole),
                scale);
}

TEST(SetMeanDepth, OneImageIsTakenAsItIs) {
  const SensorFrame frame = PixelMean({1000}, 0.0001);
  EXPECT_FLOAT_EQ(frame.depth[0], 0.1f);
  EXPECT_TRUE(frame.depth_sigma.empty());
}

// By hand, in millimetres: the median, the deviation that 68 % keep, the mean of the values within
// three of these, and that deviation over the root of the number of values.
TEST(SetMeanDepth, IsTheMeanNearTheMedian) {
  struct Case {
    std::vector<double> values;
    double mean, sigma;
  };
  const Case cases[] = {
      {{1000, 1002, 1004}, 1002, 2 / std::sqrt(3)},
      {{1004, 1000, 1002}, 1002, 2 / std::sqrt(3)},
      {{1000, 1000, 1000, 1000}, 1000, 0.3 / 2},     // rounded to steps
      {{1000, 1000, 1000, 1001}, 1000.25, 0.3 / 2},  // a step is near
      {{1000, 1000, 1000, 1002}, 1000, 0.3 / 2},     // two are not
      {{0, 1500, 0}, 0, 0},                          // what is measured once
      {{0, 0, 0}, 0, 0},
      {{1000, 2000, 1000, 2000, 1000}, 1000, 1000 / std::sqrt(5)},  // of two surfaces the nearer
      {{1000, 2000, 2000, 1000}, 1000, 1000 / 2.0},                 // and of as many of each
      {{1000, 1040, 960, 1050, 950}, 1000, 50 / std::sqrt(5)},      // a jump is 45 mm at 1 m
      {{0, 2000, 2010, 1990, 0}, 2000, 10 / std::sqrt(3)},
  };
  for (const Case& c : cases) {
    const SensorFrame frame = PixelMean(c.values, 0.001);
    EXPECT_NEAR(1000 * frame.depth[0], c.mean, 1e-3) << c.values[0] << " " << c.values[1];
    EXPECT_NEAR(1000 * frame.depth_sigma[0], c.sigma, 1e-3) << c.values[0] << " " << c.values[1];
  }
}

TEST(SetMeanDepth, UnitsAreTheFilesOwn) {
  const SensorFrame fine = PixelMean({10000, 10020, 10040}, 0.0001);
  EXPECT_NEAR(fine.depth[0], 1.002, 1e-6);
  EXPECT_NEAR(fine.depth_sigma[0], 0.002 / std::sqrt(3), 1e-7);
  // Metres are stored as floats: no step of a metre, but one of 0.1 mm.
  const SensorFrame metres = PixelMean({1, 1, 1, 1}, 1, false);
  EXPECT_NEAR(metres.depth_sigma[0], 0.3e-4 / 2, 1e-9);
  EXPECT_NEAR(PixelMean({1, 1.002, 1.004}, 1, false).depth[0], 1.002, 1e-6);
}

TEST(SetMeanDepth, WhatIsMeasuredOnceOrTwiceOfManyIsNot) {
  const auto images = Rows(10, 3, [](int k, int i) { return k <= i ? 2000 : 0; });
  const SensorFrame of_ten = MeanOf(images, 0.001), of_two = MeanOf({images[0], images[1]}, 0.001);
  EXPECT_EQ(of_ten.depth[0], 0);
  EXPECT_EQ(of_ten.depth[1], 0);
  EXPECT_NEAR(of_ten.depth[2], 2, 1e-6);
  EXPECT_EQ(of_two.depth[0], 0);
  EXPECT_NEAR(of_two.depth[1], 2, 1e-6);
}

// Beyond the frames that are kept, by the median and the deviation of these.
TEST(MeanDepth, OfManyFramesIsARunningOne) {
  MeanDepth mean(0.001);
  constexpr int kFrames = 200;
  const int of_three[] = {1995, 2000, 2005};
  for (const StoredDepth& image : Rows(kFrames, 3, [&](int k, int i) {
         return i == 0   ? of_three[k % 3]
                : i == 1 ? (k % 4 == 0 ? 5000 : 2000)  // a quarter is another surface
                         : (k < 100 ? 0 : 3000);       // measured late
       }))
    mean.Add(image);
  SensorFrame frame;
  mean.Set(&frame);
  EXPECT_NEAR(frame.depth[0], 2.0, 1e-4);
  EXPECT_NEAR(frame.depth_sigma[0], 0.005 / std::sqrt(kFrames), 1e-6);
  EXPECT_NEAR(frame.depth[1], 2.0, 1e-6);
  EXPECT_NEAR(frame.depth[2], 3.0, 1e-6);
  EXPECT_NEAR(frame.depth_sigma[2], 0.0003 / std::sqrt(100), 1e-7);
}

}  // namespace
}  // namespace volalign::capture_test
