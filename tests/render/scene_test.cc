#include "render/scene.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/structure.h"
#include "render/pose_sampler.h"
#include "tests/core/base/tally.h"

namespace volalign::scene_test {
namespace {

/// Whether a point of the face's plane lies in the polygon: all its edges turn the same way around
/// it.
bool Inside(const SceneFace& face, const Eigen::Vector3d& p) {
  int left = 0, right = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d a = face.corners[k].cast<double>();
    const Eigen::Vector3d b = face.corners[(k + 1) % 4].cast<double>();
    const double side = face.normal.dot((b - a).cross(p - a));
    left += side > -1e-5;
    right += side < 1e-5;
  }
  return left == 4 || right == 4;
}

class SceneTest : public testing::Test {
 protected:
  SceneTest() : structure_(ReadStructure("configs/structure.yaml")) {}
  Structure structure_;
};

TEST_F(SceneTest, ExactAssemblyIsTheNominalStructure) {
  const AssembledStructure built = Assemble(structure_, {0, 0, 0}, 3, 4);
  EXPECT_EQ(built.structure.Hash(), structure_.Hash());
  EXPECT_EQ(built.size_scale, 1);
  for (const Pose& offset : built.box_offsets) {
    EXPECT_TRUE(offset.matrix().isApprox(Eigen::Matrix4d::Identity(), 1e-12));
  }
}

TEST_F(SceneTest, ImpreciseAssemblyStaysStackedAndHasItsSpread) {
  Tally x, scale;
  for (std::uint64_t i = 0; i < 400; ++i) {
    const AssembledStructure built = Assemble(structure_, {4, 1, 0.5}, 3, i);
    double top = structure_.FloorHeight();
    for (std::size_t b = 0; b < built.box_offsets.size(); ++b) {
      const Box& box = built.structure.boxes()[b];
      const Pose& pose = box.structure_from_box;
      EXPECT_NEAR(pose.translation().y() - 0.5 * box.size.y(), top, 1e-9);
      EXPECT_NEAR(pose.linear()(1, 1), 1, 1e-12);  // turned about the vertical alone
      top = pose.translation().y() + 0.5 * box.size.y();
      x += pose.translation().x() - structure_.boxes()[b].structure_from_box.translation().x();
    }
    scale += built.size_scale - 1;
  }
  EXPECT_NEAR(x.Rms(), 0.004, 0.0004);
  EXPECT_NEAR(scale.Rms(), 0.005, 0.0008);
}

TEST_F(SceneTest, ObjectsKeepClearOfStructureAndSensor) {
  SceneConfig config;
  config.distractor_probability = 1;
  config.clutter_count = {10, 20};
  long corners = 0;
  for (std::uint64_t i = 0; i < 100; ++i) {
    RandomStream random(5, i, "pose");
    SceneOptions options;
    options.structure_from_sensors = {SamplePose(PoseConfig(), random)};
    const Eigen::Vector3d eye = options.structure_from_sensors[0].translation();
    config.occluder_probability = 0;
    const SceneMesh mesh = BuildScene(config, structure_, options, 5, i);
    for (const SceneFace& face : mesh.faces) {
      if (mesh.objects[static_cast<std::size_t>(face.object)].is_structure) continue;
      for (const Eigen::Vector3f& c : face.corners) {
        EXPECT_GT((c.cast<double>() - eye).norm(), 0.09);
        // No corner of an object inside a box, grown by the clearance sideways.
        for (const Box& box : structure_.boxes()) {
          const Eigen::Vector3d d =
              (c.cast<double>() - box.structure_from_box.translation()).cwiseAbs() - 0.5 * box.size;
          EXPECT_FALSE(d.x() < 0.049 && d.z() < 0.049 && d.y() < -1e-6)
              << "object " << face.object << " at " << c.transpose();
        }
        ++corners;
      }
      const double distance = face.normal.dot(eye) - face.offset;
      EXPECT_FALSE(std::abs(distance) < 0.1 && Inside(face, eye - distance * face.normal))
          << "object " << face.object << " at the sensor";
    }
  }
  EXPECT_GT(corners, 50'000);
}

/// The number of points on the scene's objects that lie inside boxes which are not drawn.
long PointsInside(const SceneMesh& mesh, const StructureElsewhere& place) {
  constexpr int kSteps = 12;
  constexpr double kSkin = 1e-3;  // m, boxes stand on the floor
  const Pose elsewhere_from_structure = place.structure_from_elsewhere.inverse();
  long inside = 0;
  for (const SceneFace& face : mesh.faces) {
    if (mesh.objects[static_cast<std::size_t>(face.object)].is_structure) continue;
    for (int i = 0; i < kSteps * kSteps; ++i) {
      const int row = i / kSteps, column = i % kSteps;
      const float s = static_cast<float>(column) / (kSteps - 1);
      const float t = static_cast<float>(row) / (kSteps - 1);
      const Eigen::Vector3f p = (1 - t) * ((1 - s) * face.corners[0] + s * face.corners[1]) +
                                t * ((1 - s) * face.corners[3] + s * face.corners[2]);
      const Eigen::Vector3d there = elsewhere_from_structure * p.cast<double>();
      for (const Box& box : place.structure.boxes()) {
        const Eigen::Vector3d d = (box.structure_from_box.inverse() * there).cwiseAbs();
        inside += ((d - 0.5 * box.size).array() < -kSkin).all();
      }
    }
  }
  return inside;
}

TEST_F(SceneTest, NothingStandsWhereTheStructureWillStand) {
  SceneConfig config;
  config.distractor_probability = 1;
  config.clutter_count = {10, 20};
  config.tripod_count = {0, 4};
  long without = 0;
  for (std::uint64_t i = 0; i < 30; ++i) {
    RandomStream random(5, i, "pose");
    SceneOptions options;
    options.structure_from_sensors = {SamplePose(PoseConfig(), random)};
    const AssembledStructure built = Assemble(structure_, {3, 1, 1, 0}, 6, i);
    const auto place = [&](double radius) {
      const double angle = random.Uniform(0, 6.28);
      Pose pose(Eigen::AngleAxisd(random.Uniform(0, 6.28), Eigen::Vector3d::UnitY()));
      pose.translation() = Eigen::Vector3d(radius * std::cos(angle), 0, radius * std::sin(angle));
      return StructureElsewhere{pose, built.structure};
    };
    const std::vector<StructureElsewhere> places{place(0.9), place(3.5)};  // the second by the wall
    for (const StructureElsewhere& one : places) {
      without += PointsInside(BuildScene(config, structure_, options, 5, i), one);
    }
    options.elsewhere = places;
    const SceneMesh mesh = BuildScene(config, structure_, options, 5, i);
    for (const StructureElsewhere& one : places) {
      EXPECT_EQ(PointsInside(mesh, one), 0) << i;
      for (const SceneFace& face : mesh.faces) {
        // Walls, which face inwards, have the whole structure before them.
        const bool wall = std::abs(face.normal.y()) < 0.5 &&
                          std::abs(face.corners[0].y() - face.corners[2].y()) > 2.3F;
        if (!wall || mesh.objects[static_cast<std::size_t>(face.object)].is_structure) continue;
        if ((face.corners[0] - face.corners[1]).norm() < 3) continue;
        for (const Box& box : one.structure.boxes()) {
          const Eigen::Vector3d p =
              one.structure_from_elsewhere * box.structure_from_box.translation();
          EXPECT_GT(face.normal.dot(p) - face.offset, 0.2) << i;
        }
      }
    }
  }
  EXPECT_GT(without, 100);  // else this test shows nothing
}

TEST_F(SceneTest, MovedStructureLeavesTheRoomWhereItIs) {
  SceneConfig config;
  config.clutter_count = {5, 5};
  SceneOptions options;
  options.structure_from_sensors = {LookAt({2, 0.3, 0}, {0, 0, 0}, 0)};
  const SceneMesh scene = BuildScene(config, structure_, options, 5, 1);
  Pose first_from_new(Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitY()));
  first_from_new.translation() = Eigen::Vector3d(0.5, 0, -0.3);
  const Structure built = Assemble(structure_, {3, 1, 0, 0}, 5, 2).structure;
  SceneMesh alone;
  alone.AppendStructure(built);
  const SceneMesh moved = MoveStructure(scene, built, first_from_new.inverse());
  ASSERT_EQ(moved.faces.size(), scene.faces.size());
  ASSERT_EQ(moved.objects.size(), scene.objects.size());
  for (std::size_t i = 0; i < scene.faces.size(); ++i) {
    const SceneFace &before = scene.faces[i], &after = moved.faces[i];
    if (scene.objects[static_cast<std::size_t>(before.object)].is_structure) {
      EXPECT_EQ(after.corners, alone.faces.at(i).corners);
      continue;
    }
    EXPECT_EQ(moved.objects[static_cast<std::size_t>(after.object)].reflectivity,
              scene.objects[static_cast<std::size_t>(before.object)].reflectivity);
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d back = first_from_new * after.corners[k].cast<double>();
      EXPECT_LT((back - before.corners[k].cast<double>()).norm(), 2e-6);
      EXPECT_NEAR(after.normal.dot(after.corners[k].cast<double>()), after.offset, 2e-6);
    }
  }
}

