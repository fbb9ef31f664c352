#include "infer/report/export.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "core/base/file_util.h"
#include "core/base/folder.h"
#include "core/base/provenance.h"
#include "core/formats/image_io.h"
#include "core/plot/picture_text.h"
#include "infer/calib/calibrate.h"
#include "infer/report/clouds.h"
#include "infer/report/extrinsics.h"
#include "infer/report/report.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/formats/read_png.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::export_test {
namespace {

using namespace testing_infer;

/// What a report.html shows.
nlohmann::ordered_json PayloadOf(const std::string& page) {
  const std::string begin = "id=\"payload\">";
  const std::size_t at = page.find(begin) + begin.size();
  return nlohmann::ordered_json::parse(page.substr(at, page.find("</script>", at) - at));
}

/// Two sensors that are placed and one that is not, calibrated and written.
struct Written {
  Written() {
    rig.Add("left", RingPose(30));
    rig.Add("right", RingPose(75));
    rig.Add("blind", RingPose(200));
    std::fill(rig.frames[2].depth.begin(), rig.frames[2].depth.end(), 0.0f);
    rig.frames[0].depth_files = {"left.pgm"};
    rig.frames[1].depth_files = {"right_0.pgm", "right_1.pgm"};
    rig.frames[1].serial = "0815";
    rig.frames[1].renderer = "tiles";
    rig.frames[1].ground_truth.reset();
    StoredSegmenter segmenter = rig.PerfectSegmenter();
    result = Calibrate(rig.frames, rig.structure, segmenter);
    result.sensors[1].together = RingPose(76);
    WriteCalibration(ResultFolder(folder.path()), With(source), report_run);
  }

  Calibration With(const ExtrinsicsSource& of) const {
    return {{{"", rig.frames}}, rig.structure, result, of, "threads: 2\n"};
  }

  Rig rig{PaperStructure(), {}, {}};
  ExtrinsicsSource source{
      {"capture.json"}, "model.safetensors", std::string(64, 'a'), "runtime 1.0", UtcNow(), ""};
  ReportRun report_run{"volalign calibrate --capture capture.json", "threads: 2\n"};
  CalibrationResult result;
  TempFolder folder;
};

class ExportTest : public ::testing::Test {
 protected:
  static const Written& Once() {
    static const Written once;
    return once;
  }

  /// The result, written to another file of the folder and read.
  Extrinsics Reread(const CalibrationResult& result) {
    WriteExtrinsics(folder_ / "other.json",
                    MakeExtrinsics(result, {{"", rig_.frames}}, rig_.structure, {}));
    return ReadExtrinsics(folder_ / "other.json");
  }
  /// What it wrote, or another file of the folder.
  nlohmann::json Json(const std::string& name = "other.json") {
    return nlohmann::json::parse(ReadFile(folder_ / name));
  }

