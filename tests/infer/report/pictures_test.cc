#include "infer/report/panels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/file_util.h"
#include "core/plot/picture.h"
#include "infer/report/clouds.h"
#include "infer/report/html_report/payload.h"
#include "infer/report/report.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/formats/glb_chunks.h"
#include "tests/core/geometry/mesh_shapes.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::pictures_test {
namespace {

constexpr Rgb kDepth{200, 1, 1}, kLabels{1, 200, 1}, kModel{1, 1, 200}, kResidual{200, 200, 1};

int Count(const RgbImage& picture, Rgb colour) {
  return static_cast<int>(std::count(picture.begin(), picture.end(), colour));
}

/// A square of a legend is 8 pixels wide within its frame.
constexpr int kSwatchPixels = 64;

class Pictures : public testing::Test {
 protected:
  Pictures() {
    panels_.depth = RgbImage(80, 30, kDepth);
    panels_.labels = RgbImage(80, 30, kLabels);
    panels_.far_m = 1;
    panels_.shown_labels = {2, 20};
    sensor_.name = "S0";
  }

  Structure structure_ = ReadStructure("configs/structure.yaml");
  SensorOutcome sensor_;
  FramePanels panels_;
};

TEST(ConfidenceImage, HasAllOfItsRange) {
  Image<float> confidence(5, 1);
  const float values[] = {0, 0.5F, 1, -0.5F, 1.5F};
  std::copy(std::begin(values), std::end(values), confidence.begin());
  const LabelImage image = ConfidenceImage(confidence);
  EXPECT_EQ(std::vector<int>(image.begin(), image.end()), (std::vector<int>{0, 128, 255, 0, 255}));
}

TEST_F(Pictures, ASensorsPanelsStandSideBySide) {
  const RgbImage two = SensorPicture(sensor_, panels_, structure_, false);
  EXPECT_EQ(Count(two, kDepth), 80 * 30);
  EXPECT_EQ(Count(two, kLabels), 80 * 30);
  panels_.edges = RgbImage(80, 30, kModel);
  panels_.residual = RgbImage(80, 30, kResidual);
  const RgbImage four = SensorPicture(sensor_, panels_, structure_, false);
  EXPECT_EQ(four.height(), two.height());
  EXPECT_EQ(four.width(), two.width() + 2 * (80 + 2));
  // From left to right in one row.
  const auto left = [&](Rgb colour) {
    int least = four.width();
    for (const auto [u, v] : Pixels(four))
      if (four(u, v) == colour) least = std::min(least, u);
    return least;
  };
  EXPECT_EQ(left(kLabels), left(kDepth) + 82);
  EXPECT_EQ(left(kModel), left(kLabels) + 82);
  EXPECT_EQ(left(kResidual), left(kModel) + 82);
  for (const Rgb colour : {kDepth, kLabels, kModel, kResidual})
    EXPECT_EQ(Count(four, colour), 2400);
}

TEST_F(Pictures, TheTitleNamesTheSensorAndItsStatus) {
  const RgbImage failed = SensorPicture(sensor_, panels_, structure_, false);
  SensorOutcome weak = sensor_, other = sensor_;
  weak.status = SensorStatus::kWeak;
  other.name = "S1";
  for (const SensorOutcome& of : {weak, other})
    EXPECT_FALSE(SensorPicture(of, panels_, structure_, false) == failed);
}

TEST_F(Pictures, LegendsHaveTheLabelsThatAreShown) {
  const RgbImage bare = SensorPicture(sensor_, panels_, structure_, false);
  const RgbImage with = SensorPicture(sensor_, panels_, structure_, true);
  EXPECT_GT(with.height(), bare.height());
  for (int label = 1; label <= 20; ++label) {
    const int more = Count(with, LabelColour(label)) - Count(bare, LabelColour(label));
    EXPECT_EQ(more, label == 2 || label == 20 ? kSwatchPixels : 0) << label;
  }
  const RgbImage overview = OverviewPicture({bare, bare, bare, bare}, structure_);
  for (int label = 1; label <= 20; ++label)
    EXPECT_EQ(Count(overview, LabelColour(label)) - 4 * Count(bare, LabelColour(label)),
              kSwatchPixels);
  EXPECT_EQ(Count(overview, kDepth), 4 * 80 * 30);
  EXPECT_GT(overview.height(), 2 * bare.height());  // two rows
}

using namespace testing_infer;

FrameResult Seen(const Structure& structure, const Pose& pose, const std::string& name = "S") {
  const SyntheticView view = Render(structure, Kinect(), pose);
  FrameResult sensor;
  sensor.name = name;
  sensor.status = SensorStatus::kOk;
  sensor.intrinsics = Kinect();
  sensor.covariance = 1e-5 * Matrix6d::Identity();
  sensor.view = MakeSensorView(view.depth, Kinect());
  sensor.segmentation.labels = view.labels;
  sensor.structure_from_sensor = pose;
  return sensor;
}

// Of a failed sensor, the pose that was rejected, and no residuals.
TEST(MakePanels, ShowsTheBestGuessOfAFailedSensor) {
  const Structure structure = PaperStructure();
  FrameResult sensor = Seen(structure, RingPose(40));
  const FramePanels placed = MakePanels(sensor, structure, 0);
  sensor.best_guess = *std::exchange(sensor.structure_from_sensor, std::nullopt);
  const FramePanels failed = MakePanels(sensor, structure, 0);
  EXPECT_GT(placed.edges.size(), 0u);
  EXPECT_TRUE(failed.edges == placed.edges);
  EXPECT_TRUE(failed.residual.empty());
  sensor.best_guess.reset();
  const FramePanels without = MakePanels(sensor, structure, 0);
  EXPECT_TRUE(without.edges.empty() && without.sides.empty() && without.residual.empty());
}

TEST(SideResiduals, AreSignedAndZeroWhereThePoseIsRight) {
  const Structure structure = PaperStructure();
  FrameResult sensor = Seen(structure, RingPose(40));
  const auto extremes = [&] {
    const Image<float> residuals = SideResiduals(sensor, structure);
    double low = 1e9, high = -1e9;
    int known = 0;
    for (std::size_t i = 0; i < residuals.size(); ++i) {
      EXPECT_EQ(std::isnan(residuals[i]), sensor.segmentation.labels[i] == 0);
      if (std::isnan(residuals[i])) continue;
      ++known;
      low = std::min<double>(low, residuals[i]);
      high = std::max<double>(high, residuals[i]);
    }
    EXPECT_GT(known, 5000);
    return std::pair(low, high);
  };
  EXPECT_NEAR(extremes().first, 0, 1e-5);
  EXPECT_NEAR(extremes().second, 0, 1e-5);
  // Measured 10 mm too near along the axis: in front of every side that is seen, by at most that.
  sensor.depth_offset_m = -0.01;
  EXPECT_GT(extremes().first, 0);
  EXPECT_LT(extremes().second, 0.0125);
  sensor.depth_offset_m = 0.01;
  EXPECT_LT(extremes().second, 0);
  // Taken for 1 % farther, from 1 to 3 m: behind every side.
  sensor.depth_offset_m = 0;
  sensor.depth_gain = 1.01;
  EXPECT_LT(extremes().second, -0.001);
  EXPECT_GT(extremes().first, -0.03);
  sensor.structure_from_sensor.reset();
  for (const float residual : SideResiduals(sensor, structure)) EXPECT_TRUE(std::isnan(residual));
}

TEST(MakePanels, TurnsFramesUprightAndThinsLargeOnes) {
  const Structure structure = PaperStructure();
  FrameResult sensor = Seen(structure, RingPose(40));
  const FramePanels panels = MakePanels(sensor, structure, 1);
  EXPECT_EQ(panels.depth.width(), 288);
  EXPECT_EQ(panels.depth.height(), 320);
  // The pose is exact: the edges lie on measured pixels of the stack, beside another label.
  int edges = 0;
  for (const auto [u, v] : Pixels(320, 288)) {
    const int x = 288 - 1 - v, y = u;
    if (panels.edges(x, y) == panels.depth(x, y)) continue;
    ++edges;
    const LabelImage& labels = sensor.segmentation.labels;
    const int label = labels(u, v);
    EXPECT_GT(label, 0) << u << ", " << v;
    EXPECT_TRUE((u > 0 && labels(u - 1, v) != label) || (u < 319 && labels(u + 1, v) != label) ||
                (v > 0 && labels(u, v - 1) != label) || (v < 287 && labels(u, v + 1) != label))
        << u << ", " << v;
  }
  EXPECT_GT(edges, 300);
  ASSERT_FALSE(panels.sides.empty());
  EXPECT_LT(panels.sides.front().rms_m, 1e-5);
  EXPECT_FALSE(panels.shown_labels.empty());
  EXPECT_GT(panels.shown_labels.front(), 0);
  for (const auto [u, v] : Pixels(320, 288)) {
    const bool labelled = sensor.segmentation.labels(u, v) > 0;
    const Rgb residual = panels.residual(288 - 1 - v, u);
    EXPECT_EQ(labelled, residual == SignedColour(0)) << u << ", " << v;
  }
  Intrinsics wide = Kinect();
  wide.width = 1280;
  wide.height = 720;
  FrameResult large;
  large.view = MakeSensorView(DepthImage(1280, 720, 2.0f), wide);
  large.segmentation.labels = LabelImage(1280, 720, 0);
  const FramePanels thinned = MakePanels(large, structure, 0);
  EXPECT_EQ(thinned.depth.width(), 427);
  EXPECT_EQ(thinned.depth.height(), 240);
}

using nlohmann::json;

/// Accessors are checked by core/formats/gltf_parts_test, the tree of nodes by report/rig.
struct Glb : GlbChunks {
  using GlbChunks::GlbChunks;