TEST_F(SceneTest, SwitchingOneKindOffLeavesTheOthers) {
  SceneConfig config;
  config.tripod_count = {3, 3};
  config.clutter_count = {0, 0};
  config.distractor_probability = 0;
  SceneOptions options;
  RandomStream random(5, 0, "pose");
  options.structure_from_sensors = {SamplePose(PoseConfig(), random)};
  config.occluder_probability = 0;
  const SceneMesh without = BuildScene(config, structure_, options, 5, 0);
  config.occluder_probability = 1;
  const SceneMesh with = BuildScene(config, structure_, options, 5, 0);
  ASSERT_GT(with.faces.size(), without.faces.size());
  for (std::size_t i = 0; i < without.faces.size(); ++i) {
    EXPECT_EQ(without.faces[i].corners, with.faces[i].corners);
  }
}

TEST_F(SceneTest, RoomEnclosesEverything) {
  // Any ray from the sensor ends on something: floor, walls and, where there is none, walls of more
  // than 5 m meet it below 60 deg.
  SceneConfig config;
  config.clutter_count = {0, 0};
  config.tripod_count = {0, 0};
  config.distractor_probability = config.occluder_probability = 0;
  config.ceiling_probability = 1;
  for (std::uint64_t i = 0; i < 20; ++i) {
    RandomStream random(6, i, "pose");
    SceneOptions options;
    options.structure_from_sensors = {SamplePose(PoseConfig(), random)};
    const Eigen::Vector3d eye = options.structure_from_sensors[0].translation();
    const SceneMesh mesh = BuildScene(config, structure_, options, 6, i);
    RandomStream direction_random(7, i, "test");
    for (int ray = 0; ray < 200; ++ray) {
      const Eigen::Vector3d d{direction_random.Normal(), direction_random.Normal(),
                              direction_random.Normal()};
      bool hit = false;
      for (const SceneFace& face : mesh.faces) {
        const double approach = face.normal.dot(d);
        if (approach >= 0) continue;
        const double t = (face.offset - face.normal.dot(eye)) / approach;
        if (t <= 0) continue;
        const Eigen::Vector3d p = eye + t * d;
        hit |= Inside(face, p);
      }
      EXPECT_TRUE(hit);
    }
  }
}

}  // namespace
}  // namespace volalign::scene_test
