// Poses as other programs have them: through every format and back, and against what their own
// conventions say, written out here.

#include "infer/report/pose_format.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <sstream>
#include <string>

#include "core/base/file_util.h"
#include "core/base/random.h"
#include "core/config/config_word.h"
#include "core/geometry/lens.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::pose_format_test {
namespace {

class PosesTest : public ::testing::Test {
 protected:
  PosesTest() {
    RandomStream random(3, 0, "poses");
    const std::vector<std::vector<double>> lenses = {{},
                                                     {0.1, -0.05, 1e-3, 2e-3},
                                                     {0.1, -0.05, 1e-3, 2e-3, 0.01},
                                                     {5, 3, 1e-4, -2e-4, .1, 5.4, 4.5, .8}};
    for (std::size_t i = 0; i < lenses.size(); ++i) {
      SensorPose pose;
      pose.name = "S" + std::to_string(i + 1);
      pose.structure_from_sensor =
          testing_infer::RingPose(random.Uniform(0, 360), random.Uniform(1.5, 3),
                                  random.Uniform(-0.5, 1), random.Uniform(-180, 180));
      pose.intrinsics = Intrinsics{320, 288, 252.5, 251.25, 163.1, 170.2, lenses[i]};
      pose.colour = ColourCamera{ColourFromDepth(), Intrinsics{1280, 720, 605, 604, 637, 366, {}}};
      pose.depth_gain = 1 + 0.001 * static_cast<double>(i);  // none of S1
      pose.depth_offset_m = -0.004 * static_cast<double>(i);
      poses_.push_back(pose);
      colour_[pose.name] = {ColourFromDepth(), std::nullopt};
    }
  }

  /// Of a device, as users print it (github.com/microsoft/Azure-Kinect-Sensor-SDK/issues/1617 has
  /// another): 32 mm to the side, tilted by 5 degrees.
  static Pose ColourFromDepth() {
    Pose pose = Pose::Identity();
    pose.linear() << 0.99999922513961792, 0.0011817576596513391, -0.00044814043212682009,
        -0.0011387512786313891, 0.99628061056137085, 0.0861603245139122, 0.0005482942215166986,
        -0.086159750819206238, 0.9962812066078186;
    pose.linear() = Eigen::Quaterniond(pose.linear()).normalized().toRotationMatrix();
    pose.translation() << -0.0320834, -0.0022054, 0.0038837;
    return pose;
  }

  std::filesystem::path Path(const std::string& name) const { return folder_ / name; }

  static WorldChoice World(const std::string& origin, const std::string& up = "",
                           bool colour = false, std::optional<double> floor_m = {}) {
    WorldChoice world;
    world.origin = origin;
    world.up = up;
    world.colour = colour;
    world.floor_m = floor_m;
    return world;
  }

  /// The poses, written by the format; returns the file.
  std::filesystem::path Written(const std::string& format, const WorldChoice& world = {}) {
    std::filesystem::path path = Path("poses");
    std::filesystem::remove_all(path);
    WritePoses(path, format, poses_, world);
    return path;
  }