  const json& Node(const std::string& name) const {
    for (const json& node : document["nodes"]) {
      if (node.value("name", "") == name) return node;
    }
    ADD_FAILURE() << "no node " << name;
    return document;
  }
  const json& Primitive(const std::string& node) const {
    return Item("meshes", Node(node)["mesh"])["primitives"][0];
  }
};

Pose PoseOf(const json& node) {
  Pose pose = Pose::Identity();
  if (node.contains("translation")) {
    for (int i = 0; i < 3; ++i)
      pose.translation()[i] = node["translation"][static_cast<std::size_t>(i)];
  }
  if (node.contains("rotation")) {
    const json& q = node["rotation"];
    pose.linear() = Eigen::Quaterniond(q[3], q[0], q[1], q[2]).toRotationMatrix();
  }
  return pose;
}

Extrinsics TwoSensors() {
  Extrinsics extrinsics;
  extrinsics.sensors.resize(2);
  extrinsics.sensors[0].name = "left";
  extrinsics.sensors[0].status = SensorStatus::kOk;
  extrinsics.sensors[0].structure_from_sensor = RingPose(30);
  extrinsics.sensors[0].intrinsics = Kinect();
  extrinsics.sensors[1].name = "lost";
  extrinsics.sensors[1].intrinsics = Kinect();
  extrinsics.placements.resize(2);
  extrinsics.placements[0].name = "here";
  extrinsics.placements[1].name = "there";
  extrinsics.placements[1].first_from_placement.translation() = Eigen::Vector3d(1, 0, 2);
  extrinsics.placements[1].sensors = {"left"};
  return extrinsics;
}

TEST(RigGlb, HasStackSensorsAsCamerasAndClouds) {
  const TempFolder folder;
  const Structure structure = PaperStructure();
  AlignedPoint point;
  point.p = {0.1f, -0.2f, 0.3f};
  point.colour = {1, 2, 3};
  AlignedPoint other;
  other.p = {-1, 2, 0.5f};
  WriteRigGlb(folder / "rig.glb", TwoSensors(), {structure, structure},
              {{"left", "here", {point, other}}, {"lost", "here", {}}});
  const Glb glb(ReadFile(folder / "rig.glb"));

  const json& sensor = glb.Node("left");
  const json& camera = glb.Item("nodes", sensor["children"][0]);
  const json& optics = glb.Item("cameras", camera["camera"]);
  EXPECT_EQ(optics["type"], "perspective");
  // Half the height over the focal length is the tangent of half the angle.
  EXPECT_NEAR(std::tan(optics["perspective"]["yfov"].get<double>() / 2), 144 / 252.2, 1e-9);
  EXPECT_NEAR(optics["perspective"]["aspectRatio"].get<double>(), 320.0 / 288, 1e-9);
  // A glTF camera looks along -z: two metres before the sensor along its axis.
  const Eigen::Vector3d ahead = PoseOf(sensor) * PoseOf(camera) * Eigen::Vector3d(0, 0, -2);
  EXPECT_LT((ahead - RingPose(30) * Eigen::Vector3d(0, 0, 2)).norm(), 1e-9);
  // ... with its y upwards in the picture.
  const Eigen::Vector3d up = PoseOf(sensor) * PoseOf(camera) * Eigen::Vector3d(0, 1, 0);
  EXPECT_LT((up - RingPose(30) * Eigen::Vector3d(0, -1, 0)).norm(), 1e-9);
  EXPECT_EQ(sensor["extras"]["status"], "ok");
  EXPECT_EQ(sensor["extras"]["structure_from_sensor"].size(), 16u);
  EXPECT_NEAR(sensor["extras"]["structure_from_sensor"][7].get<double>(), 0.4, 1e-12);
  EXPECT_NEAR(sensor["extras"]["intrinsics"]["cy"].get<double>(), 168.2, 1e-12);

  // The pyramid's corners are where the picture's are.
  const std::vector<float> corners =
      glb.Values<float>(glb.Primitive("left")["attributes"]["POSITION"], 3, 5126);
  ASSERT_EQ(corners.size(), 15u);
  const double places[4][2] = {{-0.5, -0.5}, {319.5, -0.5}, {319.5, 287.5}, {-0.5, 287.5}};
  for (std::size_t i = 0; i < 4; ++i) {
    const float* corner = &corners[3 + 3 * i];
    const Eigen::Vector3d expected =
        RingPose(30) *
        (0.3 * Eigen::Vector3d((places[i][0] - 163.9) / 252.2, (places[i][1] - 168.2) / 252.2, 1));
    EXPECT_LT((PoseOf(sensor) * Eigen::Vector3d(corner[0], corner[1], corner[2]) - expected).norm(),
              1e-6)
        << i;
  }

  const json& points = glb.Primitive("left points in here");
  EXPECT_EQ(points["mode"], 0);
  EXPECT_EQ(glb.Values<float>(points["attributes"]["POSITION"], 3, 5126),
            (std::vector<float>{0.1f, -0.2f, 0.3f, -1, 2, 0.5f}));
  const json& colours = glb.Item("accessors", points["attributes"]["COLOR_0"]);
  EXPECT_EQ(colours["normalized"], true);
  EXPECT_EQ(colours["type"], "VEC4");

  std::size_t boxes = 0;
  for (const json& node : glb.document["nodes"]) boxes += node.value("name", "") == "top";
  EXPECT_EQ(boxes, 2u);
  EXPECT_TRUE(PoseOf(glb.Node(structure.name() + " in there"))
                  .translation()
                  .isApprox(Eigen::Vector3d(1, 0, 2), 1e-12));
  for (const json& node : glb.document["nodes"]) EXPECT_NE(node.value("name", ""), "lost");
}

TEST(RigGlb, ACaptureThatNoSensorTellsOfHasNoStack) {
  const TempFolder folder;
  Extrinsics extrinsics = TwoSensors();
  extrinsics.placements[1].sensors.clear();
  WriteRigGlb(folder / "rig.glb", extrinsics, {PaperStructure(), PaperStructure()}, {});
  const Glb glb(ReadFile(folder / "rig.glb"));
  for (const json& node : glb.document["nodes"]) EXPECT_FALSE(Has(node.value("name", ""), "there"));
}

FrameResult Placed(const std::string& name, double sigma_m) {
  FrameResult sensor;
  sensor.name = name;
  sensor.status = SensorStatus::kOk;
  sensor.structure_from_sensor = Pose::Identity();
  sensor.covariance = sigma_m * sigma_m * Matrix6d::Identity();
  return sensor;
}

TEST(Advise, NamesTheLeastKnownAlsoWhereAllIsOk) {
  CalibrationResult result;
  result.sensors = {Placed("S1", 0.004), Placed("S2", 0.002), Placed("S3", 0.003)};
  const std::vector<std::string> advice = Advise(result);
  ASSERT_EQ(advice.size(), 2u);
  EXPECT_TRUE(Has(advice[0], "volalign convert"));
  EXPECT_EQ(advice[1].find("least certain: S1 (4.0 mm) and S3 (3.0 mm)"), 0u) << advice[1];
  result.sensors[1].status = SensorStatus::kWeak;
  EXPECT_FALSE(Has(Advise(result)[0], "volalign convert"));
  result.captures.resize(2);
  EXPECT_EQ(Advise(result).size(), 1u) << "what a third capture would bring is another question";
}

/// What stands between the script element's tags.
std::string PayloadText(const std::string& page) {
  const std::string begin = "<script type=\"application/json\" id=\"payload\">";
  const std::size_t at = page.find(begin) + begin.size();
  return page.substr(at, page.find("</script>", at) - at);
}

TEST(ReportPage, CarriesThePayloadWhateverItSays) {
  const nlohmann::ordered_json payload = {
      {"text", "</script><script>alert(1)</script><!-- {{scripts}} {{payload}} \" ' & é"},
      {"number", 1.5}};
  const std::string page = ReportPage(payload);
  EXPECT_EQ(nlohmann::ordered_json::parse(PayloadText(page)), payload);
  EXPECT_FALSE(Has(page, "alert(1)</script>"));
}

TEST(ReportPage, NeedsNothingElse) {
  const std::string page = ReportPage({{"a", 1}});
  for (const char* mark : {"{{style}}", "{{three}}", "{{payload}}", "{{scripts}}"})
    EXPECT_FALSE(Has(page, mark));
  EXPECT_TRUE(Has(page, "default-src 'none'"));
  EXPECT_FALSE(Has(page, "<link rel=\"stylesheet\""));
  EXPECT_FALSE(Has(page, "src=\""));
  // three.js, its controls, and its licence.
  for (const char* part : {"REVISION", "OrbitControls", "Permission is hereby granted"})
    EXPECT_TRUE(Has(page, part));
}

TEST(ReportPayload, HasTheStructureAsItIs) {
  const Structure structure = PaperStructure();
  const nlohmann::ordered_json payload = ReportPayload(
      Extrinsics(), {{"", structure, {}}}, {"one\n\ntwo\n", {"do this"}, "<svg/>", {}},
      {"volalign x", "verdict: {weak_rms_m: 0.03}\n"});
  EXPECT_EQ(payload["notes"], nlohmann::ordered_json({"one", "two"}));
  EXPECT_EQ(payload["command"], "volalign x");
  EXPECT_EQ(payload["advice"][0], "do this");
  EXPECT_EQ(payload["limits"]["rms_m"], 0.03) << "as the calibration had it";
  EXPECT_EQ(payload["limits"]["inlier_share"], VerdictOptions().weak_inlier_share);
  ASSERT_EQ(payload["labels"].size(), 20u);
  EXPECT_EQ(payload["labels"][4]["id"], 5);
  EXPECT_EQ(payload["labels"][4]["name"], structure.SideOfLabel(5).name);
  const auto& boxes = payload["stills"][0]["boxes"];
  ASSERT_EQ(boxes.size(), 4u);
  // Centre plus both half axes is a corner: as far from the centre as half the diagonal.
  for (const auto& side : boxes[2]["sides"]) {
    double u2 = 0, v2 = 0, uv = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      u2 += side["u"][i].get<double>() * side["u"][i].get<double>();
      v2 += side["v"][i].get<double>() * side["v"][i].get<double>();
      uv += side["u"][i].get<double>() * side["v"][i].get<double>();
    }
    EXPECT_NEAR(uv, 0, 1e-12);
    EXPECT_GT(u2 * v2, 0);
  }
  EXPECT_EQ(payload["extrinsics"]["format"], "volalign.extrinsics/1");
}