  const Rig& rig_ = Once().rig;
  const CalibrationResult& result_ = Once().result;
  const TempFolder& folder_ = Once().folder;
};

const Extrinsics::Sensor& Named(const std::string& name, const Extrinsics& of) {
  return *std::find_if(of.sensors.begin(), of.sensors.end(),
                       [&](const Extrinsics::Sensor& sensor) { return sensor.name == name; });
}

TEST_F(ExportTest, ExtrinsicsReadBack) {
  const Extrinsics read = ReadExtrinsics(folder_ / "extrinsics.json");
  EXPECT_EQ(read.verdict, SensorStatus::kFailed);
  EXPECT_EQ(read.captures, std::vector<std::string>{"capture.json"});
  ASSERT_TRUE(read.model.has_value());
  EXPECT_EQ(read.model->file, "model.safetensors");
  EXPECT_EQ(read.model->sha256, std::string(64, 'a'));
  EXPECT_EQ(read.structure.name, rig_.structure.name());
  EXPECT_EQ(read.structure.sha256, rig_.structure.Hash());
  EXPECT_EQ(read.model->runtime, "runtime 1.0");
  EXPECT_EQ(read.tool, Tool());
  EXPECT_EQ(read.date, UtcNow());
  EXPECT_TRUE(Has(read.libraries, "Ceres "));
  ASSERT_EQ(read.sensors.size(), 3u);
  for (const Extrinsics::Sensor& sensor : read.sensors) {
    const std::size_t i = sensor.name == "left" ? 0 : sensor.name == "right" ? 1 : 2;
    const FrameResult& from = result_.sensors[i];
    const SensorFrame& frame = rig_.frames[i];
    EXPECT_EQ(sensor.name, from.name);
    EXPECT_EQ(sensor.status, from.status);
    EXPECT_EQ(sensor.code, from.code);
    EXPECT_EQ(sensor.intrinsics, frame.intrinsics);
    EXPECT_EQ(sensor.depth_files, frame.depth_files);
    EXPECT_EQ(sensor.depth_scale, frame.depth_scale);
    EXPECT_EQ(sensor.quarter_turns, from.quarter_turns);
    EXPECT_EQ(sensor.reason, from.reason);
    EXPECT_EQ(sensor.hint, from.hint);
    EXPECT_EQ(sensor.serial, frame.serial);
    EXPECT_EQ(sensor.renderer, frame.renderer);
    ASSERT_EQ(sensor.structure_from_sensor.has_value(), from.structure_from_sensor.has_value());
    EXPECT_EQ(sensor.error.has_value(), sensor.name == "left");
    if (!sensor.structure_from_sensor) continue;
    EXPECT_TRUE(sensor.structure_from_sensor->isApprox(*from.structure_from_sensor, 1e-12));
    EXPECT_TRUE(sensor.initial.isApprox(from.initial, 1e-12));
    ASSERT_EQ(sensor.together.has_value(), sensor.name == "right");
    if (sensor.together) {
      EXPECT_TRUE(sensor.together->isApprox(RingPose(76), 1e-12));
    }
    EXPECT_TRUE(sensor.covariance.isApprox(from.covariance, 1e-12));
    EXPECT_EQ(sensor.sides, from.sides);
    EXPECT_DOUBLE_EQ(sensor.rms_to_structure_m, from.rms_to_structure_m);
    EXPECT_DOUBLE_EQ(sensor.depth_offset_m, from.depth_offset_m);
    EXPECT_DOUBLE_EQ(sensor.depth_gain, from.depth_gain);
    EXPECT_DOUBLE_EQ(sensor.sigma_depth_gain, from.sigma_depth_gain);
    EXPECT_EQ(sensor.points, from.points);
  }
  ASSERT_EQ(read.placements.size(), 1u);
  EXPECT_EQ(read.placements[0].capture, "capture.json");
  EXPECT_TRUE(read.placements[0].first_from_placement.isApprox(Pose::Identity()));
  EXPECT_EQ(read.placements[0].sensors, (std::vector<std::string>{"left", "right"}));
  ASSERT_EQ(read.pairs.size(), 1u);
  EXPECT_DOUBLE_EQ(read.pairs[0].rms_m, result_.pairs[0].rms_m);
  EXPECT_DOUBLE_EQ(read.metrics->d2, result_.metrics->d2);
  EXPECT_EQ(read.timings_s.size(), result_.timings_s.size());
  ASSERT_TRUE(read.assembly.has_value());
  EXPECT_EQ(read.assembly->arrangement.code, SensorCode::kNone);
  EXPECT_DOUBLE_EQ(read.assembly->share, result_.assembly->share);
}

TEST_F(ExportTest, EstimatesAreReadBackAndReported) {
  CalibrationResult result = result_;
  FrameResult& left = result.sensors[0];
  left.depth_gain = 1.004;
  left.depth_offset_m = -0.003;
  left.covariance(2, 2) = 0.25 * 0.25;
  for (RefinedBox& box : result.boxes) box = {};
  result.boxes[1] = {true, 0.004, -0.002, 0.01, 1e-3, 2e-3, 3e-3};
  const Pose moved(Eigen::Translation3d(0.004, 0, -0.002));
  std::vector<Pose> offsets(result.boxes.size(), Pose::Identity());
  offsets[1] = moved;
  result.built = rig_.structure.Displaced(offsets);
  result.size_estimated = true;
  result.size_scale = 0.99;
  result.sigma_size_scale = 0.002;
  const Extrinsics read = Reread(result);
  ASSERT_EQ(read.boxes.size(), rig_.structure.boxes().size());
  EXPECT_TRUE(read.boxes[1].estimated);
  EXPECT_EQ(read.boxes[1].name, rig_.structure.boxes()[1].name);
  EXPECT_TRUE(read.boxes[1].translation_m.isApprox(moved.translation(), 1e-9));
  EXPECT_DOUBLE_EQ(read.boxes[1].yaw_deg, 0.01 * 180 / M_PI);
  EXPECT_DOUBLE_EQ(read.boxes[1].sigma_z_m, 2e-3);
  EXPECT_FALSE(read.boxes[0].estimated);
  EXPECT_TRUE(read.size.estimated);
  EXPECT_DOUBLE_EQ(read.size.scale, 0.99);
  EXPECT_DOUBLE_EQ(Named("left", read).depth_gain, 1.004);
  EXPECT_DOUBLE_EQ(Named("left", read).depth_offset_m, -0.003);
  EXPECT_EQ(Json()["sensors"]["left"]["unconstrained"],
            nlohmann::json({"along structure z (0.25 m)"}));
  const std::string report = FormatReport(result);
  EXPECT_TRUE(Has(report, "box mid_bottom stands +4.0 mm along x, -2.0 mm along z",
                  "boxes are 99.00 % of their nominal size",
                  "left is hardly constrained along structure z (0.25 m)"));
}

// A turn about the vertical through the structure's origin, known to 10 mrad, moves a sensor across
// its distance from that axis.
TEST_F(ExportTest, SigmaIsOfTheSensorsPosition) {
  CalibrationResult result = result_;
  FrameResult& left = result.sensors[0];
  left.covariance.setZero();
  left.covariance(4, 4) = 1e-4;
  Reread(result);
  nlohmann::json json = Json();
  const Eigen::Vector3d p = left.structure_from_sensor->translation();
  nlohmann::json& sensor = json["sensors"]["left"];
  const std::vector<double> sigma = sensor["sigma_position_m"];
  EXPECT_NEAR(sigma[0], 0.01 * std::abs(p.z()), 1e-9);
  EXPECT_NEAR(sigma[1], 0, 1e-9);
  EXPECT_NEAR(sigma[2], 0.01 * std::abs(p.x()), 1e-9);
  // The terminal has the direction in which it is known least, as the report and the limits do.
  EXPECT_TRUE(Has(FormatReport(result), fmt::format(" {:.2f} ", 10 * std::hypot(p.x(), p.z()))));
  // Earlier files have another key.
  sensor.erase("sigma_position_m");
  sensor["sigma_translation_m"] = {0.0, 0.0, 0.0};
  EXPECT_EQ(ReadExtrinsics(folder_.Write("old.json", json.dump())).sensors.size(), 3u);
}

TEST_F(ExportTest, FilesFromBeforeEstimatesAreRead) {
  nlohmann::json json = Json("extrinsics.json");
  json.erase("boxes");
  json.erase("size");
  for (auto& sensor : json["sensors"]) {
    for (const char* key : {"depth_gain", "sigma_depth_offset_m", "sigma_depth_gain"})
      sensor.erase(key);
  }
  const Extrinsics read = ReadExtrinsics(folder_.Write("old.json", json.dump()));
  EXPECT_TRUE(read.boxes.empty());
  EXPECT_EQ(read.size.scale, 1);
  EXPECT_EQ(read.sensors[0].depth_gain, 1);
}

TEST_F(ExportTest, AnAlteredStackIsReadBackAndReported) {
  CalibrationResult result = result_;
  Arrangement& found = result.assembly->arrangement;
  found.code = SensorCode::kAssemblyTurned;
  found.sentence = "box top is turned by 90 deg";
  found.box = "top";
  found.turn_deg = 90;
  result.assembly->share = 0.98;
  result.assembly->described_share = 0.8;
  const Extrinsics read = Reread(result);
  ASSERT_TRUE(read.assembly.has_value());
  EXPECT_EQ(read.assembly->arrangement.code, SensorCode::kAssemblyTurned);
  EXPECT_EQ(read.assembly->arrangement.box, "top");
  EXPECT_EQ(read.assembly->arrangement.other_box, "");
  EXPECT_EQ(read.assembly->arrangement.turn_deg, 90);
  EXPECT_DOUBLE_EQ(read.assembly->share, 0.98);
  EXPECT_DOUBLE_EQ(read.assembly->described_share, 0.8);
  EXPECT_TRUE(Has(FormatReport(result), "verdict: failed: box top is turned by 90 deg"));
}

TEST_F(ExportTest, TheReportHasFiguresOfSensorsAndPairs) {
  const std::string report = FormatReport(result_);
  EXPECT_TRUE(Has(report, "no_depth", "inliers: share of labelled", "2 of 3 sensors placed",
                  "verdict: failed", "d1"));
  CalibrationResult three = result_;
  three.pairs = {{"left", "right", 0.5, 0.004, 0.005, Matrix6d::Identity(), 0.006, 0.1},
                 {"left", "back", 0.4, 0.003, 0.009, Matrix6d::Identity(), 0.007, 0.1},
                 {"right", "back"}};
  const std::string more = FormatReport(three);
  EXPECT_TRUE(
      Has(more,
          "2 of 3 pairs of sensors overlap: their points are at most 4.0 mm RMS apart "
          "(5.0 predicted). The uncertainty of their places relative to each other is 7.0 mm "
          "(one standard deviation) or less\n"));
}

TEST_F(ExportTest, TheFileSaysItsConventionAndKeepsIt) {
  // Read with a JSON library alone: row-major, structure from sensor, as docs/formats.md words it.
  const nlohmann::json json = Json("extrinsics.json");
  EXPECT_EQ(json["format"], "volalign.extrinsics/1");
  EXPECT_EQ(json["convention"],
            "structure_from_sensor, metres, row-major, sensor: x right y down z forward, "
            "structure: y up");
  const auto& rows = json["sensors"]["left"]["structure_from_sensor"];
  const Pose truth = RingPose(30);
  for (std::size_t i = 0; i < 3; ++i) {
    // The sensor's own position is the last column.
    EXPECT_NEAR(rows[i][3].get<double>(), truth.translation()[static_cast<Eigen::Index>(i)], 2e-3);
    for (std::size_t j = 0; j < 3; ++j)
      EXPECT_NEAR(rows[i][j].get<double>(),
                  truth(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)), 2e-3);
  }
  EXPECT_EQ(rows[3], nlohmann::json({0.0, 0.0, 0.0, 1.0}));
  const SolveReport& solve = result_.solve;
  EXPECT_GT(solve.rounds, 0);
  EXPECT_EQ(json["solution"]["rounds"], solve.rounds);
  EXPECT_EQ(json["solution"]["settled"], solve.settled);
  EXPECT_EQ(json["solution"]["moved_m"], solve.moved_m);
  EXPECT_TRUE(Has(FormatReport(result_), fmt::format("settled after {} round", solve.rounds)));
  const auto& blind = json["sensors"]["blind"];
  EXPECT_EQ(blind["code"], "no_depth");
  EXPECT_FALSE(blind.contains("structure_from_sensor"));
  EXPECT_FALSE(Has(json.dump(), "null"));
  EXPECT_TRUE(json["sensors"]["left"]["depth"].is_string());
  EXPECT_TRUE(json["sensors"]["right"]["depth"].is_array());
}