  TempFolder folder_;
  std::vector<SensorPose> poses_;
  ColourCameras colour_;
};

void ExpectSamePose(const Pose& a, const Pose& b, const std::string& what) {
  EXPECT_LT((a.matrix() - b.matrix()).cwiseAbs().maxCoeff(), 1e-9) << what;
}

bool HasNoRoomForDepth(const std::string& format) {
  return format == "volumetric_capture" || format == "livescan3d_kinect_v2" ||
         format == "livescan3d_azure" || format == "urdf";
}

// By how much points are off without them, at the structure's distance.
TEST_F(PosesTest, SaysWhatBecomesOfDepthCorrections) {
  const double distance = poses_[2].structure_from_sensor.translation().norm();
  const std::string s3 = fmt::format("S3 {:+.1f}", 2 * distance - 8);
  const auto note_of = [&](const std::string& format, const WorldChoice& world = {}) {
    std::filesystem::remove_all(Path("noted"));
    for (const std::string& note : WritePoses(Path("noted"), format, poses_, world)) {
      if (note.find("corrected depths") != std::string::npos) return note;
    }
    return std::string();
  };
  for (const std::string& format : PoseFormats()) {
    if (format == "volalign") continue;
    const std::string note = note_of(format);
    EXPECT_TRUE(Has(note, s3)) << format;
    EXPECT_FALSE(Has(note, "S1")) << format;
    EXPECT_EQ(bool(Has(note, "have no place in it")), HasNoRoomForDepth(format)) << format << note;
  }
  EXPECT_TRUE(Has(note_of("poses", World("structure", "", true)), "not in the file"));
  for (SensorPose& pose : poses_) pose.depth_gain = 1, pose.depth_offset_m = 0;
  EXPECT_EQ(note_of("tum"), "");
}

TEST_F(PosesTest, ComeBackFromEveryFormat) {
  for (const std::string& format : PoseFormats()) {
    if (format == "volalign" || !IsReadable(format)) continue;
    const std::vector<SensorPose> back = ReadPoses(Written(format), format, colour_);
    ASSERT_EQ(back.size(), poses_.size()) << format;
    const bool with_intrinsics = !HasNoRoomForDepth(format) && format != "open3d_log" &&
                                 format != "ros" && format != "tum" && format != "cwipc";
    for (std::size_t i = 0; i < back.size(); ++i) {
      EXPECT_EQ(back[i].name, poses_[i].name) << format;
      ExpectSamePose(back[i].structure_from_sensor, poses_[i].structure_from_sensor, format);
      if (!HasNoRoomForDepth(format)) {
        EXPECT_EQ(back[i].depth_gain, poses_[i].depth_gain) << format;
        EXPECT_EQ(back[i].depth_offset_m, poses_[i].depth_offset_m) << format;
      }
      ASSERT_EQ(back[i].intrinsics.has_value(), with_intrinsics) << format;
      if (!with_intrinsics) continue;
      Intrinsics expected = *poses_[i].intrinsics;
      if (format == "open3d") expected.distortion.clear();
      // COLMAP's full model has eight coefficients.
      if (format == "colmap" && expected.distortion.size() == 5) expected.distortion.resize(8);
      EXPECT_EQ(back[i].intrinsics->distortion, expected.distortion) << format;
      EXPECT_DOUBLE_EQ(back[i].intrinsics->fx, expected.fx) << format;
      EXPECT_NEAR(back[i].intrinsics->cx, expected.cx, 1e-12) << format;
      EXPECT_EQ(back[i].intrinsics->width, expected.width) << format;
    }
  }
}

Eigen::Vector3d ZUp(const Eigen::Vector3d& p) { return {p.x(), -p.z(), p.y()}; }

/// Formats whose poses are of whatever camera and world they are given.
std::vector<std::string> FreeFormats() {
  std::vector<std::string> formats;
  for (const std::string& format : PoseFormats()) {
    if (IsReadable(format) && format != "volalign" && format != "ros" && format != "unity" &&
        format != "volumetric_capture")
      formats.push_back(format);
  }
  return formats;
}

// A point that every sensor sees at the same place of the new world, in every format: the origin on
// the floor, the origin at a sensor, either axis up.
TEST_F(PosesTest, TheWorldIsChosen) {
  constexpr double kFloor = -0.81;
  const Eigen::Vector3d p(0.3, 0.5, -0.2);  // of the structure frame
  const Eigen::Vector3d eye = poses_[1].structure_from_sensor.translation();
  struct Case {
    std::string origin, up;
    Eigen::Vector3d expected;
  };
  const Case cases[] = {{"structure", "y", p},
                        {"structure", "z", ZUp(p)},
                        {"floor", "", p - Eigen::Vector3d(0, kFloor, 0)},
                        {"floor", "z", ZUp(p - Eigen::Vector3d(0, kFloor, 0))},
                        {"S2", "y", p - eye},
                        {"S2", "z", ZUp(p - eye)},
                        {"S2", "", poses_[1].structure_from_sensor.inverse() * p}};
  for (const std::string& format : FreeFormats()) {
    for (const Case& c : cases) {
      const std::vector<SensorPose> back =
          ReadPoses(Written(format, World(c.origin, c.up, false, kFloor)), format, colour_);
      ASSERT_EQ(back.size(), poses_.size());
      for (std::size_t i = 0; i < back.size(); ++i) {
        const Eigen::Vector3d seen = poses_[i].structure_from_sensor.inverse() * p;
        EXPECT_LT((back[i].structure_from_sensor * seen - c.expected).norm(), 1e-9)
            << format << " " << c.origin << " " << c.up;
      }
      if (c.origin == "S2" && c.up.empty())
        ExpectSamePose(back[1].structure_from_sensor, Pose::Identity(), "the origin");
    }
  }
}

// What is read of a format with a fixed axis up is y up again.
TEST_F(PosesTest, FormatsWithAFixedUpKeepIt) {
  const Eigen::Vector3d p(0.3, 0.5, -0.2), eye = poses_[0].structure_from_sensor.translation();
  for (const std::string format : {"ros", "unity", "volumetric_capture"}) {
    const auto back = ReadPoses(Written(format, World("S1")), format);
    EXPECT_LT((back[2].structure_from_sensor * (poses_[2].structure_from_sensor.inverse() * p) -
               (p - eye))
                  .norm(),
              1e-9);
    EXPECT_THROW(Written(format, World("S1", format == "unity" ? "z" : "y")), ConfigError);
  }
  const std::string text = ReadFile(Written("ros", World("floor", "", false, -0.5)));
  EXPECT_TRUE(Has(text, "frame_id: \"floor\"", "\"S1_depth_optical_frame\""));
  const std::size_t z = text.find("z: ", text.find("translation"));
  EXPECT_NEAR(std::stod(text.substr(z + 3)), eye.y() + 0.5, 1e-12);
}

TEST_F(PosesTest, SaysInTheFileWhichWorldItIs) {
  for (const char* format : {"poses", "open3d", "open3d_log", "opencv", "tum", "csv", "cwipc"}) {
    EXPECT_TRUE(
        Has(ReadFile(Written(format, World("S2"))), "the camera of S2, x right, y down, z forward"))
        << format;
  }
  EXPECT_TRUE(Has(ReadFile(Written("poses", World("S2", "z"))),
                  "z up, right-handed, (x, y, z) of volalign's structure frame is (x, -z, y), "
                  "origin at the camera of S2"));
}

TEST_F(PosesTest, TheWorldMayHaveAName) {
  WorldChoice world;
  world.frame = "robot base";
  for (const char* format : {"ros", "ros_launch", "urdf"})
    EXPECT_TRUE(Has(ReadFile(Written(format, world)), "\"robot base\"")) << format;
}

TEST_F(PosesTest, TheNameOfTheWorldForgesNothing) {
  WorldChoice world;
  world.frame = "x\nimport os";
  EXPECT_THROW(Written("ros_launch", world), Error);
  world.frame = "S1_depth_optical_frame";
  ExpectError<ConfigError>([&] { Written("urdf", world); }, {"that of a sensor"});
  world.frame = "";
  world.world.emplace();
  world.world->name = "a--><x/>";
  EXPECT_FALSE(Has(ReadFile(Written("urdf", world)), "<x/>"));
}

// Without a correction, what it would do is in the pose, as far as a pose can do it.
TEST_F(PosesTest, PosesForRawDepths) {
  WorldChoice world;
  world.raw = true;
  const std::vector<SensorPose> raw = ReadPoses(Written("poses", world), "poses");
  for (std::size_t i = 0; i < raw.size(); ++i) {
    EXPECT_FALSE(raw[i].corrects_depth());
    const Pose& pose = poses_[i].structure_from_sensor;
    const Eigen::Vector3d p = pose.inverse() * Eigen::Vector3d::Zero();
    const Eigen::Vector3d measured =
        p * ((p.z() - poses_[i].depth_offset_m) / poses_[i].depth_gain / p.z());
    EXPECT_LT((raw[i].structure_from_sensor * measured).norm(), 5e-5) << i;
    EXPECT_EQ((pose * measured).norm() > 5e-5, i > 0) << i;
  }
  const std::vector<std::string> notes = WritePoses(Path("noted"), "poses", poses_, world);
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_TRUE(Has(notes[0], "uncorrected depths", "S4 +"));
  EXPECT_FALSE(Has(notes[0], "S1"));
  ExpectError<ConfigError>([&] { Written("depth_correction", world); },
                           {"--poses-for raw", "depth_correction"});
  world.colour = true;
  ExpectError<ConfigError>([&] { Written("poses", world); }, {"--camera colour"});
}

TEST_F(PosesTest, SaysWhatLostIntrinsicsCost) {
  poses_[0].intrinsics_given = poses_[0].intrinsics;
  poses_[1].intrinsics_given = poses_[1].intrinsics;
  poses_[1].intrinsics_given->cx += 3;
  const double depth = (poses_[1].structure_from_sensor.inverse() * Eigen::Vector3d::Zero()).z();
  const std::string note = WritePoses(Path("noted"), "tum", poses_).front();
  EXPECT_TRUE(Has(note, "intrinsics have no place", "S2 +"));
  EXPECT_FALSE(Has(note, "S1"));
  // Points behind the structure are farther off.
  const double off = std::stod(note.substr(note.find("S2 +") + 4));
  EXPECT_GT(off, 1000 * 3 / 252.5 * depth);
  EXPECT_LT(off, 1000 * 3 / 252.5 * (depth + 1.1));
  EXPECT_FALSE(Has(WritePoses(Path("noted"), "csv", poses_).front(), "intrinsics"));
}

TEST_F(PosesTest, SomeFormatsAreOnlyWritten) {
  for (const char* format : {"ros_launch", "urdf", "depth_correction"}) {
    ExpectError<ConfigError>([&] { ReadPoses(Written(format), format); }, {"written and not read"});
  }
}

TEST_F(PosesTest, TheWorldOfTheUser) {
  const Eigen::Vector3d p(0.1, 0.2, 2);
  WorldFrame given;
  given.name = "robot base";
  given.world_from_structure = testing_infer::MakePose({M_PI / 2, 0.3, 0.1}, {1, -2, 3});
  poses_[1].intrinsics_given = poses_[1].intrinsics;
  poses_[1].intrinsics_given->cx += 3;
  const std::vector<std::string> without = WritePoses(Path("noted"), "tum", poses_);
  WorldChoice choice;
  choice.world = given;
  const Eigen::Vector3d expected =
      given.world_from_structure * (poses_[1].structure_from_sensor * p);
  for (const std::string format : {"poses", "ros", "unity"}) {
    Eigen::Vector3d q = ReadPoses(Written(format, choice), format)[1].structure_from_sensor * p;
    if (format == "ros") q = {q.x(), -q.z(), q.y()};  // read as a world with y up
    EXPECT_LT((q - expected).norm(), 1e-9) << format;
  }
  EXPECT_TRUE(Has(ReadFile(Written("ros", choice)), "frame_id: \"robot base\"",
                  "axes and origin of robot base"));
  // What is off at the structure does not depend on where that stands.
  const std::vector<std::string> notes = WritePoses(Path("noted"), "tum", poses_, choice);
  ASSERT_EQ(notes.size(), without.size() + 1);
  for (std::size_t i = 0; i < without.size(); ++i) EXPECT_EQ(notes[i], without[i]);
  EXPECT_TRUE(Has(notes.back(), "in the frame of robot base"));
  choice.origin = "structure";
  EXPECT_FALSE(Has(ReadFile(Written("ros", choice)), "robot base"));
  choice = {};
  choice.origin = "world";
  ExpectError<ConfigError>([&] { Written("poses", choice); }, {"calibrate --world"});
  choice.world = given;
  choice.up = "z";
  ExpectError<ConfigError>([&] { Written("poses", choice); }, {"--up"});
}

TEST_F(PosesTest, OriginsThatAreNotKnown) {
  ExpectError<ConfigError>([&] { Written("tum", World("floor")); }, {"--origin floor"});
  ExpectError<ConfigError>([&] { Written("tum", World("S9")); }, {"--origin S9", "S1, S2, S3, S4"});
}

// The colour camera's pose takes its own points to where the depth camera's are.
TEST_F(PosesTest, OfTheColourCameras) {
  WorldChoice world;
  world.colour = true;
  const Eigen::Vector3d p(0.3, 0.5, -0.2);
  for (const std::string& format : FreeFormats()) {
    if (format == "livescan3d_kinect_v2" || format == "livescan3d_azure") {
      EXPECT_THROW(Written(format, world), ConfigError);
      continue;
    }
    const std::vector<SensorPose> back = ReadPoses(Written(format, world), format);
    for (std::size_t i = 0; i < back.size(); ++i) {
      const Eigen::Vector3d seen =
          ColourFromDepth() * (poses_[i].structure_from_sensor.inverse() * p);
      EXPECT_LT((back[i].structure_from_sensor * seen - p).norm(), 1e-9) << format;
      if (back[i].intrinsics) {
        EXPECT_EQ(back[i].intrinsics->width, 1280);
      }
    }
  }
  world.origin = "S1";
  ExpectSamePose(ReadPoses(Written("poses", world), "poses")[0].structure_from_sensor,
                 Pose::Identity(), "the origin is that camera");
  EXPECT_TRUE(Has(ReadFile(Written("ros", world)), "S2_color_optical_frame"));
  poses_[2].colour.reset();
  ExpectError<ConfigError>([&] { Written("tum", world); }, {"--camera colour", "S3"});
  ExpectError<ConfigError>([&] { Written("livescan3d_azure"); }, {"--colour-camera S3="});
}

// As cwipc has it: cameras by their serial numbers, with `trafo` row by row.
TEST_F(PosesTest, CwipcsCameraConfig) {
  poses_[0].serial = "000123";
  const auto json = nlohmann::json::parse(ReadFile(Written("cwipc")));
  EXPECT_EQ(json["camera"][0]["serial"], "000123");
  EXPECT_EQ(json["camera"][1]["serial"], "S2");
  const Pose& pose = poses_[0].structure_from_sensor;
  EXPECT_EQ(json["camera"][0]["trafo"][0][3], pose.translation().x());
  EXPECT_EQ(json["camera"][0]["trafo"][3], (std::vector<double>{0, 0, 0, 1}));
  const auto file = folder_.Write(
      "cameraconfig.json",
      R"({"version": 3, "type": "realsense", "system": {}, "camera": [{"type": "realsense",
           "serial": "77", "trafo": [[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]]}]})");
  const auto read = ReadPoses(file, "cwipc");
  EXPECT_EQ(read.at(0).name, "77");
  EXPECT_EQ(read[0].structure_from_sensor.translation(), Eigen::Vector3d(0.5, 0, 2));
}

