#include "render/rig.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "core/base/file_util.h"
#include "core/formats/image_io.h"
#include "core/geometry/lens.h"
#include "core/geometry/structure.h"
#include "core/geometry/visibility.h"
#include "render/capture_writer.h"
#include "render/egl/renderers.h"
#include "render/noise.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/core/base/tally.h"
#include "tests/core/base/temp_folder.h"
#include "tests/render/test_scene.h"

namespace volalign::rig_test {
namespace {

/// Of a rig without placements.
RigCapture RenderOne(const Rig& rig, DepthRenderer& renderer) {
  return std::move(RenderPlacements(rig, renderer).front());
}

class RigTest : public testing::Test {
 protected:
  static Rig Parse(const std::string& yaml) {
    return ReadRig(ConfigSource::FromString(yaml, "test.yaml"));
  }
  static void ExpectBad(const std::string& yaml, const std::string& part) {
    ExpectError<ConfigError>([&] { Parse(yaml); }, {part});
  }

  TempFolder folder_;
  const std::filesystem::path dir_ = folder_.path();
  const std::unique_ptr<DepthRenderer> owned_ = GlRenderers()();
  DepthRenderer& renderer_ = *owned_;
};

const std::string kTwo =
    "structure_yaw_deg: 30\nseed: 5\nsensors:\n"
    "  - {name: A, sensor: realsense_d415, rho_cm: 210, phi_deg: 40, height_cm: 95}\n"
    "  - {name: B, sensor: azure_kinect_nfov_binned, rho_cm: 190, phi_deg: 200, height_cm: 120, "
    "roll_deg: 0}\n";

TEST_F(RigTest, PosesHaveTheirClosedForm) {
  RigSensor sensor;
  sensor.rho_cm = 200;
  sensor.phi_deg = 90;
  sensor.height_cm = 81;
  sensor.roll_deg = 0;
  // At z = 2 m, looking along -z: x to the right is -x... the sensor faces the structure, its right
  // hand is +x.
  Pose expected = Pose::Identity();
  expected.linear() << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  expected.translation() = Eigen::Vector3d(0, 0, 2);
  EXPECT_TRUE(RigSensorPose(sensor, 0, -0.81).matrix().isApprox(expected.matrix(), 1e-9));
  // The structure turned by +90 deg about y (z to x) sees that sensor at its own -x... R_y(-90) (0,
  // 0, 2) = (-2, 0, 0).
  EXPECT_TRUE(
      RigSensorPose(sensor, 90, -0.81).translation().isApprox(Eigen::Vector3d(-2, 0, 0), 1e-9));
}

TEST_F(RigTest, WrittenCaptureReadsBack) {
  const RigCapture capture = RenderOne(Parse(kTwo), renderer_);
  WriteCapture(dir_, capture, "a renderer");
  const auto json = nlohmann::json::parse(ReadFile(dir_ / "capture.json"));
  EXPECT_EQ(json.at("format"), "volalign.capture/1");
  ASSERT_EQ(json.at("sensors").size(), 2u);
  EXPECT_EQ(ReadStructure(dir_ / json.at("structure").get<std::string>()).Hash(),
            capture.structure.Hash());
  for (std::size_t i = 0; i < 2; ++i) {
    const auto& entry = json.at("sensors").at(i);
    const CapturedSensor& sensor = capture.sensors[i];
    EXPECT_EQ(entry.at("name"), sensor.name);
    EXPECT_EQ(entry.at("renderer"), "a renderer");
    EXPECT_EQ(entry.at("sensor"), i == 0 ? "realsense_d415" : "azure_kinect_nfov_binned");
    const auto& k = entry.at("intrinsics");
    EXPECT_EQ(entry.at("depth"), sensor.name + "_depth.png");
    EXPECT_EQ(nlohmann::json::parse(ReadFile(dir_ / (sensor.name + "_intrinsics.json"))), k);
    EXPECT_EQ(k.at("width"), sensor.depth.width());
    EXPECT_EQ(k.at("height"), sensor.depth.height());
    EXPECT_EQ(k.at("fx"), sensor.intrinsics.fx);
    EXPECT_EQ(k.at("cy"), sensor.intrinsics.cy);
    EXPECT_EQ(k.at("distortion").size(), i == 0 ? 0U : 8U);
    EXPECT_EQ(k.at("distortion").get<std::vector<double>>(), sensor.intrinsics.distortion);
    const DepthImage depth = ToMetres(ReadDepthFile(dir_ / entry.at("depth").get<std::string>()),
                                      json.at("depth_scale"));
    ASSERT_EQ(depth.size(), sensor.depth.size());
    for (std::size_t p = 0; p < depth.size(); ++p) EXPECT_NEAR(depth[p], sensor.depth[p], 1e-5);
    EXPECT_TRUE(ReadPng8(dir_ / (sensor.name + "_labels.png")) == sensor.labels);
    EXPECT_EQ(json.at("ground_truth").at(sensor.name), ToRows(sensor.structure_from_sensor));
  }
  EXPECT_EQ(capture.sensors[0].depth.width(), 320);
  EXPECT_EQ(capture.sensors[0].depth.height(), 180);
  EXPECT_EQ(capture.sensors[1].depth.height(), 288);
  EXPECT_GT(std::filesystem::file_size(dir_ / "contact_sheet.png"), 10000U);
}

TEST_F(RigTest, TheCaptureLeavesOutALensThatIsNotStated) {
  const RigCapture stated = RenderOne(Parse(kTwo), renderer_);
  const RigCapture silent = RenderOne(Parse("state_lens: false\n" + kTwo), renderer_);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_TRUE(silent.sensors[i].depth == stated.sensors[i].depth);
    EXPECT_TRUE(silent.sensors[i].intrinsics == stated.sensors[i].intrinsics);
    EXPECT_TRUE(stated.sensors[i].stated_intrinsics == stated.sensors[i].intrinsics);
    EXPECT_TRUE(silent.sensors[i].stated_intrinsics.distortion.empty());
    EXPECT_EQ(silent.sensors[i].stated_intrinsics.fx, stated.sensors[i].intrinsics.fx);
  }
  WriteCapture(dir_, silent, "a renderer");
  const auto json = nlohmann::json::parse(ReadFile(dir_ / "capture.json"));
  EXPECT_TRUE(json.at("sensors").at(1).at("intrinsics").at("distortion").empty());
}

TEST_F(RigTest, LensSpreadIsThatOfFocalLengthsAndRadialFactors) {
  const auto factor = [](const Intrinsics& k) {
    return (ProjectRay(k, {0.6, 0}).x() - k.cx) / (0.6 * k.fx);
  };
  Tally focal, radial, both;
  for (int seed = 1; seed <= 60; ++seed) {
    const RigCapture capture = RenderOne(
        Parse("room: false\nnoise: none\nlens_spread_percent: 0.5\nseed: " + std::to_string(seed) +
              "\nsensors:\n"
              "  - {name: A, sensor: realsense_d415, image_size: 32x18}\n"
              "  - {name: B, sensor: azure_kinect_nfov_binned, image_size: 20x18}\n"),
        renderer_);
    for (const CapturedSensor& sensor : capture.sensors) {
      const double longer = sensor.intrinsics.fx / sensor.stated_intrinsics.fx - 1;
      const double wider = factor(sensor.intrinsics) / factor(sensor.stated_intrinsics) - 1;
      focal += longer;
      radial += wider;
      both += longer * wider;
      EXPECT_DOUBLE_EQ(sensor.intrinsics.fy / sensor.stated_intrinsics.fy, 1 + longer);
      EXPECT_EQ(sensor.intrinsics.cx, sensor.stated_intrinsics.cx);
    }
  }
  for (const Tally* values : {&focal, &radial}) {
    EXPECT_NEAR(values->Rms(), 0.005, 0.0013);  // 4 sigma of its own
    EXPECT_NEAR(values->Mean(), 0, 0.0019);
  }
  EXPECT_NEAR(both.Mean() / (0.005 * 0.005), 0, 0.4);  // drawn independently
}

// What one sensor sees well above the floor, another one beside it has at the same depth.
TEST_F(RigTest, SensorsShareTheRoom) {
  const RigCapture capture =
      RenderOne(Parse("tripods: false\nsensors:\n"
                      "  - {name: A, sensor: realsense_d415, phi_deg: 0, roll_deg: 0}\n"
                      "  - {name: B, sensor: realsense_d415, phi_deg: 10, roll_deg: 0}\n"),
                renderer_);
  const CapturedSensor &a = capture.sensors[0], &b = capture.sensors[1];
  const Pose b_from_a = b.structure_from_sensor.inverse() * a.structure_from_sensor;
  long seen = 0, same = 0;
  for (const auto [u, v] : Pixels(a.depth_clean)) {
    const Eigen::Vector3d p =
        a.depth_clean(u, v) * Eigen::Vector3d((u - a.intrinsics.cx) / a.intrinsics.fx,
                                              (v - a.intrinsics.cy) / a.intrinsics.fy, 1);
    const Eigen::Vector3d q = b_from_a * p;
    const Eigen::Vector2d at = ProjectRay(b.intrinsics, q.hnormalized());
    if (a.labels_clean(u, v) != 0 || (a.structure_from_sensor * p).y() < -0.4 || q.z() < 0.1 ||
        at.minCoeff() < 0 || at.x() > b.intrinsics.width - 1 || at.y() > b.intrinsics.height - 1)
      continue;
    ++seen;
    const double depth =
        b.depth_clean(static_cast<int>(std::lround(at.x())), static_cast<int>(std::lround(at.y())));
    same += std::abs(depth - q.z()) < 0.05;
  }
  EXPECT_GT(seen, 5000);
  EXPECT_GT(static_cast<double>(same), 0.7 * static_cast<double>(seen));
}

int Seen(const LabelImage& labels) {
  return static_cast<int>(
      std::count_if(labels.begin(), labels.end(), [](int label) { return label > 0; }));
}

TEST_F(RigTest, RoomWithoutStructureAndSensorThatLooksAway) {
  const RigCapture empty = RenderOne(Parse("structure_present: false\n" + kTwo), renderer_);
  for (const CapturedSensor& sensor : empty.sensors) {
    EXPECT_EQ(Seen(sensor.labels_clean), 0);
    EXPECT_GT(
        std::count_if(sensor.depth.begin(), sensor.depth.end(), [](float z) { return z > 0; }),
        5000);
  }
  WriteCapture(dir_, empty, "a renderer");
  EXPECT_FALSE(nlohmann::json::parse(ReadFile(dir_ / "capture.json")).contains("ground_truth"));

  const RigCapture away = RenderOne(
      Parse("sensors:\n  - {name: A, phi_deg: 0, look_at_cm: [600, 0, 100]}\n"), renderer_);
  EXPECT_EQ(Seen(away.sensors[0].labels_clean), 0);
}

TEST_F(RigTest, ABoardHidesAShareOfEachView) {
  const std::string far_apart =
      "room: false\nnoise: none\nsensors:\n"
      "  - {name: A, sensor: azure_kinect_nfov_binned, phi_deg: 0, roll_deg: 90}\n"
      "  - {name: B, sensor: realsense_d415, phi_deg: 120, roll_deg: 0, height_cm: 150}\n"
      "  - {name: C, sensor: realsense_d415, phi_deg: 240, roll_deg: 37, height_cm: 60}\n";
  for (int seed = 1; seed < 5; ++seed) {
    const std::string rig = "seed: " + std::to_string(seed) + "\n" + far_apart;
    const RigCapture free = RenderOne(Parse(rig), renderer_);
    for (const double share : {0.2, 0.6}) {
      const RigCapture hidden =
          RenderOne(Parse("hidden_share: " + std::to_string(share) + "\n" + rig), renderer_);
      for (std::size_t i = 0; i < 3; ++i) {
        const LabelImage& labels = hidden.sensors[i].labels_clean;
        EXPECT_NEAR(Seen(labels), (1 - share) * Seen(free.sensors[i].labels_clean),
                    0.03 * Seen(free.sensors[i].labels_clean));
        // What hides it stands before the sensor.
        const DepthImage& z = hidden.sensors[i].depth_clean;
        const auto is_near = [](float depth) { return depth > 0 && depth < 1; };
        EXPECT_GT(std::count_if(z.begin(), z.end(), is_near),
                  share * Seen(free.sensors[i].labels_clean));
      }
    }
  }
}

TEST_F(RigTest, MissingPixelsAreLostByThemselves) {
  const std::string rig = "noise: none\n" + kTwo;
  const RigCapture whole = RenderOne(Parse(rig), renderer_);
  const RigCapture part = RenderOne(Parse("missing_share: 0.3\n" + rig), renderer_);
  for (std::size_t i = 0; i < 2; ++i) {
    const DepthImage& before = whole.sensors[i].depth;
    const DepthImage& after = part.sensors[i].depth;
    int kept = 0, kept_beside = 0, measured = 0, beside = 0;
    for (const auto [u, v] : Pixels({1, 0}, {before.width(), before.height()})) {
      if (!(before(u, v) > 0)) continue;
      ++measured;
      kept += after(u, v) > 0;
      if (after(u, v) > 0) {
        EXPECT_EQ(after(u, v), before(u, v));
      }
      if (!(before(u - 1, v) > 0) || after(u - 1, v) > 0) continue;
      ++beside;
      kept_beside += after(u, v) > 0;
    }
    EXPECT_NEAR(kept, 0.7 * measured, 0.01 * measured);
    EXPECT_NEAR(kept_beside, 0.7 * beside, 0.02 * beside);  // of those beside a lost one
    EXPECT_LT(Seen(part.sensors[i].labels), 0.75 * Seen(whole.sensors[i].labels));
  }
}

TEST_F(RigTest, ACaptureIsAsItWasRecorded) {
  // Whatever draws more or other random numbers changes these by much more.
  const RigCapture capture = RenderOne(Parse(kTwo), renderer_);
  const double recorded[2][2] = {{31182, 2.14343},
                                 {68237, 3.30298}};  // pixels with depth, their mean depth in m
  for (std::size_t i = 0; i < 2; ++i) {
    Tally valid;
    for (const float z : capture.sensors[i].depth)
      if (z > 0) valid += z;
    EXPECT_NEAR(valid.count, recorded[i][0], 15);
    EXPECT_NEAR(valid.Mean(), recorded[i][1], 1e-3);
  }
}

const std::string kPlacements =
    "placements:\n"
    "  - {x_cm: 0, z_cm: 0, yaw_deg: 0}\n"
    "  - {x_cm: 60, z_cm: -40, yaw_deg: 110}\n";

TEST_F(RigTest, PlacementsHaveTheirClosedForm) {
  RigPlacement placement;
  placement.x_cm = 100;
  placement.z_cm = 50;
  placement.yaw_deg = 90;
  const Pose first_from_placement = FirstFromPlacement(placement);
  // The structure's +z turns to +x of the first frame, its +x to -z.
  EXPECT_LT((first_from_placement * Eigen::Vector3d(0, 0, 1) - Eigen::Vector3d(2, 0, 0.5)).norm(),
            1e-12);
  EXPECT_LT((first_from_placement * Eigen::Vector3d(1, 3, 0) - Eigen::Vector3d(1, 3, -0.5)).norm(),
            1e-12);
}

TEST_F(RigTest, ATurnedStructureStaysAtItsPlaces) {
  const Rig rig = Parse(kTwo + kPlacements);
  Rig turned = rig;
  constexpr double kTurn = 50;
  TurnStructure(kTurn, &turned);
  // Seen from the structure at each of its places, each sensor has moved by the opposite turn.
  const Eigen::AngleAxisd back(-kTurn * M_PI / 180, Eigen::Vector3d::UnitY());
  for (const RigSensor& sensor : rig.sensors) {
    const Eigen::Vector3d before = RigSensorPose(sensor, rig.structure_yaw_deg, 0).translation();
    const Eigen::Vector3d after = RigSensorPose(sensor, turned.structure_yaw_deg, 0).translation();
    EXPECT_LT((after - back * before).norm(), 1e-12);
    for (std::size_t k = 0; k < 2; ++k) {
      const Eigen::Vector3d was = FirstFromPlacement(rig.placements[k]).inverse() * before;
      const Eigen::Vector3d is = FirstFromPlacement(turned.placements[k]).inverse() * after;
      EXPECT_LT((is - back * was).norm(), 1e-12);
    }
  }
}

TEST_F(RigTest, OnlyTheStructureMovesBetweenPlacements) {
  const std::string content =
      "noise: none\nassembly: {position_mm: 4, yaw_deg: 1, size_scale_percent: 1, "
      "floor_tilt_deg: 0.4}\n";
  const std::vector<RigCapture> captures =
      RenderPlacements(Parse(content + kTwo + kPlacements), renderer_);
  ASSERT_EQ(captures.size(), 3u);
  for (const RigCapture& capture : captures) {
    EXPECT_EQ(capture.size_scale, captures[0].size_scale);
    for (std::size_t b = 0; b < capture.box_offsets.size(); ++b) {
      const double change =
          (capture.box_offsets[b].matrix() - captures[0].box_offsets[b].matrix()).norm();
      EXPECT_EQ(&capture == &captures[0], change < 1e-4);
    }
    const Structure built = capture.structure.Displaced(capture.box_offsets, capture.size_scale);
    for (std::size_t i = 0; i < 2; ++i) {
      const CapturedSensor &sensor = capture.sensors[i], &first = captures[0].sensors[i];
      EXPECT_TRUE(sensor.intrinsics == first.intrinsics);
      EXPECT_LT(((capture.first_from_placement * sensor.structure_from_sensor).matrix() -
                 first.structure_from_sensor.matrix())
                    .norm(),
                1e-12);
      // The structure, as cast from the pose in its own frame, stands where the picture has it.
      const ExpectedView truth =
          CastView(built, ComputeRays(sensor.intrinsics), sensor.structure_from_sensor);
      long compared = 0, equal = 0, structure = 0, room = 0, same_room = 0;
      for (const auto [u, v] : Pixels(sensor.depth)) {
        if (IsEdge(truth.labels, truth.depth, u, v)) continue;
        // Occluders and tripods may stand before the structure, not the other way round.
        if (truth.labels(u, v) != 0 && sensor.labels(u, v) == 0) continue;
        ++compared;
        structure += truth.labels(u, v) != 0;
        equal +=
            truth.labels(u, v) == sensor.labels(u, v) &&
            (truth.labels(u, v) == 0 || std::abs(truth.depth(u, v) - sensor.depth(u, v)) < 1e-4F);
        if (truth.labels(u, v) != 0 || first.labels(u, v) != 0) continue;
        ++room;
        same_room += std::abs(sensor.depth(u, v) - first.depth(u, v)) < 1e-3F;
      }
      EXPECT_GT(structure, 3000);
      EXPECT_GT(static_cast<double>(equal) / compared, 0.9995);
      EXPECT_GT(room, 20000);
      EXPECT_GT(static_cast<double>(same_room) / room, 0.99);
    }
  }
  const Pose level = FirstFromPlacement(Parse(kTwo + kPlacements).placements[1]);
  const PoseError tilt = ComparePoses(captures[2].first_from_placement, level);
  EXPECT_LT(tilt.rotation_deg, 3);
  EXPECT_LT(tilt.translation_m, 0.05);
  EXPECT_GT(tilt.rotation_deg, 0.05);  // the floor's
}

TEST_F(RigTest, ASensorThatIsMovedStandsElsewhereInThatCaptureAlone) {
  const std::string moved =
      "placements:\n  - {x_cm: 40, z_cm: 10, yaw_deg: 30}\n"
      "  - {x_cm: 40, z_cm: 10, yaw_deg: 30, moved: [{sensor: B, translation_mm: [10, 0, 20], "
      "rotation_deg: [0, 3, 0]}]}\n";
  const std::vector<RigCapture> captures = RenderPlacements(Parse(kTwo + moved), renderer_);
  ASSERT_EQ(captures.size(), 3u);
  const auto pose = [&](std::size_t capture, std::size_t sensor) {
    return captures[capture].sensors[sensor].structure_from_sensor;
  };
  EXPECT_EQ(pose(1, 0).matrix(), pose(2, 0).matrix());
  const Pose before_from_after = pose(1, 1).inverse() * pose(2, 1);
  EXPECT_LT((before_from_after.translation() - Eigen::Vector3d(0.01, 0, 0.02)).norm(), 1e-12);
  EXPECT_LT(
      (RotationLog(before_from_after.linear()) - Eigen::Vector3d(0, 3 * M_PI / 180, 0)).norm(),
      1e-12);
  EXPECT_TRUE(captures[1].sensors[0].labels_clean == captures[2].sensors[0].labels_clean);
  EXPECT_FALSE(captures[1].sensors[1].labels_clean == captures[2].sensors[1].labels_clean);
  EXPECT_THROW(Parse(kTwo + "placements: [{x_cm: 40, moved: [{sensor: nobody}]}]\n"), ConfigError);
}

TEST_F(RigTest, TheFirstCaptureIsThatOfTheRigWithoutPlacements) {
  const std::string alone = "room: false\n" + kTwo;
  const RigCapture one = RenderOne(Parse(alone), renderer_);
  for (const char* errors : {"", "device_errors: redrawn\n"}) {
    const RigCapture first = RenderPlacements(Parse(alone + kPlacements + errors), renderer_)[0];
    for (std::size_t i = 0; i < 2; ++i) {
      EXPECT_TRUE(one.sensors[i].depth == first.sensors[i].depth);
      EXPECT_TRUE(one.sensors[i].labels == first.sensors[i].labels);
      EXPECT_TRUE(one.sensors[i].structure_from_sensor.matrix() ==
                  first.sensors[i].structure_from_sensor.matrix());
    }
  }
}

/// Mean errors of blocks of pixels on what two captures see alike: of depth, or of 1 / z.
struct CommonErrors {
  Tally first, second, product;