TEST_F(ExportTest, ReadingIsStrict) {
  const std::string text = ReadFile(folder_ / "extrinsics.json");
  for (const auto& [from, to] :
       {std::pair("volalign.extrinsics/1", "volalign.extrinsics/2"),
        std::pair("\"verdict\"", "\"verdikt\""), std::pair("row-major", "column-major"),
        std::pair("\"status\": \"failed\"", "\"status\": \"ok\"")}) {
    ASSERT_TRUE(Has(text, from));
    std::string changed = text;
    changed.replace(changed.find(from), std::strlen(from), to);
    folder_.Write("changed.json", changed);
    ExpectError<DataError>([&] { ReadExtrinsics(folder_ / "changed.json"); }, {"changed.json"});
  }
}

// Numbers that no solver should leave: the others' poses are written all the same.
TEST_F(ExportTest, ANumberThatIsNotFiniteTakesNoPoseWithIt) {
  CalibrationResult result = result_;
  FrameResult& left = result.sensors[0];
  ASSERT_EQ(left.name, "left");
  left.status = SensorStatus::kOk;
  left.code = SensorCode::kNone;
  left.covariance.setConstant(std::nan(""));
  left.rms_to_structure_m = std::numeric_limits<double>::infinity();
  result.pairs[0].rms_m = std::nan("");
  result.metrics->d2 = std::nan("");
  result.sigma_size_scale = std::nan("");
  Extrinsics read = Reread(result);
  for (const FrameResult& placed : {left, result.sensors[1]})
    EXPECT_TRUE(Named(placed.name, read)
                    .structure_from_sensor->isApprox(*placed.structure_from_sensor, 1e-12));
  EXPECT_EQ(Named("right", read).status, result.sensors[1].status);
  const Extrinsics::Sensor weak = Named("left", read);
  EXPECT_EQ(weak.status, SensorStatus::kWeak);
  EXPECT_EQ(weak.code, SensorCode::kNotFinite);
  EXPECT_EQ(weak.reason,
            "not finite, and left out: rms_to_structure_m, covariance, sigma_position_m, "
            "sigma_rotation_deg");
  EXPECT_TRUE(std::isnan(weak.rms_to_structure_m));
  EXPECT_TRUE(weak.covariance.array().isNaN().all());
  EXPECT_EQ(weak.inlier_share, left.inlier_share);
  const nlohmann::json json = Json();
  EXPECT_FALSE(json["sensors"]["left"].contains("covariance"));
  EXPECT_FALSE(json["pairs"][0].contains("rms_m"));
  EXPECT_FALSE(json["size"].contains("sigma"));
  EXPECT_EQ(json["metrics"].size(), 1u);
  // A cause that is known already stays the code.
  left.status = SensorStatus::kWeak;
  left.code = SensorCode::kDuplicateDepth;
  left.reason = "right has the same depth map";
  read = Reread(result);
  EXPECT_EQ(Named("left", read).code, SensorCode::kDuplicateDepth);
  EXPECT_EQ(Named("left", read).reason.rfind("right has the same depth map; not finite", 0), 0u);
  // But that it is uncertain follows from the numbers.
  left.code = SensorCode::kUncertain;
  EXPECT_EQ(Named("left", Reread(result)).code, SensorCode::kNotFinite);
  // Without a pose there is nothing to report.
  left.structure_from_sensor->translation().x() = std::nan("");
  read = Reread(result);
  EXPECT_EQ(Named("left", read).status, SensorStatus::kFailed);
  EXPECT_EQ(Named("left", read).code, SensorCode::kNotFinite);
  EXPECT_FALSE(Named("left", read).structure_from_sensor.has_value());
  EXPECT_TRUE(Named("right", read).structure_from_sensor.has_value());
}