// A name of several lines would be read as a pose, and one with an escape sequence changes a
// terminal.
TEST_F(PosesTest, RefuseNamesThatForge) {
  const std::string plain = poses_[0].name;
  for (const std::string& format : PoseFormats()) {
    if (format == "volalign") continue;
    for (const char* name : {"A\n0 9 9 9 0 0 0 1\n#", "A\x1b[31mRED", "\xff\xfe"}) {
      poses_[0].name = name;
      ExpectError<DataError>([&, f = format] { WritePoses(Path("forged"), f, poses_); },
                             {"the name"});
    }
    poses_[0].name = poses_[1].name;
    ExpectError<DataError>([&, f = format] { WritePoses(Path("twice"), f, poses_); },
                           {"two poses are named"});
    poses_[0].name = plain;
  }
  poses_[0].name = "FORGED";
  const auto expect_refused = [&](const std::string& format, const std::string& name) {
    const std::filesystem::path file = Written(format);
    std::string text = ReadFile(file);
    for (std::size_t at; (at = text.find("FORGED")) != std::string::npos;)
      text.replace(at, 6, name);
    WriteFileAtomically(file, text);
    EXPECT_THROW(ReadPoses(file, format, colour_), DataError) << format;
  };
  for (const char* format : {"poses", "open3d", "unity"})
    expect_refused(format, "A\\n0 9 9 9 0 0 0 1\\n#");
  for (const char* format : {"tum", "open3d_log", "csv", "opencv", "ros"})
    expect_refused(format, "A\x1b[31mRED");
}

