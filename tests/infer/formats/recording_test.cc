// Recordings that other programs wrote: realsense.bag by librealsense 2.56's recorder from a
// software device, realsense.db3 by that of 2.59, kinect.mkv by ffmpeg and mkvmerge
// (tests/compat/record_depth.py has the values).

#include "infer/formats/recording.h"

#include <gtest/gtest.h>
#include <sqlite3.h>

#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "infer/capture/capture.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::recording_test {
namespace {

constexpr char kBag[] = "tests/infer/formats/recordings/realsense.bag";
constexpr char kDb3[] = "tests/infer/formats/recordings/realsense.db3";
constexpr char kMkv[] = "tests/infer/formats/recordings/kinect.mkv";

/// What is in kBag and in kDb3.
void ExpectRealSense(const std::string& file) {
  ASSERT_TRUE(IsRecording(file));
  const std::vector<RecordedDepth> streams = ReadRecording(file, 2);
  ASSERT_EQ(streams.size(), 1u);
  const RecordedDepth& depth = streams[0];
  EXPECT_EQ(depth.stream, "/device_0/sensor_0/Depth_0/image/data");
  EXPECT_EQ(depth.device, "Intel RealSense D415");
  EXPECT_EQ(depth.kind, "realsense_d415");
  EXPECT_EQ(depth.serial, "918512071234");
  ASSERT_TRUE(depth.depth_scale && depth.intrinsics);
  EXPECT_EQ(*depth.depth_scale, 0.0001);
  EXPECT_EQ(*depth.intrinsics, (Intrinsics{64, 48, 47.5, 47.25, 31.5, 23.75, {0, 0, 0, 0, 0}}));
  ASSERT_EQ(depth.frames.size(), 2u);
  EXPECT_EQ(ReadRecording(file, 100)[0].frames.size(), 3u);
  for (int i = 0; i < 2; ++i) {
    const StoredDepth& frame = depth.frames[static_cast<std::size_t>(i)];
    EXPECT_TRUE(frame.whole_numbers);
    for (int v = 0; v < 48; ++v)
      for (int u = 0; u < 64; ++u)
        ASSERT_EQ(frame.values(u, v), static_cast<float>(10000 + 100 * i + 64 * v + u));
  }
}

TEST(RecordingTest, RealSenseBag) { ExpectRealSense(kBag); }

TEST(RecordingTest, RealSenseDb3) { ExpectRealSense(kDb3); }

// Of a bag whose pages are cut off, and of a database that is none.
TEST(RecordingTest, DamagedDb3) {
  const TempFolder folder;
  const std::string bytes = ReadFile(kDb3);
  for (const std::size_t size : {std::size_t{50}, std::size_t{5000}, bytes.size() / 2}) {
    WriteFileAtomically(folder / "cut.db3", bytes.substr(0, size));
    ExpectError<DataError>([&] { ReadRecording(folder / "cut.db3", 3); }, {"cut.db3"});
  }
  // The images' PNG begins after a header of twelve bytes.
  std::string other = bytes;
  const std::string png = "\x89PNG";
  for (std::size_t at = 0; (at = other.find(png, at)) != std::string::npos; ++at) other[at] = 'x';
  WriteFileAtomically(folder / "png.db3", other);
  ExpectError<DataError>([&] { ReadRecording(folder / "png.db3", 3); }, {"png.db3"});
}

// What a bag says is data, never a part of a statement.
TEST(RecordingTest, Db3WithAStatementForAnId) {
  const TempFolder folder;
  const std::string path = (folder / "injected.db3").string();
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open(path.c_str(), &database), SQLITE_OK);
  constexpr char kContent[] =
      "CREATE TABLE topics(id TEXT, name TEXT, type TEXT, serialization_format TEXT);"
      "CREATE TABLE messages(id INTEGER, topic_id INTEGER, timestamp INTEGER, data BLOB);"
      "INSERT INTO topics VALUES('0 UNION SELECT ''INJECTED'' --', '/depth', "
      "'sensor_msgs/msg/Image', 'cdr');";
  ASSERT_EQ(sqlite3_exec(database, kContent, nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(database);
  ExpectError<DataError>([&] { ReadRecording(path, 3); }, {"injected.db3", "topic", "id"});
}

TEST(RecordingTest, AzureKinectMkv) {
  ASSERT_TRUE(IsRecording(kMkv));
  const std::vector<RecordedDepth> streams = ReadRecording(kMkv, 5);
  ASSERT_EQ(streams.size(), 1u);
  const RecordedDepth& depth = streams[0];
  EXPECT_EQ(depth.stream, "DEPTH");
  EXPECT_EQ(depth.kind, "azure_kinect_nfov_binned");
  EXPECT_EQ(depth.serial, "000123492812");
  ASSERT_TRUE(depth.depth_scale && depth.intrinsics);
  EXPECT_EQ(*depth.depth_scale, 0.001);
  EXPECT_EQ(depth.intrinsics->width, 320);
  EXPECT_NEAR(depth.intrinsics->fx, 0.4927 * 512, 1e-9);
  EXPECT_NEAR(depth.intrinsics->cx, 0.5078 * 512 - 96.5, 1e-9);
  EXPECT_NEAR(depth.intrinsics->cy, 0.5117 * 512 - 90.5, 1e-9);
  EXPECT_EQ(
      depth.intrinsics->distortion,
      (std::vector<double>{0.92185, 0.5004, 0.0002, -0.0001, 0.02836, 1.25842, 0.75181, 0.14419}));
  ASSERT_EQ(depth.frames.size(), 1u);
  for (int v = 0; v < 288; ++v)
    for (int u = 0; u < 320; ++u)
      ASSERT_EQ(depth.frames[0].values(u, v), static_cast<float>(1000 + 4 * v + u));
}

TEST(RecordingTest, ACaptureNeedsNothingButTheRecording) {
  const TempFolder folder;
  const auto read = [&](const std::string& sensors) {
    WriteFileAtomically(folder / "capture.json",
                        "{\"depth_scale\": 7, \"sensors\": [" + sensors + "]}");
    return ReadCapture(folder / "capture.json");
  };
  const std::string here = std::filesystem::absolute(".").string() + "/";
  const Capture capture = read(R"({"name": "R", "depth": ")" + here + kBag + R"("},)" +
                               R"({"name": "K", "depth": ")" + here + kMkv + R"("})");
  const SensorFrame &r = capture.sensors[0], &k = capture.sensors[1];
  // 10000, 10100 and 10200 steps of 0.1 mm: the mean of those near the median.
  EXPECT_NEAR(r.depth(0, 0), 1.01f, 1e-6);
  EXPECT_EQ(r.depth_scale, 0.0001);
  EXPECT_EQ(r.sensor, "realsense_d415");
  EXPECT_FALSE(r.depth_sigma.empty());
  EXPECT_EQ(k.depth(5, 1), 1.009f);
  EXPECT_EQ(k.serial, "000123492812");
  EXPECT_EQ(k.intrinsics.distortion.size(), 8u);
  // What the capture states itself counts.
  const Capture stated = read(
      R"({"name": "R", "depth": ")" + here + kBag +
      R"(", "frames": 1, "depth_scale": 0.001, "serial": "x", "stream": "/device_0/sensor_0/Depth_0/image/data",
               "intrinsics": {"width": 64, "height": 48, "fx": 50, "fy": 50, "cx": 32, "cy": 24}})");
  EXPECT_EQ(stated.sensors[0].depth(0, 0), 10.0f);
  EXPECT_EQ(stated.sensors[0].serial, "x");
  EXPECT_EQ(stated.sensors[0].intrinsics.fx, 50);
  EXPECT_TRUE(stated.sensors[0].depth_sigma.empty());
  ExpectError<DataError>(
      [&] { read(R"({"name": "R", "stream": "x", "depth": ")" + here + kBag + R"("})"); },
      {"sensor \"R\"", "\"x\"", "Depth_0"});
}

