
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <string>
#include <vector>

#include "infer/report/html_report/payload.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/geometry/mesh_shapes.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::page_test {
namespace {

using namespace testing_infer;

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

FrameResult Seen(const std::string& name, const Structure& structure, const Pose& pose) {
  FrameResult sensor;
  sensor.name = name;
  sensor.status = SensorStatus::kOk;
  sensor.intrinsics = Kinect();
  sensor.structure_from_sensor = pose;
  sensor.covariance = 1e-5 * Matrix6d::Identity();
  const SyntheticView frame = Render(structure, Kinect(), pose, {false, 0});
  sensor.view = MakeSensorView(frame.depth, Kinect());
  return sensor;
}

TEST(PlacedFromAbove, SaysDistanceAndHeightOfEachPlacedSensor) {
  const Structure structure = PaperStructure();
  Pose pose = RingPose(90);
  pose.translation() = Eigen::Vector3d(0, structure.FloorHeight() + 1.25, 2.5);
  FrameResult failed;
  failed.name = "S2";
  const std::string svg = PlacedFromAbove({Seen("S1", structure, pose), failed}, structure);
  EXPECT_TRUE(Has(svg, "2.50 m, 1.25 m high", "at 90° from x towards z", "uncertainty",
                  "ellipses: 2 standard deviations"));
  EXPECT_FALSE(Has(svg, "S2")) << "it has no pose";
}

TEST(AlternativeJson, ShowsTheSensorsThatStandElsewhere) {
  const Structure structure = PaperStructure();
  const Pose at = RingPose(40), other = RingPose(130);
  const std::vector<FrameResult> sensors = {Seen("S1", structure, at),
                                            Seen("S2", structure, RingPose(200))};
  RigAlternative alternative;
  alternative.sensors = {{"S1", 2, other}};
  const nlohmann::ordered_json json =
      AlternativeJson(alternative, sensors, sensors, structure, Pose::Identity());
  ASSERT_EQ(json["frames"].size(), 1u);
  EXPECT_EQ(json["frames"][0]["sensor"], "S1");
  EXPECT_GT(json["frames"][0]["outlines_differ"], 0.01);
  EXPECT_LT(json["frames"][0]["outlines_differ"], 1);
  EXPECT_NE(json["from_above"], PlacedFromAbove(sensors, structure));
  EXPECT_TRUE(Has(json["from_above"], "elsewhere"));
  EXPECT_FALSE(Has(json["from_above"], "ellipses")) << "the other poses have no covariance";
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
}  // namespace volalign::page_test