// A spreadsheet shows such a name, and does not calculate with it.
TEST_F(PosesTest, NamesInACsvAreNoFormulas) {
  poses_[0].name = "=1+1";
  poses_[1].name = "-30";
  poses_[2].name = "'=1";
  const std::filesystem::path file = Written("csv");
  EXPECT_TRUE(Has(ReadFile(file), "\n\"'=1+1\","));
  const std::vector<SensorPose> back = ReadPoses(file, "csv");
  for (std::size_t i = 0; i < back.size(); ++i) EXPECT_EQ(back[i].name, poses_[i].name);
}

TEST_F(PosesTest, SayWhatAFormatHasNoPlaceFor) {
  EXPECT_EQ(WritePoses(Path("a"), "tum", poses_).size(), 2u);
  EXPECT_EQ(WritePoses(Path("a"), "open3d", poses_).size(), 2u);
  // What becomes of the depth corrections is said of every format.
  EXPECT_EQ(WritePoses(Path("a"), "opencv", poses_).size(), 1u);
  const auto refused = [&](std::initializer_list<const char*> formats) {
    for (const char* format : formats)
      EXPECT_THROW(WritePoses(Path("a"), format, poses_), ConfigError) << format;
  };
  refused({"volalign"});
  poses_[1].intrinsics.reset();
  refused({"open3d", "colmap"});
  poses_[1].name = "../S2";
  refused({"volumetric_capture", "livescan3d_kinect_v2"});
  EXPECT_THROW(IsReadable("kinect"), ConfigError);
}