  CommonErrors(const CapturedSensor& a, const CapturedSensor& b, bool inverse) {
    constexpr int kBlock = 8, kLeast = 40;
    const auto error = [inverse](const CapturedSensor& s, int u, int v) {
      const double z = s.depth(u, v), true_z = s.depth_clean(u, v);
      return inverse ? 1 / z - 1 / true_z : z - true_z;
    };
    for (int v = 0; v + kBlock <= a.depth.height(); v += kBlock) {
      for (int u = 0; u + kBlock <= a.depth.width(); u += kBlock) {
        Tally of_a, of_b;
        for (int k = 0; k < kBlock * kBlock; ++k) {
          const int x = u + k % kBlock, y = v + k / kBlock;
          if (a.depth(x, y) == 0 || b.depth(x, y) == 0 ||
              IsEdge(a.labels_clean, a.depth_clean, x, y) ||
              std::abs(b.depth_clean(x, y) - a.depth_clean(x, y)) > 1e-3F) {
            continue;
          }
          of_a += error(a, x, y);
          of_b += error(b, x, y);
        }
        if (of_a.count < kLeast) continue;
        first += of_a.Mean();
        second += of_b.Mean();
        product += of_a.Mean() * of_b.Mean();
      }
    }
  }
  double Correlation() const {
    return (product.Mean() - first.Mean() * second.Mean()) /
           std::sqrt(first.Variance() * second.Variance());
  }
  /// Difference of the mean errors.
  double Shift() const { return second.Mean() - first.Mean(); }
};

TEST_F(RigTest, ErrorsOfADevicePersistUnlessTheyAreRedrawn) {
  // Both look at a wall, away from the structure, whose corners have errors that move with it.
  const std::string content =
      "scene: {clutter_count: [0, 0], wall_distance_m: [2.5, 3]}\nseed: 7\nsensors:\n"
      "  - {name: A, sensor: realsense_d415, phi_deg: 180, rho_cm: 120, "
      "look_at_cm: [-600, 30, 20]}\n"
      "  - {name: B, sensor: azure_kinect_nfov_binned, phi_deg: 100, rho_cm: 120, "
      "look_at_cm: [-20, 30, 600]}\n" +
      kPlacements;
  const std::vector<RigCapture> kept = RenderPlacements(Parse(content), renderer_);
  const std::vector<RigCapture> redrawn =
      RenderPlacements(Parse(content + "device_errors: redrawn\n"), renderer_);
  for (std::size_t i = 0; i < 2; ++i) {
    const bool stereo = i == 0;
    for (std::size_t k = 1; k < 3; ++k) {
      const CommonErrors same(kept[0].sensors[i], kept[k].sensors[i], stereo);
      const CommonErrors other(redrawn[0].sensors[i], redrawn[k].sensors[i], stereo);
      EXPECT_GT(same.first.count, 100);
      EXPECT_GT(same.Correlation(), 0.9) << i << " " << k;
      EXPECT_LT(std::abs(other.Correlation()), 0.4) << i << " " << k;
      if (!stereo) {
        EXPECT_LT(std::abs(same.Shift()), 2e-4);
        EXPECT_GT(std::abs(other.Shift()), 5e-4);
      }
      // What does not belong to the device is drawn anew, even where the structure has not moved.
      const DepthImage &a = kept[0].sensors[i].depth, &b = kept[k].sensors[i].depth;
      long both = 0, equal = 0, lost = 0;
      for (std::size_t p = 0; p < a.size(); ++p) {
        both += a[p] > 0 && b[p] > 0;
        equal += a[p] > 0 && a[p] == b[p];
        lost += a[p] > 0 && b[p] == 0;
      }
      EXPECT_LT(equal, 0.8 * static_cast<double>(both));  // of whole millimetres
      EXPECT_GT(lost, 300);
    }
  }
}

TEST_F(RigTest, DrawnPlacementsFillTheDisc) {
  Rig rig = Parse(kTwo);
  Tally squares, turn;
  double largest = 0;
  for (rig.seed = 1; rig.seed <= 60; ++rig.seed) {
    const std::vector<RigPlacement> five = DrawPlacements(rig, 5, 0.8);
    const std::vector<RigPlacement> two = DrawPlacements(rig, 2, 0.8);
    ASSERT_EQ(five.size(), 5u);
    ASSERT_EQ(two.size(), 2u);
    EXPECT_EQ(two[1].x_cm, five[1].x_cm);
    EXPECT_EQ(two[1].yaw_deg, five[1].yaw_deg);
    for (const RigPlacement& placement : five) {
      const double rho = std::hypot(placement.x_cm, placement.z_cm);
      squares += rho * rho;
      largest = std::max(largest, rho);
      turn += placement.yaw_deg;
    }
  }
  EXPECT_LE(largest, 80);
  EXPECT_GT(largest, 75);
  EXPECT_NEAR(squares.Mean(), 80 * 80 / 2.0, 430);  // 4 sigma; uniform over the disc
  EXPECT_NEAR(turn.Mean(), 180, 24);
  // Between two sensors that leave little room, none stands in either.
  rig.sensors[0].rho_cm = rig.sensors[1].rho_cm = 130;
  rig.noise = {"none"};
  rig.placements = DrawPlacements(rig, 5, 0.8);
  EXPECT_NO_THROW(RenderPlacements(rig, renderer_));
  rig.sensors[0].rho_cm = 10;
  ExpectError<ConfigError>([&] { DrawPlacements(rig, 1, 0.05); }, {"0.05 m"});
}

TEST_F(RigTest, NoiseIsAListOfModelsOrOneOfThem) {
  EXPECT_EQ(Parse("noise: paper\n" + kTwo).noise, std::vector<std::string>{"paper"});
  ExpectBad("noise: [paper, nearer]\n" + kTwo, "noise[1] = nearer");
  RegisterNoiseModel("nearer", [](const NoiseInput& input, RandomStream&) {
    NoisyView seen{input.view.depth, input.view.labels};
    for (float& z : seen.depth) z *= 0.5F;
    return seen;
  });
  const auto render = [&](const std::string& noise) {
    return RenderOne(Parse("room: false\nnoise: " + noise + "\n" + kTwo), renderer_);
  };
  const RigCapture once = render("[nearer]"), twice = render("[nearer, none, nearer]");
  for (std::size_t i = 0; i < twice.sensors.size(); ++i) {
    const CapturedSensor& sensor = twice.sensors[i];
    for (const auto [u, v] : Pixels(sensor.depth)) {
      EXPECT_EQ(sensor.depth(u, v), 0.25F * sensor.depth_clean(u, v));
      EXPECT_EQ(once.sensors[i].depth(u, v), 0.5F * sensor.depth_clean(u, v));
    }
  }
  ExpectError<ConfigError>([&] { render("[paper, physics]"); }, {"noise: physics"});
}

TEST_F(RigTest, ShippedRigsAreValid) {
  EXPECT_EQ(ReadRig(ConfigSource::FromFile("configs/rig_ring8.yaml")).sensors.size(), 8u);
  const Rig studio = ReadRig(ConfigSource::FromFile("configs/rig_studio.yaml"));
  EXPECT_EQ(studio.placements.size(), 3u);
  // As its comment says: at the last placement S5 sees no structure, and S3 all of it.
  const RigCapture last = RenderPlacements(studio, renderer_).back();
  EXPECT_EQ(Seen(last.sensors[4].labels_clean), 0);
  EXPECT_GT(Seen(last.sensors[2].labels_clean), 2500);
}

TEST_F(RigTest, AGroupIsSensorsAlikeButForAngleAndHeight) {
  const Rig rig = Parse(
      "sensors: [{name: A}]\ngroups:\n"
      "  - {name: R, rho_cm: 210, phi_deg: [0, 90, 180], height_cm: [90, 110], roll_deg: 0}\n"
      "  - {name: C, phi_deg: [30], height_cm: [80, 105], level: true, image_size: 160x90}\n");
  ASSERT_EQ(rig.sensors.size(), 6u);
  EXPECT_TRUE(rig.groups.empty());
  const std::vector<std::string> names{"A", "R1", "R2", "R3", "C1", "C2"};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(rig.sensors[i].name, names[i]);
  EXPECT_EQ(rig.sensors[3].phi_deg, 180);
  EXPECT_EQ(rig.sensors[2].height_cm, 110);
  EXPECT_EQ(rig.sensors[3].height_cm, 90);  // the shorter list is repeated
  EXPECT_EQ(rig.sensors[1].rho_cm, 210);
  EXPECT_EQ(rig.sensors[1].roll_deg, 0);
  EXPECT_EQ(rig.sensors[5].image_size, "160x90");
  // What was expanded is a rig like any other.
  EXPECT_EQ(Parse(WriteConfig(rig)).sensors.size(), 6u);
  ExpectBad("groups: [{phi_deg: []}]\n", "groups[0] has no sensor");
  ExpectBad("groups: [{rho_cm: 150}, {rho_cm: 200}]\n", "S1 stands twice");
}

TEST_F(RigTest, LevelAxesAreParallel) {
  const Rig rig = Parse("groups: [{phi_deg: [40], height_cm: [80, 155], level: true}]\n");
  for (const RigSensor& sensor : rig.sensors) {
    const Pose pose = RigSensorPose(sensor, 0, -0.81);
    const double phi = 40 * M_PI / 180;
    EXPECT_NEAR((pose.linear().col(2) - Eigen::Vector3d(-std::cos(phi), 0, -std::sin(phi))).norm(),
                0, 1e-12);
    EXPECT_NEAR(pose.translation().y(), -0.81 + 0.01 * sensor.height_cm, 1e-12);
  }
}

TEST_F(RigTest, TurnsAreCapturesWithSeedsOfTheirOwn) {
  const Rig rig = Parse(kTwo + "turns_deg: [0, 45, -30]\n");
  const std::vector<Rig> turns = Turns(rig);
  ASSERT_EQ(turns.size(), 3u);
  EXPECT_EQ(turns[0].structure_yaw_deg, 30);
  EXPECT_EQ(turns[1].structure_yaw_deg, 75);
  EXPECT_EQ(turns[2].structure_yaw_deg, 0);
  EXPECT_EQ(turns[0].seed, 5u);
  EXPECT_EQ(turns[2].seed, 2000005u);
  EXPECT_TRUE(turns[1].turns_deg.empty());
  EXPECT_EQ(Turns(Parse(kTwo)).size(), 1u);
  EXPECT_THROW(RenderPlacements(rig, renderer_), Error);
}

TEST_F(RigTest, EachTurnDrawsWhereSensorsLook) {
  const Rig rig = Parse(kTwo +
                        "turns_deg: [0, 45]\n"
                        "groups: [{phi_deg: [40], height_cm: [80, 155], look_at_cm: [0, 5, 0], "
                        "look_at_radius_cm: 20}]\n");
  const std::vector<Rig> turns = Turns(rig);
  std::set<double> heights;
  for (const Rig& turn : turns) {
    EXPECT_EQ(turn.sensors[0].look_at_cm, rig.sensors[0].look_at_cm);
    for (std::size_t i = 2; i < 4; ++i) {
      const auto [x, y, z] = turn.sensors[i].look_at_cm;
      EXPECT_LE(std::hypot(x, y - 5, z), 20);
      EXPECT_TRUE(heights.insert(y).second);
    }
    EXPECT_EQ(Turns(turn)[0].sensors[2].look_at_cm, turn.sensors[2].look_at_cm);
  }
  EXPECT_EQ(Turns(rig)[1].sensors[3].look_at_cm, turns[1].sensors[3].look_at_cm);
}

/// A file of configs/paper: its sensors with their heights above the floor and distance from the
/// structure, cm.
struct PaperRig {
  std::string file;
  std::size_t captures, sensors;
  std::vector<int> heights;
  int rho;
  double span_deg;  ///< from the first sensor to the last one
};

TEST_F(RigTest, ThePapersSetUpsAreThePapers) {
  std::vector<PaperRig> rigs;
  for (const int rho : {165, 200, 235}) {
    for (const char* array : {"array", "array_level"})
      rigs.push_back({fmt::format("{}_{}", array, rho), 8, 4, {80, 105, 130, 155}, rho, 0});
    for (const int height : {90, 110})
      rigs.push_back({fmt::format("arc_{}_{}", rho, height), 4, 8, {height}, rho, 120});
  }
  for (const std::size_t n : {6, 8}) {
    const std::string cameras = fmt::format("cameras_{}_", n);
    const double span = 360 - 360.0 / static_cast<double>(n);
    rigs.push_back({cameras + "90", 3, n, {90}, 200, span});
    rigs.push_back({cameras + "110", 3, n, {110}, 200, span});
    rigs.push_back({cameras + "alternating", 3, n, {90, 110}, 200, span});
  }
  for (const int height : {90, 100, 130})
    rigs.push_back({fmt::format("cameras_4_{}", height), 1, 4, {height}, 200, 270});
  std::set<std::uint64_t> seeds;
  for (const PaperRig& paper : rigs) {
    SCOPED_TRACE(paper.file);
    const Rig rig = ReadRig(ConfigSource::FromFile("configs/paper/" + paper.file + ".yaml"));
    const bool level = Has(paper.file, "level"), array = Has(paper.file, "array");
    ASSERT_EQ(rig.sensors.size(), paper.sensors);
    const std::vector<Rig> turns = Turns(rig);
    EXPECT_EQ(turns.size(), paper.captures);
    for (const Rig& turn : turns) EXPECT_NE(seeds.insert(turn.seed).second, level);
    EXPECT_NEAR(rig.sensors.back().phi_deg - rig.sensors.front().phi_deg, paper.span_deg, 1e-9);
    for (std::size_t i = 0; i < paper.sensors; ++i) {
      const RigSensor& sensor = rig.sensors[i];
      EXPECT_EQ(sensor.sensor, "realsense_d415");
      EXPECT_EQ(sensor.roll_deg, 90);
      EXPECT_EQ(sensor.rho_cm, paper.rho);
      EXPECT_EQ(sensor.height_cm, paper.heights[i % paper.heights.size()]);
      EXPECT_EQ(sensor.level, level);
      EXPECT_EQ(sensor.look_at_radius_cm, array && !level ? 20 : 0);
    }
  }
  EXPECT_EQ(seeds.size(), 24u + 24u + 18u + 3u);
}

TEST_F(RigTest, ErrorsNameTheSensor) {
  ExpectBad("room: true\n", "sensors");
  ExpectBad("sensors: [{name: A}, {name: A}]\n", "A stands twice");
  ExpectBad("sensors: [{name: -rf}]\n", "begins with -");
  ExpectBad("sensors: [{name: ../A}]\n", "../A");
  // A rig is one capture: its room and structure are there or not.
  ExpectBad("sensors: [{name: A}]\nscene: {room_probability: 0.5}\n", "scene.room_probability");
  ExpectError<IoError>(
      [&] { RenderOne(Parse("structure: none.yaml\nsensors: [{name: A}]\n"), renderer_); },
      {"structure = none.yaml", std::filesystem::current_path().string(),
       "name another file by this key"});
  EXPECT_THROW(RenderOne(Parse("sensors: [{name: A, sensor: lidar}]\n"), renderer_), ConfigError);
  ExpectError<ConfigError>(
      [&] {
        RenderPlacements(Parse("sensors: [{name: A}]\nplacements: [{x_cm: 9}, {x_cm: 170}]\n"),
                         renderer_);
      },
      {"placements[1]", "x_cm: 170", "sensor A"});
  ExpectBad("sensors: [{name: A}]\ndevice_errors: same\n", "persistent");
}

}  // namespace
}  // namespace volalign::rig_test
