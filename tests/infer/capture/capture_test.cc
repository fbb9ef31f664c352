#include "infer/capture/capture.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <fstream>
#include <string>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/formats/image_io.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/formats/write_pgm.h"
#include "tests/infer/formats/bag_writer.h"

namespace volalign::capture_test {
namespace {

constexpr char kIntrinsics[] =
    R"("intrinsics": {"width": 4, "height": 3, "fx": 5.0, "fy": 5.5, "cx": 1.5, "cy": 1.0})";

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

TEST_F(CaptureTest, ReadsEveryField) {
  const Capture capture = ReadCapture(Write(std::string(R"({
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
  const std::uint16_t values[4][5] = {
      {0, 0, 7, 10, 1000}, {0, 5, 0, 20, 1000}, {0, 9, 9, 30, 3000}, {0, 0, 8, 0, 3000}};
  // By hand: means of the non-zero ones but, of those on two surfaces, of those about the lower
  // median; and the second of three, the third of four deviations from that, over the root of their
  // number. Of two values there is none.
  const float expected[5] = {0, 0, 8, 20, 1000};
  const float sigma[5] = {0, 0, 1 / std::sqrt(3.0f), 10 / std::sqrt(3.0f), 1000};
  std::string list;
  for (int i = 0; i < 4; ++i) {
    Image16 image(4, 3);
    for (std::size_t j = 0; j < 5; ++j) image[j] = values[i][j];
    const std::string name = "f" + std::to_string(i) + ".pgm";
    WritePgm(folder_ / name, image);
    list += (i ? ", \"" : "\"") + name + "\"";
  }
  const Capture capture = ReadCapture(WriteSensor("\"depth\": [" + list + "], " + kIntrinsics));
  for (std::size_t j = 0; j < 5; ++j) {
    EXPECT_FLOAT_EQ(capture.sensors[0].depth[j], 0.001f * expected[j]) << j;
    EXPECT_FLOAT_EQ(capture.sensors[0].depth_sigma[j], 0.001f * sigma[j]) << j;
  }
  EXPECT_EQ(capture.sensors[0].depth_files.size(), 4u);
}

TEST_F(CaptureTest, SaysWhatIsWrongWithTheJson) {
  const std::string depth = "\"depth\": \"a.pgm\", ";
  ExpectBad(Write("{\"sensors\": [}"), {"capture.json", "not valid JSON", "line 1"});
  ExpectBad(Write("{\"depth_scale\": NaN}"), {"capture.json", "not valid JSON"});
  ExpectBad(Write("{\"depth_scale\": null, \"sensors\": []}"), {"null", "leave the key out"});
  ExpectBad(Write("{\"depth_scale\": 1, \"depth_scale\": 2}"), {"\"depth_scale\"", "twice"});
  ExpectBad(Write("{\"format\": \"volalign.capture/9\", \"sensors\": []}"),
            {"volalign.capture/9", "volalign.capture/1"});
  ExpectBad(Write("[]"), {"object"});
  ExpectBad(Write("{\"depth_scale\": 0.001, \"sensors\": []}"), {"sensors is empty"});
  ExpectBad(Write("{\"depth_scale\": 0.001}"), {"\"sensors\"", "missing"});
  ExpectBad(WriteSensor(depth + "\"quarterturns\": 1, " + kIntrinsics),
            {"sensor \"A\"", "quarterturns", "did you mean \"quarter_turns\""});
  ExpectBad(WriteSensor(depth + "\"quarter_turns\": 4, " + kIntrinsics),
            {"sensor \"A\"", "quarter_turns = 4"});
  ExpectBad(WriteSensor(depth + "\"sensor\": \"azure\\nkinect\", " + kIntrinsics),
            {"sensor \"A\"", "azure\\x0akinect", "control character"});
  ExpectBad(WriteSensor(depth + "\"depth_scale\": -1, " + kIntrinsics), {"depth_scale = -1"});
  ExpectBad(WriteSensor(depth + "\"depth_scale\": \"mm\", " + kIntrinsics),
            {"depth_scale", "finite number"});
  ExpectBad(WriteSensor("\"depth\": [], " + std::string(kIntrinsics)), {"depth is an empty list"});
  ExpectBad(WriteSensor("\"depth\": \"a.pgm\""), {"sensor \"A\"", "\"intrinsics\"", "missing"});
  ExpectBad(
      Write(std::string(R"({"sensors": [{"name": "A", "depth": "a.pgm", )") + kIntrinsics + "}]}"),
      {"sensor \"A\"", "no depth_scale"});
  // What is misspelled is missing, too, but not what one looks for.
  ExpectBad(WriteSensor(R"("depth": "a.pgm", "intrinsic": {"width": 4})"),
            {"sensor \"A\"", "\"intrinsic\"", "did you mean \"intrinsics\"?"});
  ExpectBad(Write(R"({"sensor": []})"), {"\"sensor\"", "did you mean \"sensors\"?"});
  ExpectBad(
      WriteSensor(R"("depth": "a.pgm", "intrinsics": {"width": 4, "height": 3, "fx": 5, "fy": 5,
      "cx": 1.5, "cy": 1, "distortion": [-9, 0, 0, 0]})"),
      {"capture.json", "sensor \"A\"", "distortion", "k1 k2 p1"});
  const std::string sensor = std::string(R"({"name": "A", "depth": "a.pgm", )") + kIntrinsics + "}";
  ExpectBad(Write("{\"depth_scale\": 0.001, \"sensors\": [" + sensor + ", " + sensor + "]}"),
            {"two sensors are named \"A\""});
  ExpectBad(Write("{\"depth_scale\": 0.001, \"sensors\": [" + sensor +
                  "], \"ground_truth\": {\"B\": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}}"),
            {"ground_truth", "\"B\""});
  ExpectBad(Write("{\"depth_scale\": 0.001, \"sensors\": [" + sensor +
                  "], \"ground_truth\": {\"A\": [[2,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}}"),
            {"ground_truth of \"A\""});
}

TEST_F(CaptureTest, SensorNamesServeAsFileNames) {
  for (const std::string& name :
       {std::string(), std::string("a/b"), std::string(".."), std::string("overview"),
        std::string("merged"), std::string("A\\u001b[31mRED"), std::string("A\\n0 9 9 9 0 0 0 1"),
        std::string("A\\u009b"), std::string("-rf"), std::string("A\\u202egnp"),
        std::string(101, 'a')}) {
    ExpectBad(Write(R"({"depth_scale": 0.001, "sensors": [{"name": ")" + name +
                    R"(", "depth": "a.pgm", )" + kIntrinsics + "}]}"),
              {"file name"});
  }
}