// A file that VolumetricCapture's users show (github.com/VCL3D/VolumetricCapture/issues/20): rows
// of the rotation, then the position in mm, z up. The sensor looks at the stack and lies on its
// side: +x of its picture points to the floor.
TEST_F(PosesTest, VolumetricCapturesOwnFile) {
  std::filesystem::create_directories(Path("volcap"));
  std::ofstream(Path("volcap") / "d4150.extrinsics") << "0.0124787 -0.999791 0.016157\n"
                                                        "-0.23122 0.0128353 0.972817\n"
                                                        "-0.972821 -0.0158753 -0.231011\n"
                                                        "-71.0407 -1803.81 494.83\n";
  const std::vector<SensorPose> poses = ReadPoses(Path("volcap"), "volumetric_capture");
  ASSERT_EQ(poses.size(), 1u);
  EXPECT_EQ(poses[0].name, "d4150");
  const Pose& pose = poses[0].structure_from_sensor;
  EXPECT_LT((pose.translation() - Eigen::Vector3d(-0.0710407, 0.49483, 1.80381)).norm(), 1e-6);
  const Eigen::Vector3d to_stack = -pose.translation().normalized();
  EXPECT_GT(pose.linear().col(2).dot(to_stack), 0.99);
  EXPECT_LT(pose.linear()(1, 0), -0.95);
}

