#include "infer/formats/recording.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/file_util.h"
#include "infer/capture/capture.h"
#include "infer/formats/byte_reader.h"
#include "infer/formats/depth_file.h"
#include "infer/formats/read_budget.h"
#include "infer/formats/ros_depth.h"
#include "infer/formats/unpack.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/core/base/temp_folder.h"

// Recordings that other programs wrote: realsense.bag by librealsense 2.56's recorder from a
// software device, realsense.db3 by that of 2.59, kinect.mkv by ffmpeg and mkvmerge
// (tests/compat/record_depth.py has the values).
namespace volalign::recording_test {
namespace {

using namespace formats_internal;

constexpr char kBag[] = "tests/infer/formats/recordings/realsense.bag";
constexpr char kDb3[] = "tests/infer/formats/recordings/realsense.db3";
constexpr char kMkv[] = "tests/infer/formats/recordings/kinect.mkv";

TEST(KindOfDevice, IsOfTheNameThatADeviceHas) {
  EXPECT_EQ(KindOfDevice("Intel RealSense D435I"), "realsense_d435");
  EXPECT_EQ(KindOfDevice("Intel RealSense D455"), "realsense_d455");
  EXPECT_EQ(KindOfDevice("Orbbec Femto Bolt"), "orbbec_femto_bolt");
  EXPECT_EQ(KindOfDevice("Orbbec Femto Mega I"), "orbbec_femto_mega");
  EXPECT_EQ(KindOfDevice("Orbbec Gemini 335"), "orbbec_gemini_335");
  EXPECT_EQ(KindOfDevice("Orbbec Gemini 335L"), "") << "its baseline is another one";
  EXPECT_EQ(KindOfDevice("ASUS Xtion PRO LIVE"), "asus_xtion");
  EXPECT_EQ(KindOfDevice("PrimeSense Carmine 1.08"), "primesense_carmine");
  EXPECT_EQ(KindOfDevice("PrimeSense PS1080"), "primesense");
  EXPECT_EQ(KindOfDevice("Intel RealSense L515"), "");
}

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
    for (const auto [u, v] : Pixels(64, 48))
      ASSERT_EQ(frame.values(u, v), static_cast<float>(10000 + 100 * i + 64 * v + u));
  }
}

TEST(RecordingTest, RealSenseBag) { ExpectRealSense(kBag); }
TEST(RecordingTest, RealSenseDb3) { ExpectRealSense(kDb3); }