TEST_F(CaptureTest, TextsThatAreCarriedOnArePlain) {
  for (const std::string& key :
       {std::string("serial"), std::string("renderer"), std::string("sensor")})
    for (const std::string& text : {std::string("a\\u001b[31m\\n"), std::string(100000, 'a')}) {
      ExpectBad(Write(R"({"depth_scale": 0.001, "sensors": [{"name": "A", "depth": "a.pgm", ")" +
                      key + "\": \"" + text + "\", " + kIntrinsics + "}]}"),
                {key + " = \"a", "plain text"});
    }
}

TEST_F(CaptureTest, SaysWhatIsWrongWithTheImages) {
  ExpectBad(
      WriteSensor(
          R"("depth": "a.pgm", "intrinsics": {"width": 3, "height": 4, "fx": 5, "fy": 5, "cx": 1, "cy": 1})"),
      {"sensor \"A\"", "a.pgm", "4x3", "3x4"});
  ExpectBad(
      WriteSensor(
          R"("depth": "a.pgm", "intrinsics": {"width": 4, "height": 3, "fx": 5, "fy": 5, "cx": 1, "cy": 1, "distortion": [0.1, 0.2, 0.3]})"),
      {"sensor \"A\"", "intrinsics", "distortion"});
  ExpectBad(
      WriteSensor(
          R"("depth": "a.pgm", "intrinsics": {"width": 4, "height": 3, "fx": 0, "fy": 5, "cx": 1, "cy": 1})"),
      {"sensor \"A\"", "intrinsics"});
  const std::string whole = ReadFile(folder_ / "a.pgm");
  WriteFileAtomically(folder_ / "cut.pgm", whole.substr(0, whole.size() - 5));
  ExpectBad(WriteSensor("\"depth\": \"cut.pgm\", " + std::string(kIntrinsics)),
            {"sensor \"A\"", "cut.pgm"});
  ExpectError<IoError>(
      [&] { ReadCapture(WriteSensor("\"depth\": \"none.pgm\", " + std::string(kIntrinsics))); },
      {"sensor \"A\"", "none.pgm"});
  ExpectError<IoError>([&] { ReadCapture(folder_ / "nowhere.json"); }, {"nowhere.json"});
  for (const char* no_file : {"/dev/zero", "/tmp"}) {
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
  ExpectBad(WriteSensor("\"depth\": \"a.pgm\", \"frames\": 3, " + std::string(kIntrinsics)),
            {"sensor \"A\"", "frames", "recording"});
  ExpectBad(Write("\xff\xfe{"), {"capture.json", "UTF-16", "UTF-8"});
}

/// A bag whose camera has no calibration, of one frame of 4x3.
std::string UncalibratedBag() {
  using namespace bag_writer;
  const std::string header = std::string(12, '\0') + Block("d");
  const std::string size = Bytes<std::uint32_t>(3) + Bytes<std::uint32_t>(4);
  const std::string image = header + size + Block("16UC1") + '\0' + Bytes<std::uint32_t>(8) +
                            Block(std::string(24, '\1'));
  const std::string camera =
      header + size + Block("plumb_bob") + Bytes<std::uint32_t>(0) + std::string(30 * 8, '\0');
  return Bag(Chunk(Connection(0, "/d/image", "sensor_msgs/Image") + Message(0, image) +
                   Connection(1, "/d/camera_info", "sensor_msgs/CameraInfo") + Message(1, camera)));
}

// What the capture says is not asked of the recording; a convention is no statement.
TEST_F(CaptureTest, OverridesWhatARecordingSays) {
  folder_.Write("a.bag", UncalibratedBag());
  const std::string depth = "\"depth\": \"a.bag\"";
  const Capture capture = ReadCapture(WriteSensor(depth + ", " + kIntrinsics));
  EXPECT_EQ(capture.sensors[0].intrinsics.fy, 5.5);
  ExpectBad(WriteSensor(depth), {"sensor \"A\"", "/d/camera_info", "not calibrated", "intrinsics"});
  const Capture tenths = ReadCapture(Write(R"({"depth_scale": 0.0001, "sensors": [{"name": "A", )" +
                                           depth + ", " + kIntrinsics + "}]}"));
  EXPECT_FLOAT_EQ(tenths.sensors[0].depth(0, 0), 0.0257f);
}

}  // namespace
}  // namespace volalign::capture_test