TEST(ReportPayload, HasTheTrianglesOfMeshes) {
  const Structure ell = mesh_shapes::StructureOf(mesh_shapes::Ell());
  const nlohmann::ordered_json payload =
      ReportPayload(Extrinsics(), {{"", ell, {}}}, {"", {}, "<svg/>", {}}, {"volalign x", ""});
  const auto& sides = payload["stills"][0]["boxes"][0]["sides"];
  ASSERT_EQ(sides.size(), ell.sides().size());
  for (std::size_t i = 0; i < sides.size(); ++i) {
    const Side& side = ell.sides()[i];
    EXPECT_EQ(sides[i]["label"], side.label);
    const auto at = [&](const char* key, std::size_t k) {
      const auto& p = sides[i][key][k];
      return Eigen::Vector3d(p[0].get<double>(), p[1].get<double>(), p[2].get<double>());
    };
    ASSERT_EQ(sides[i]["triangles"].size() % 3, 0u);
    double area = 0;
    for (std::size_t k = 0; k < sides[i]["triangles"].size(); k += 3) {
      const Eigen::Vector3d a = at("triangles", k);
      const Eigen::Vector3d across = (at("triangles", k + 1) - a).cross(at("triangles", k + 2) - a);
      EXPECT_GT(across.dot(side.normal), 0);
      area += across.norm() / 2;
    }
    EXPECT_NEAR(area, side.Area(), 1e-3);
    ASSERT_EQ(sides[i]["borders"].size(), 2u * static_cast<std::size_t>(side.CountBorders()));
    for (std::size_t k = 0; k < sides[i]["borders"].size(); ++k)
      EXPECT_NEAR(side.Beyond(at("borders", k)), 0, 1e-3);
  }
}