TEST_F(ExportTest, ImagesHoldLabelsAndConfidences) {
  for (std::size_t i = 0; i < 3; ++i) {
    const FrameResult& sensor = result_.sensors[i];
    EXPECT_EQ(ReadPng8(folder_.path() / "labels" / (sensor.name + ".png")),
              sensor.segmentation.labels);
    const LabelImage confidence = ReadPng8(folder_.path() / "confidence" / (sensor.name + ".png"));
    ASSERT_EQ(confidence.size(), sensor.segmentation.confidence.size());
    for (std::size_t p = 0; p < confidence.size(); p += 97)
      EXPECT_NEAR(confidence[p] / 255.0, sensor.segmentation.confidence[p], 0.5 / 255 + 1e-6);
    // Four panels, or two without a pose, of the portrait image, and lines of text around them.
    const RgbImage picture =
        DecodePngRgb(ReadFile(folder_.path() / "pictures" / (sensor.name + ".png")));
    EXPECT_GE(picture.width(), (sensor.structure_from_sensor ? 4 : 2) * 288);
    EXPECT_GE(picture.height(), 320 + 4 * kTextHeight);
  }
  EXPECT_GT(DecodePngRgb(ReadFile(folder_.path() / "pictures" / "overview.png")).height(), 3 * 320);
}