TEST(RecordingTest, DamagedDb3) {
  const TempFolder folder;
  // The images' PNG begins after a header of twelve bytes.
  std::string other = ReadFile(kDb3);
  const std::string png = "\x89PNG";
  for (std::size_t at = 0; (at = other.find(png, at)) != std::string::npos; ++at) other[at] = 'x';
  WriteFileAtomically(folder / "png.db3", other);
  ExpectError<DataError>([&] { ReadRecording(folder / "png.db3", 3); }, {"png.db3"});
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
  for (const auto [u, v] : Pixels(320, 288))
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
  const CaptureFile capture = read(R"({"name": "R", "depth": ")" + here + kBag + R"("},)" +
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
  const CaptureFile stated = read(
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

std::vector<RecordedDepth> ReadMkv(const std::string& bytes) {
  const TempFolder folder;
  return ReadRecording(folder.Write("a.mkv", bytes), 2);
}

TEST(RecordingTest, TextsOfARecordingArePlain) {
  std::string bytes = ReadFile(kMkv);
  const std::string serial = "000123492812";
  bytes.replace(bytes.find(serial), 4, "\x1b[1m");
  EXPECT_EQ(ReadMkv(bytes)[0].serial, "\\x1b[1m23492812");
}

/// Wherever a recording ends: an error in one line, or what it began with. (Of bytes that are
/// wrong: tests/fuzz.)
TEST(RecordingTest, RecordingsThatEndTooEarly) {
  const TempFolder folder;
  for (const char* name : {kBag, kMkv, kDb3}) {
    SCOPED_TRACE(name);
    const std::string whole = ReadFile(name);
    const std::vector<RecordedDepth> all = ReadRecording(name, 10);
    int errors = 0;
    for (std::size_t i = 0; i < 25; ++i) {
      SCOPED_TRACE(i);
      folder.Write("damaged", whole.substr(0, whole.size() * i / 25));
      std::vector<RecordedDepth> left;
      try {
        left = ReadRecording(folder / "damaged", 10);
      } catch (const Error& error) {
        EXPECT_FALSE(Has(error.what(), "\n"));
        ++errors;
      }
      ASSERT_LE(left.size(), all.size());
      for (std::size_t k = 0; k < left.size(); ++k) {
        EXPECT_EQ(left[k].stream, all[k].stream);
        ASSERT_LE(left[k].frames.size(), all[k].frames.size());
        for (std::size_t n = 0; n < left[k].frames.size(); ++n)
          EXPECT_TRUE(left[k].frames[n].values == all[k].frames[n].values) << n;
      }
    }
    EXPECT_GT(errors, 0);
  }
  ExpectError<IoError>([&] { ReadRecording(folder / "none.bag", 1); }, {"none.bag"});
  ExpectError<DataError>([&] { ReadRecording(folder.Write("no.bag", "none"), 1); },
                         {"no.bag", "neither a bag of ROS"});
}

TEST(IsDepth, GoesByTheEncodingAndTheName) {
  EXPECT_TRUE(IsDepth("/a", "16UC1"));
  EXPECT_TRUE(IsDepth("/a", "32FC1"));
  EXPECT_TRUE(IsDepth("/camera/Depth/image", "mono16"));
  EXPECT_FALSE(IsDepth("/camera/infra1/image", "mono16"));
  EXPECT_FALSE(IsDepth("/camera/depth/image", "rgb8"));
  for (const char* other : {"/kinect2/sd/image_ir", "/camera/infra1/image_rect_raw",
                            "/depth_camera/ir/image_raw", "/camera/depth/confidence"})
    EXPECT_FALSE(IsDepth(other, "16UC1")) << other;
  for (const char* depth : {"/camera/aligned_depth_to_color/image_raw", "/depth_to_rgb/image_raw",
                            "/ir_camera/depth/image", "/camera/rgb/image_depth", "/firing/z"})
    EXPECT_TRUE(IsDepth(depth, "16UC1")) << depth;
}

TEST(RealSenseTopics, AreKnownByTheirNames) {
  EXPECT_TRUE(IsDeviceInfo("/device_0/info"));
  EXPECT_FALSE(IsDeviceInfo("/device_0/sensor_0/info"));
  EXPECT_FALSE(IsDeviceInfo("/camera/info"));
  EXPECT_TRUE(IsDepthUnits("/device_0/sensor_0/option/Depth Units/value"));
  EXPECT_TRUE(IsDepthUnits("/device_0/sensor_0/option/Depth_Units/value"));
  EXPECT_FALSE(IsDepthUnits("/device_0/sensor_0/option/Depth Units/description"));
}

TEST(ReadBudget, IsOfAllPartsTogether) {
  ReadBudget budget(100);
  budget.Unpack(60, "a");
  ExpectError<DataError>([&] { budget.Unpack(41, "b"); }, {"b: ", "unpacked"});
  EXPECT_TRUE(budget.Spend(40));
  EXPECT_FALSE(budget.Spend(1));
  // What is kept counts by itself, and may be let go.
  budget.Keep(60, "a");
  ExpectError<DataError>([&] { budget.Keep(41, "c"); }, {"c: ", "memory"});
  budget.Drop(60);
  budget.Keep(100, "a");
  EXPECT_EQ(budget.kept(), 100u);
}

TEST(ReadBudget, AFileAllowsMoreOnce) {
  const TempFolder folder;
  const auto file = folder.Write("a", std::string(100000, 'x'));
  ReadBudget budget(0);
  budget.Open(file);
  EXPECT_TRUE(budget.Spend(100000));
  while (budget.Spend(1 << 16)) {
  }
  budget.Open(file);
  EXPECT_FALSE(budget.Spend(1 << 16));
  budget.Open(folder / "none");
  EXPECT_FALSE(budget.Spend(1 << 16));
}

TEST(ReadBudget, CountsThePixelsOfImages) {
  const TempFolder folder;
  std::string pgm = "P5 1000 500 65535\n";
  pgm.resize(pgm.size() + 1000000);
  const auto file = folder.Write("a.pgm", pgm);
  ReadBudget budget(0);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(BytesOf(ReadStoredDepth(file, &budget)), 2000000u);
  ExpectError<DataError>(
      [&] {
        for (int i = 0; i < 100; ++i) ReadStoredDepth(file, &budget);
      },
      {"a.pgm", "unpacked"});
}

TEST(UnpackZstd, SaysWhatIsDamaged) {
  ReadBudget budget;
  for (const char* packed : {"\x28\xb5\x2f\xfd", "none"})
    ExpectError<DataError>([&] { UnpackZstd(packed, 100, "a", &budget); }, {"a: damaged"});
}

using std::string_view_literals::operator""sv;  // NOLINT(misc-unused-using-decls): it is used

TEST(ByteReader, GivesNothingBeyondTheEnd) {
  const std::string name = "a.mcap";
  for (const std::string_view bytes : {""sv, "\x01\x00\x00"sv,
                                       "\x05\x00\x00\x00"
                                       "abcd"sv,
                                       "\xff\xff\xff\xff"
                                       "a"sv}) {
    ByteReader reader(bytes, name);
    ExpectError<DataError>([&] { reader.Block(); }, {"a.mcap: damaged", "are there"});
  }
  // What was refused is still there.
  ByteReader reader("abc"sv, name);
  ExpectError<DataError>([&] { reader.Take(SIZE_MAX); }, {"3 are there"});
  ExpectError<DataError>([&] { reader.Value<double>(); }, {"8 bytes are announced"});
  EXPECT_EQ(reader.Take(3), "abc");
}

}  // namespace
}  // namespace volalign::recording_test