// As LiveScan3D's SaveCalibration writes it, T and R without blanks. Its StoreFrame takes a point p
// of the camera to R (p + T): a Kinect v2's, whose camera space has x to the left and y up, or an
// Azure Kinect's, whose points its SDK gives in the frame of the colour camera.
TEST_F(PosesTest, LivescansOwnFile) {
  std::filesystem::create_directories(Path("livescan"));
  const auto write = [&](const std::string& text) {
    std::ofstream(Path("livescan") / "calibration_0001") << text;
  };
  write("0.1 -0.2 -1.5 \n0.8-0.6-0\n0.60.80\n001\n3\n1\n");
  const auto read = [&](const char* format = "livescan3d_kinect_v2") {
    return ReadPoses(Path("livescan"), format, {{"0001", {ColourFromDepth(), std::nullopt}}}).at(0);
  };
  EXPECT_THROW(read(), DataError);  // "001" ends one number too early, for LiveScan3D as well
  write(
      "0.1 -0.2 -1.5 "
      "\n0.9999970.002-0.001\n-0.0019990.9999980.000998\n0.001002-0.0009960.999999\n3\n1\n");
  EXPECT_EQ(read().name, "0001");
  Eigen::Matrix3d r;
  r << 0.999997, 0.002, -0.001, -0.001999, 0.999998, 0.000998, 0.001002, -0.000996, 0.999999;
  const Eigen::Vector3d p(0.3, 0.5, 1.8), world = r * (p + Eigen::Vector3d(0.1, -0.2, -1.5));
  const Eigen::Vector3d kinect =
      read().structure_from_sensor * Eigen::Vector3d(-p.x(), -p.y(), p.z());
  EXPECT_LT((kinect - world).norm(), 1e-5);
  const Eigen::Vector3d azure =
      read("livescan3d_azure").structure_from_sensor * (ColourFromDepth().inverse() * p);
  EXPECT_LT((azure - world).norm(), 1e-5);
  write("0.1 -0.2 -1.5\n1 0 0\n0 1 0\n0 0 1\n3\n0\n");
  EXPECT_THROW(read(), DataError);  // not calibrated
  std::string later;
  for (int i = 0; i < 34; ++i) later += i % 5 == 0 ? "1 " : "0 ";
  write(later);
  EXPECT_THROW(read(), DataError);
}