TEST_F(ExportTest, ReportShowsWhatTheFilesHave) {
  using nlohmann::ordered_json;
  const ordered_json report = PayloadOf(ReadFile(folder_ / "report.html"));
  EXPECT_EQ(report["extrinsics"], ordered_json::parse(ReadFile(folder_ / "extrinsics.json")));
  EXPECT_EQ(report["command"], "volalign calibrate --capture capture.json");
  EXPECT_EQ(report["options"], "threads: 2\n");
  // The sentence on the sensor with two poses is the printed report's.
  ASSERT_EQ(report["notes"].size(), 1u);
  EXPECT_TRUE(Has(FormatReport(result_), report["notes"][0].get<std::string>()));
  const auto& frames = report["stills"][0]["frames"];
  ASSERT_EQ(frames.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(frames[i]["sensor"], result_.sensors[i].name);
    const bool placed = result_.sensors[i].structure_from_sensor.has_value();
    EXPECT_EQ(frames[i]["pictures"].size(), placed ? 4u : 2u);
    EXPECT_EQ(frames[i].contains("cloud"), placed);
    if (placed) {
      EXPECT_EQ(frames[i]["cloud"]["count"], 12000);
    }
  }
  EXPECT_EQ(ReadFile(folder_ / "rig.glb").substr(0, 4), "glTF");
  // Alone, it is the same page.
  const TempFolder alone;
  WriteReportPage(alone / "page.html", Once().With(Once().source), Once().report_run);
  EXPECT_TRUE(ReadFile(alone / "page.html") == ReadFile(folder_ / "report.html"));
}