TEST(EncodeCloud, HoldsHalfMillimetresLittleEndian) {
  AlignedPoint point;
  point.p = {1.0f, -0.0005f, 100.0f};  // 2000, -1, beyond 16 bits
  point.label = 200;
  point.side_residual = -0.01f;  // -40
  AlignedPoint background;
  const EncodedCloud cloud = EncodeCloud({point, background});
  EXPECT_EQ(cloud.count, 2u);
  EXPECT_EQ(cloud.positions, Base64(std::string("\xd0\x07\xff\xff\xff\x7f\0\0\0\0\0\0", 12)));
  EXPECT_EQ(cloud.labels, Base64(std::string("\xc8\0", 2)));
  EXPECT_EQ(cloud.residuals, Base64(std::string("\xd8\x80", 2)));
}

TEST(ThinCloud, PrefersLabelledPointsAndTakesEvenly) {
  std::vector<AlignedPoint> points(10000);
  for (std::size_t i = 0; i < points.size(); ++i) {
    points[i].p.x() = static_cast<float>(i);
    points[i].label = i < 2000 ? 1 : 0;
  }
  const auto labelled = [](const std::vector<AlignedPoint>& of) {
    return std::count_if(of.begin(), of.end(), [](const auto& p) { return p.label > 0; });
  };
  EXPECT_EQ(ThinCloud(points, 10000).size(), 10000u);
  const std::vector<AlignedPoint> thinned = ThinCloud(points, 1000);
  ASSERT_EQ(thinned.size(), 1000u);
  EXPECT_EQ(labelled(thinned), 600);
  for (std::size_t i = 1; i < 600; ++i) {
    EXPECT_GT(thinned[i].p.x(), thinned[i - 1].p.x());  // each once
    EXPECT_LE(thinned[i].p.x() - thinned[i - 1].p.x(), 7);
  }
  // All labelled points where they are few; more of them where there is little else.
  EXPECT_EQ(labelled(ThinCloud(points, 5000)), 2000);
  EXPECT_EQ(ThinCloud(points, 5000).size(), 5000u);
  points.resize(2100);
  EXPECT_EQ(labelled(ThinCloud(points, 1000)), 900);
}