// Read by OpenCV itself; a point is projected as its documentation says.
TEST_F(PosesTest, OpencvReadsAndProjects) {
  cv::FileStorage file(Written("opencv").string(),
                       cv::FileStorage::READ | cv::FileStorage::FORMAT_YAML);
  ASSERT_TRUE(file.isOpened());
  std::size_t i = 0;
  for (const cv::FileNode& node : file["sensors"]) {
    EXPECT_EQ(static_cast<std::string>(node["name"]), poses_[i].name);
    cv::Mat r, t, k;
    node["R"] >> r;
    node["t"] >> t;
    node["camera_matrix"] >> k;
    ASSERT_EQ(r.type(), CV_64F);
    const Eigen::Vector3d world(0.1, 0.2, -0.1);
    const Eigen::Vector3d ours = poses_[i].structure_from_sensor.inverse() * world;
    const cv::Mat theirs = r * (cv::Mat_<double>(3, 1) << world.x(), world.y(), world.z()) + t;
    for (int a = 0; a < 3; ++a) EXPECT_NEAR(theirs.at<double>(a), ours[a], 1e-12);
    EXPECT_EQ(k.at<double>(0, 2), poses_[i].intrinsics->cx);
    if (!poses_[i].intrinsics->distortion.empty()) {
      cv::Mat lens;
      node["distortion_coefficients"] >> lens;
      EXPECT_EQ(lens.total(), poses_[i].intrinsics->distortion.size());
      EXPECT_EQ(lens.at<double>(1), poses_[i].intrinsics->distortion[1]);
    }
    ++i;
  }
  EXPECT_EQ(i, poses_.size());
}

// What a sensor sees ahead, at the top of its picture and on its right is there in Unity, too, for
// a transform that looks along +z with +y up and +x right.
TEST_F(PosesTest, UnityLooksAtTheSameThings) {
  const nlohmann::json file = nlohmann::json::parse(ReadFile(Written("unity")));
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    const nlohmann::json& sensor = file["sensors"][i];
    const Eigen::Vector3d position(sensor["position"]["x"], sensor["position"]["y"],
                                   sensor["position"]["z"]);
    // q v q* is the algebra's, whatever the handedness of the axes.
    const nlohmann::json& q = sensor["rotation"];
    const Eigen::Quaterniond rotation(q["w"], q["x"], q["y"], q["z"]);
    EXPECT_GE(rotation.w(), 0) << "of two quaternions, that one";
    const auto in_unity = [](const Eigen::Vector3d& p) {
      return Eigen::Vector3d(-p.x(), p.y(), p.z());
    };
    const std::pair<Eigen::Vector3d, Eigen::Vector3d> points[] = {
        {{0, 0, 2}, {0, 0, 2}}, {{0, -1, 0}, {0, 1, 0}}, {{1, 0, 0}, {1, 0, 0}}};
    for (const auto& [sensor_point, unity_point] : points) {
      const Eigen::Vector3d expected = in_unity(poses_[i].structure_from_sensor * sensor_point);
      EXPECT_LT((position + rotation * unity_point - expected).norm(), 1e-9);
    }
  }
}