/// A point of a .ply as volalign writes it.
struct PlyPoint {
  Eigen::Vector3d p;
  std::uint8_t label;
  float confidence, residual;
};

std::vector<PlyPoint> PlyPoints(const std::filesystem::path& path) {
  const std::string bytes = ReadFile(path), end = "end_header\n";
  const std::size_t start = bytes.find(end) + end.size();
  std::istringstream header(bytes.substr(0, start));
  std::string properties;
  std::size_t count = 0;
  for (std::string line; std::getline(header, line);) {
    if (line.rfind("element vertex ", 0) == 0) count = std::stoul(line.substr(15));
    if (line.rfind("property ", 0) == 0) properties += line.substr(9) + ";";
  }
  EXPECT_EQ(properties,
            "float x;float y;float z;uchar red;uchar green;uchar blue;uchar label;float "
            "confidence;float residual;");
  EXPECT_EQ(bytes.size(), start + 24 * count);
  std::vector<PlyPoint> points;
  for (std::size_t at = start; at + 24 <= bytes.size(); at += 24) {
    float xyz[3];
    PlyPoint point;
    std::memcpy(xyz, bytes.data() + at, 12);
    point.p = {xyz[0], xyz[1], xyz[2]};
    point.label = static_cast<std::uint8_t>(bytes[at + 15]);
    std::memcpy(&point.confidence, bytes.data() + at + 16, 4);
    std::memcpy(&point.residual, bytes.data() + at + 20, 4);
    points.push_back(point);
  }
  return points;
}

TEST_F(ExportTest, PlyHoldsThePointsInTheStructureFrame) {
  const std::vector<PlyPoint> points = PlyPoints(folder_.path() / "clouds" / "left.ply");
  ASSERT_GT(points.size(), 20000u);
  const double floor = rig_.structure.FloorHeight();
  int labelled = 0, on_floor = 0;
  for (std::size_t i = 0; i < points.size(); i += 13) {
    const PlyPoint& point = points[i];
    EXPECT_LE(std::hypot(point.p.x(), point.p.z()), 3.001);
    EXPECT_EQ(point.confidence, 1.0f);
    if (point.label) {
      const Side& side = rig_.structure.SideOfLabel(point.label);
      EXPECT_LT(std::abs(side.normal.dot(point.p - side.centre)), 3e-3);
      EXPECT_LT(point.residual, 4e-3);
      ++labelled;
    } else if (std::abs(point.p.y() - floor) < 5e-3) {
      ++on_floor;
    }
  }
  EXPECT_GT(labelled, 500);
  EXPECT_GT(on_floor, 500);
  EXPECT_EQ(PlyPoints(folder_.path() / "clouds" / "merged.ply").size(),
            points.size() + PlyPoints(folder_.path() / "clouds" / "right.ply").size());
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / "clouds" / "blind.ply"));
}

TEST_F(ExportTest, PosesAndCloudsAreInTheWorldOfTheUser) {
  ExtrinsicsSource source;
  source.world.emplace();
  source.world->name = "robot";
  source.world->world_from_structure = MakePose({M_PI / 2, 0.2, 0}, {1, -2, 3});
  source.world->covariance.setIdentity();
  const Pose& world = source.world->world_from_structure;
  const TempFolder folder;
  WriteCalibration(ResultFolder(folder.path()), Once().With(source));
  const Extrinsics read = ReadExtrinsics(folder / "extrinsics.json");
  EXPECT_EQ(read.world->name, "robot");
  const Extrinsics::Sensor& left = Named("left", read);
  EXPECT_TRUE(left.world_from_sensor->isApprox(world * *left.structure_from_sensor, 1e-9));
  EXPECT_TRUE(left.world_covariance.isApprox(CovarianceInWorld(*read.world, left.covariance)));
  EXPECT_FALSE(Named("blind", read).world_from_sensor);
  const std::vector<PlyPoint> here = PlyPoints(folder / "clouds/left.ply"),
                              there = PlyPoints(folder_ / "clouds/left.ply");
  ASSERT_EQ(here.size(), there.size());
  EXPECT_LT((here[9].p - world * there[9].p).norm(), 1e-5);
}