TEST(PlacedFromAbove, SaysDistanceAndHeightOfEachPlacedSensor) {
  const Structure structure = PaperStructure();
  Pose pose = RingPose(90);
  pose.translation() = Eigen::Vector3d(0, structure.FloorHeight() + 1.25, 2.5);
  FrameResult failed;
  failed.name = "S2";
  const std::string svg = PlacedFromAbove({Seen(structure, pose, "S1"), failed}, structure);
  EXPECT_TRUE(Has(svg, "2.50 m, 1.25 m high", "at 90° from x towards z", "uncertainty",
                  "ellipses: 2 standard deviations"));
  EXPECT_FALSE(Has(svg, "S2")) << "it has no pose";
}

TEST(AlternativeJson, ShowsTheSensorsThatStandElsewhere) {
  const Structure structure = PaperStructure();
  const Pose at = RingPose(40), other = RingPose(130);
  const std::vector<FrameResult> sensors = {Seen(structure, at, "S1"),
                                            Seen(structure, RingPose(200), "S2")};
  RigAlternative alternative;
  alternative.sensors = {{"S1", 2, other}};
  const nlohmann::ordered_json shown =
      AlternativeJson(alternative, sensors, sensors, structure, Pose::Identity());
  ASSERT_EQ(shown["frames"].size(), 1u);
  EXPECT_EQ(shown["frames"][0]["sensor"], "S1");
  EXPECT_GT(shown["frames"][0]["outlines_differ"], 0.01);
  EXPECT_LT(shown["frames"][0]["outlines_differ"], 1);
  EXPECT_NE(shown["from_above"], PlacedFromAbove(sensors, structure));
  EXPECT_TRUE(Has(shown["from_above"], "elsewhere"));
  EXPECT_FALSE(Has(shown["from_above"], "ellipses")) << "the other poses have no covariance";
  alternative.sensors = {{"S1", 2, at}};
  EXPECT_EQ(AlternativeJson(alternative, sensors, sensors, structure,
                            Pose::Identity())["frames"][0]["outlines_differ"],
            0);
  // In another capture's structure the pose is another one.
  const Pose moved(Eigen::Translation3d(1, 0, 0));
  alternative.sensors = {{"S1", 2, moved * at}};
  EXPECT_NEAR(AlternativeJson(alternative, sensors, sensors, structure,
                              moved)["frames"][0]["outlines_differ"],
              0, 1e-3);
}

}  // namespace
}  // namespace volalign::pictures_test