// COLMAP's full model is ours, with pixel centres at .5.
TEST_F(PosesTest, ColmapsPixelsAreHalfAPixelOn) {
  std::istringstream cameras(ReadFile(Written("colmap") / "cameras.txt"));
  std::string line;
  std::size_t i = 0;
  while (std::getline(cameras, line)) {
    if (line[0] == '#') continue;
    std::istringstream words(line);
    std::string id, model;
    Intrinsics theirs;
    words >> id >> model >> theirs.width >> theirs.height >> theirs.fx >> theirs.fy >> theirs.cx >>
        theirs.cy;
    for (double k; words >> k;) theirs.distortion.push_back(k);
    EXPECT_EQ(model, i == 0 ? "PINHOLE" : i == 1 ? "OPENCV" : "FULL_OPENCV");
    const Eigen::Vector2d ray(0.2, -0.15), ours = ProjectRay(*poses_[i].intrinsics, ray);
    EXPECT_LT((ProjectRay(theirs, ray) - ours - Eigen::Vector2d(0.5, 0.5)).norm(), 1e-9);
    ++i;
  }
  EXPECT_EQ(i, poses_.size());
}

TEST_F(PosesTest, PicturesHaveAWholeNumberOfPixels) {
  for (const std::string width : {"640.5", "1e300", "-1e300", "0"}) {
    const std::filesystem::path colmap = Written("colmap");
    std::string cameras = ReadFile(colmap / "cameras.txt");
    const std::string size = fmt::format(" {} ", poses_[0].intrinsics->width);
    cameras.replace(cameras.find(size, cameras.find('\n')), size.size(), " " + width + " ");
    std::ofstream(colmap / "cameras.txt") << cameras;
    ExpectError<DataError>([&] { ReadPoses(colmap, "colmap"); },
                           {"camera 1", "is no number of pixels"});
    std::string csv = ReadFile(Written("csv"));
    const std::string field = fmt::format(",{},", poses_[0].intrinsics->width);
    csv.replace(csv.find(field, csv.find('\n')), field.size(), "," + width + ",");
    std::ofstream(Path("sized.csv")) << csv;
    ExpectError<DataError>([&] { ReadPoses(Path("sized.csv"), "csv"); },
                           {"line", "is no number of pixels"});
  }
}

TEST_F(PosesTest, BrokenFilesAreNamed) {
  const std::pair<const char*, const char*> broken[] = {
      {"tum", "0 1 2 3 0 0 0\n"},
      {"tum", "0 1 2 3 0 0 0 2\n"},
      {"tum", "0 1 2 nan 0 0 0 1\n"},
      {"tum", ""},
      {"open3d_log", "0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n"},
      {"open3d_log", "0 0 1\n1 0 0 0\n0 1 0 0\n0 0 -1 0\n0 0 0 1\n"},
      {"open3d_log", "0 0 1\n1.01 0 0 0\n0 1.01 0 0\n0 0 1.01 0\n0 0 0 1\n"},
      {"open3d", "{\"class_name\": \"PinholeCameraParameters\"}"},
      {"csv", "a,b\n"},
      {"opencv", "sensors: []\n"},
      {"opencv", "%YAML:1.0\n---\nsensors:\n  - {name: a, R: 3}\n"},
      {"ros", "- {child_frame_id: a, header: {frame_id: map}}\n"},
      {"ros", "- {child_frame_id: a\n"},
      {"unity", "{\"sensors\": [{\"name\": \"a\"}]}"},
      {"poses", "{\"format\": \"x\"}"}};
  for (const auto& [format, text] : broken) {
    std::ofstream(Path("broken")) << text;
    SCOPED_TRACE(text);
    ExpectError<DataError>([&, f = format] { ReadPoses(Path("broken"), f); }, {"broken"});
  }
  EXPECT_THROW(ReadPoses(Path("none"), "colmap"), IoError);
  EXPECT_THROW(ReadPoses(Path("none"), "tum"), IoError);
}

}  // namespace
}  // namespace volalign::pose_format_test