TEST_F(ExportTest, ResidualsAreDistancesToTheSideThatALabelNames) {
  // A network that takes everything for one side.
  FrameResult left = result_.sensors[0];
  ASSERT_EQ(left.name, "left");
  const auto label = static_cast<std::uint8_t>(LabelOf(rig_.structure, "top/front"));
  for (std::uint8_t& of : left.segmentation.labels) of = label;
  const std::vector<AlignedPoint> points = AlignedPoints(left, rig_.structure);
  ASSERT_GT(points.size(), 20000u);
  const Side& side = rig_.structure.SideOfLabel(label);
  for (std::size_t i = 0; i < points.size(); i += 101) {
    const Eigen::Vector3d d = points[i].p.cast<double>() - side.centre;
    const double beyond_u = std::max(0.0, std::abs(side.axis_u.dot(d)) - side.half_u);
    const double beyond_v = std::max(0.0, std::abs(side.axis_v.dot(d)) - side.half_v);
    const double off = Eigen::Vector3d(beyond_u, beyond_v, side.normal.dot(d)).norm();
    EXPECT_NEAR(points[i].residual, off, 1e-5);
  }
}

std::set<std::string> Files(const std::filesystem::path& folder) {
  std::set<std::string> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (!entry.is_directory()) files.insert(std::filesystem::relative(entry, folder).string());
  }
  return files;
}

/// A second capture, for which the stack was moved by a metre; blind sees nothing in either.
CalibrationResult WithSecondCapture(const CalibrationResult& result, const Pose& placement) {
  CalibrationResult both = result;
  for (const char* name : {"before", "after"}) {
    CaptureResult capture;
    capture.name = name;
    capture.sensors = result.sensors;
    capture.built = result.built;
    capture.boxes = result.boxes;
    both.captures.push_back(std::move(capture));
  }
  CaptureResult& after = both.captures[1];
  after.first_from_placement = placement;
  after.covariance = 1e-6 * Matrix6d::Identity();
  for (FrameResult& sensor : after.sensors) {
    if (sensor.structure_from_sensor)
      *sensor.structure_from_sensor = placement.inverse() * *sensor.structure_from_sensor;
  }
  after.sensors[1].structure_from_sensor.reset();
  after.sensors[1].status = SensorStatus::kFailed;
  after.sensors[1].code = SensorCode::kDegenerateSides;
  return both;
}

TEST_F(ExportTest, EachOfSeveralCapturesHasFoldersOfItsOwn) {
  const Pose placement = MakePose({0, 0.5, 0}, {1, 0, 0});
  const CalibrationResult both = WithSecondCapture(result_, placement);
  const TempFolder folder;
  WriteCalibration(ResultFolder(folder.path()), Once().With({}));
  // What others put there stays: also what is named like a file of a sensor but is none.
  WriteFileAtomically(folder / "clouds/mine.ply", "x");
  const std::set<std::string> of_one = Files(folder.path());
  EXPECT_EQ(of_one.count("clouds/right.ply") + of_one.count("clouds/merged.ply"), 2u);
  WriteCalibration(ResultFolder(folder.path()),
                   {{{"before", rig_.frames}, {"after", rig_.frames}},
                    rig_.structure,
                    both,
                    {{"a/before.json", "b/after.json"}, "", "", "", UtcNow(), ""},
                    ""},
                   ReportRun());
  const auto captures = PayloadOf(ReadFile(folder / "report.html"))["stills"];
  ASSERT_EQ(captures.size(), 2u);
  EXPECT_EQ(captures[1]["name"], "after");
  EXPECT_FALSE(captures[1]["frames"][1].contains("cloud"));  // right, which is not placed there
  std::set<std::string> expected = {"extrinsics.json",
                                    "options.yaml",
                                    "report.html",
                                    "rig.glb",
                                    "clouds/before/left.ply",
                                    "clouds/before/right.ply",
                                    "clouds/after/left.ply",
                                    "clouds/mine.ply"};
  for (const std::string capture : {"before/", "after/"}) {
    for (const char* name : {"left", "right", "blind"}) {
      for (const std::string kind : {"labels/", "confidence/", "pictures/"})
        expected.insert(kind + capture + name + ".png");
    }
    expected.insert("pictures/" + capture + "overview.png");
    expected.insert("clouds/" + capture + "merged.ply");
  }
  EXPECT_EQ(Files(folder.path()), expected) << "and none of the run before";
  // The sensor stands in one place: what is near the stack in both is in the same place.
  const auto near_both = [&](const char* file) {
    std::vector<Eigen::Vector3d> points;
    for (const PlyPoint& point : PlyPoints(folder / file)) {
      const Eigen::Vector3d &p = point.p, moved = placement.inverse() * p;
      if (std::max(std::hypot(p.x(), p.z()), std::hypot(moved.x(), moved.z())) < 2.9)
        points.push_back(p);
    }
    return points;
  };
  const std::vector<Eigen::Vector3d> before = near_both("clouds/before/left.ply"),
                                     after = near_both("clouds/after/left.ply");
  ASSERT_GT(before.size(), 10000u);
  ASSERT_EQ(before.size(), after.size());
  for (std::size_t i = 0; i < before.size(); i += 97)
    EXPECT_LT((before[i] - after[i]).norm(), 1e-5) << i;

  const Extrinsics read = ReadExtrinsics(folder / "extrinsics.json");
  EXPECT_EQ(read.captures, (std::vector<std::string>{"a/before.json", "b/after.json"}));
  ASSERT_EQ(read.placements.size(), 2u);
  EXPECT_EQ(read.placements[1].name, "after");
  EXPECT_EQ(read.placements[1].capture, "b/after.json");
  EXPECT_EQ(read.placements[1].sensors, std::vector<std::string>{"left"});
  EXPECT_TRUE(read.placements[1].first_from_placement.isApprox(placement, 1e-12));
  EXPECT_NEAR(read.placements[1].sigma_translation_m.x(), 1e-3, 1e-9);
  EXPECT_NEAR(read.placements[1].covariance(0, 0), 1e-6, 1e-12);
  const std::string report = FormatReport(both);
  EXPECT_TRUE(Has(report, "in after: the stack stood +1.000 m along x",
                  "by left; right failed (degenerate_sides)"));

  WriteCalibration(ResultFolder(folder.path()), Once().With({}));
  EXPECT_EQ(Files(folder.path()), of_one) << "without a report, and none of the second capture";
}