/// Wherever a recording ends or a byte is wrong: an error in one line, or what is left; no crash.
TEST(RecordingTest, DamagedRecordings) {
  const TempFolder folder;
  for (const char* name : {kBag, kMkv}) {
    const std::string whole = ReadFile(name);
    const std::filesystem::path path = folder / "damaged";
    int errors = 0, reads = 0;
    const auto try_reading = [&](const std::string& bytes) {
      WriteFileAtomically(path, bytes, false);
      try {
        reads += ReadRecording(path, 10).empty() ? 0 : 1;
      } catch (const Error& error) {
        EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
        ++errors;
      }
    };
    for (std::size_t i = 0; i < 25; ++i) try_reading(whole.substr(0, whole.size() * i / 25));
    for (std::size_t i = 0; i < 75; ++i) {
      std::string bytes = whole;
      bytes[(i * i * 7 + 13 * i) % std::min<std::size_t>(bytes.size(), 6000)] =
          static_cast<char>(i % 3 == 0   ? 0xff
                            : i % 3 == 1 ? 0
                                         : i * 37);
      try_reading(bytes);
    }
    EXPECT_GT(errors, 15) << name;
    EXPECT_GT(reads, 10) << name;
  }
  WriteFileAtomically(folder / "no.bag", "#ROSBAG V1.2\n");
  ExpectError<DataError>([&] { ReadRecording(folder / "no.bag", 1); }, {"no.bag", "2.0"});
  ExpectError<IoError>([&] { ReadRecording(folder / "none.bag", 1); }, {"none.bag"});
}

}  // namespace
}  // namespace volalign::recording_test