// Nothing that volalign did not write may go, whatever an extrinsics.json says.
TEST_F(ExportTest, NothingOfOthersIsRemoved) {
  const std::string good = ReadFile(folder_ / "extrinsics.json");
  auto leads_elsewhere = nlohmann::json::parse(good);
  leads_elsewhere["sensors"]["../../mine"] = leads_elsewhere["sensors"]["left"];
  auto of_others = nlohmann::json::parse(good);
  of_others["format"] = "another/1";
  of_others["sensors"]["mine"] = of_others["sensors"]["left"];
  for (const std::string& text : {leads_elsewhere.dump(), of_others.dump(), std::string("[1]")}) {
    const TempFolder folder;
    WriteFileAtomically(folder / "out/extrinsics.json", text);
    WriteFileAtomically(folder / "mine.ply", "x");
    WriteFileAtomically(folder / "mine.png", "x");
    WriteFileAtomically(folder / "out/clouds/mine.ply", "x");
    WriteCalibration(ResultFolder(folder / "out"), Once().With({}));
    for (const char* file : {"mine.ply", "mine.png", "out/clouds/mine.ply"})
      EXPECT_TRUE(std::filesystem::exists(folder / file)) << file << " " << text.substr(0, 60);
    EXPECT_EQ(ReadExtrinsics(folder / "out/extrinsics.json").sensors.size(), 3u);
  }
}

TEST_F(ExportTest, WhatIsSaidOfSeveralSensorsIsSaidOnce) {
  CalibrationResult result = result_;
  for (FrameResult& sensor : result.sensors) {
    sensor.status = SensorStatus::kWeak;
    sensor.code = SensorCode::kLargeResidual;
    sensor.reason = sensor.name == "right" ? "another reason" : "the same reason";
    sensor.hint = "a hint";
  }
  const std::string report = FormatReport(result);
  const std::string together =
      "left, blind are weak (large_residual): the same reason. What to do: a hint\n"
      "right is weak (large_residual): another reason. What to do: a hint\n";
  EXPECT_TRUE(Has(report, together));
  EXPECT_EQ(report.find("the same reason"), report.rfind("the same reason"));
  result.sensors[1].status = SensorStatus::kFailed;
  EXPECT_TRUE(Has(FormatReport(result),
                  "\nright failed (large_residual): another reason. What to do: a hint\n"));
}

}  // namespace
}  // namespace volalign::export_test
