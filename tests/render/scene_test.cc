#include "render/scene.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <memory>
#include <set>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/lens.h"
#include "core/geometry/structure.h"
#include "core/geometry/visibility.h"
#include "render/egl/renderers.h"
#include "render/sample.h"
#include "render/scene_mesh.h"
#include "render/subpixels.h"
#include "tests/core/base/pixels.h"
#include "tests/core/base/tally.h"
#include "tests/render/test_scene.h"

namespace volalign::scene_test {
namespace {

class SceneTest : public testing::Test {
 protected:
  SceneTest() : structure_(ReadStructure("configs/structure.yaml")) {}
  Structure structure_;
};

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
      EXPECT_FALSE(std::abs(distance) < 0.1 && Inside(face, eye - distance * face.normal, 1e-5))
          << "object " << face.object << " at the sensor";
    }
  }
  EXPECT_GT(corners, 50'000);
}

/// The number of points on the scene's objects that lie inside boxes which are not drawn.
long PointsInside(const SceneMesh& mesh, const OtherPlacement& place) {
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
      return OtherPlacement{pose, built.structure};
    };
    const std::vector<OtherPlacement> places{place(0.9), place(3.5)};  // the second by the wall
    for (const OtherPlacement& one : places)
      without += PointsInside(BuildScene(config, structure_, options, 5, i), one);
    options.elsewhere = places;
    const SceneMesh mesh = BuildScene(config, structure_, options, 5, i);
    for (const OtherPlacement& one : places) {
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
  for (std::size_t i = 0; i < without.faces.size(); ++i)
    EXPECT_EQ(without.faces[i].corners, with.faces[i].corners);
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
        hit |= Inside(face, eye + t * d, 1e-5);
      }
      EXPECT_TRUE(hit);
    }
  }
}

/// A triangle repeats its last one.
std::vector<Eigen::Vector3d> CornersOf(const SceneFace& face) {
  std::vector<Eigen::Vector3d> corners;
  for (const Eigen::Vector3f& corner : face.corners) corners.push_back(corner.cast<double>());
  return corners;
}

/// Area times the direction in which the corners turn by the right hand.
Eigen::Vector3d AreaVector(const SceneFace& face) {
  const std::vector<Eigen::Vector3d> c = CornersOf(face);
  return 0.5 * (c[2] - c[0]).cross(c[3] - c[1]);
}

/// Of a closed mesh whose normals point outwards, by the divergence theorem.
double Volume(const SceneMesh& mesh) {
  double volume = 0;
  for (const SceneFace& face : mesh.faces) volume += AreaVector(face).norm() * face.offset / 3;
  return volume;
}

/// Planar faces with unit normals and their planes, and as much area to either side.
void ExpectClosed(const SceneMesh& mesh) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const SceneFace& face : mesh.faces) {
    EXPECT_NEAR(face.normal.norm(), 1, 1e-9);
    for (const Eigen::Vector3d& corner : CornersOf(face))
      EXPECT_NEAR(face.normal.dot(corner), face.offset, 1e-6);
    EXPECT_NEAR(std::abs(AreaVector(face).normalized().dot(face.normal)), 1, 1e-5);
    sum += AreaVector(face).norm() * face.normal;
  }
  EXPECT_LT(sum.norm(), 1e-6);
}

TEST(SceneMesh, ABoxIsClosedAndHasItsVolume) {
  Pose pose = Pose::Identity();
  pose.linear() = RotationExp({0.3, -0.5, 0.8});
  pose.translation() = Eigen::Vector3d(1, 2, -3);
  SceneMesh mesh;
  mesh.AppendBox(pose, {0.2, 0.4, 0.6});
  EXPECT_EQ(mesh.faces.size(), 6u);
  ExpectClosed(mesh);
  EXPECT_NEAR(Volume(mesh), 0.2 * 0.4 * 0.6, 1e-6);
  for (const SceneFace& face : mesh.faces) {
    for (const Eigen::Vector3d& corner : CornersOf(face))
      EXPECT_NEAR(
          (pose.inverse() * corner).cwiseAbs().cwiseQuotient(Eigen::Vector3d(0.1, 0.2, 0.3)).sum(),
          3, 1e-5);
  }
}

TEST(SceneMesh, ACylinderIsAPrismOfItsSegments) {
  const Eigen::Vector3d from(0.1, 0.2, 0.3), to(0.4, 1.0, -0.2);
  SceneMesh mesh;
  mesh.AppendCylinder(from, to, 0.25, 8);
  ExpectClosed(mesh);
  const double base = 0.5 * 8 * 0.25 * 0.25 * std::sin(M_PI / 4);
  EXPECT_NEAR(Volume(mesh), base * (to - from).norm(), 1e-6);
}

TEST(SceneMesh, ACapsuleLiesOnTheSurfaceAboutItsAxis) {
  const Eigen::Vector3d from(0.1, 0.2, 0.3), to(0.4, 1.0, -0.2);
  const Eigen::Vector3d axis = (to - from).normalized();
  SceneMesh mesh;
  mesh.AppendCapsule(from, to, 0.25, 12);
  ExpectClosed(mesh);
  const auto from_axis = [&](const Eigen::Vector3d& p) -> Eigen::Vector3d {
    const double along = std::clamp(axis.dot(p - from), 0.0, (to - from).norm());
    return p - (from + along * axis);
  };
  for (const SceneFace& face : mesh.faces) {
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& corner : CornersOf(face)) {
      EXPECT_NEAR(from_axis(corner).norm(), 0.25, 1e-6);
      middle += 0.25 * corner;
    }
    EXPECT_GT(face.normal.dot(from_axis(middle)), 0);  // seen from outside
  }
  SceneMesh ball;
  ball.AppendSphere(from, 0.25, 12);
  ExpectClosed(ball);
  for (const SceneFace& face : ball.faces) {
    for (const Eigen::Vector3d& corner : CornersOf(face))
      EXPECT_NEAR((corner - from).norm(), 0.25, 1e-6);
  }
}

TEST(SceneMesh, AStructureHasItsSidesAndAnObjectForEachBox) {
  const Structure structure = ReadStructure("configs/structure.yaml");
  SceneMesh mesh;
  mesh.BeginObject({});
  mesh.AppendBox(Pose::Identity(), {1, 1, 1});
  mesh.AppendStructure(structure);
  ASSERT_EQ(mesh.objects.size(), 1 + structure.boxes().size());
  EXPECT_FALSE(mesh.objects[0].is_structure);
  ASSERT_EQ(mesh.faces.size(), 6 + structure.sides().size());
  std::set<int> labels;
  for (std::size_t i = 0; i < structure.sides().size(); ++i) {
    const SceneFace& face = mesh.faces[6 + i];
    const Side& side = structure.sides()[i];
    EXPECT_EQ(face.label, side.label);
    EXPECT_EQ(face.object, 1 + side.box);
    EXPECT_TRUE(mesh.objects[static_cast<std::size_t>(face.object)].is_structure);
    EXPECT_LT((face.normal - side.normal).norm(), 1e-9);
    EXPECT_NEAR(AreaVector(face).norm(), 4 * side.half_u * side.half_v, 1e-6);
    for (const Eigen::Vector3d& corner : CornersOf(face))
      EXPECT_LT((side.ClosestPoint(corner) - corner).norm(), 1e-6);
    labels.insert(face.label);
  }
  EXPECT_EQ(labels.size(), 21u);
}

Intrinsics Pinhole() { return {96, 72, 60, 60, 47.5, 35.5, {}}; }

class Boards : public testing::Test {
 protected:
  Structure structure_ = ReadStructure("configs/structure.yaml");
  RayTable rays_ = ComputeRays(Pinhole());
  Pose pose_ = LookAt({1.5, 0.5, 1.2}, {0, 0, 0}, 0);
  const std::unique_ptr<DepthRenderer> renderer_ = ChooseRenderers(RendererKind::kCpu).make();
};

TEST_F(Boards, HideTheShareThatLiesFarthestToTheirSide) {
  const ExpectedView view = CastView(structure_, rays_, pose_);
  for (const BoardEdge edge : {BoardEdge::kLeft, BoardEdge::kRight, BoardEdge::kBelow}) {
    for (const double share : {0.2, 0.7}) {
      SCOPED_TRACE(static_cast<int>(edge) + share);
      SceneMesh mesh;
      AppendBoard(structure_, rays_, pose_, share, edge, &mesh);
      ASSERT_EQ(mesh.faces.size(), 6u);
      double lowest = 1;
      for (const SceneFace& face : mesh.faces) {
        for (const Eigen::Vector3f& corner : face.corners)
          lowest = std::min(lowest, static_cast<double>(corner.y()));
      }
      mesh.AppendStructure(structure_);
      RenderedView drawn;
      renderer_->Render(mesh, Pinhole(), pose_, &drawn);
      EXPECT_NEAR(lowest, structure_.FloorHeight(), 1e-5);  // it stands on the floor
      int hidden = 0, seen = 0;
      double u_hidden = 0, u_seen = 0, v_hidden = 0, v_seen = 0;
      for (const auto [u, v] : Pixels(rays_.width, rays_.height)) {
        if (view.labels(u, v) == 0) continue;
        const bool hides = drawn.labels(u, v) == 0;
        (hides ? hidden : seen) += 1;
        (hides ? u_hidden : u_seen) += u;
        (hides ? v_hidden : v_seen) += v;
      }
      EXPECT_NEAR(hidden, share * (hidden + seen), 0.05 * (hidden + seen));
      ASSERT_GT(hidden, 0);
      ASSERT_GT(seen, 0);
      // In a levelled picture; v points down.
      const double right = u_hidden / hidden - u_seen / seen;
      const double down = v_hidden / hidden - v_seen / seen;
      if (edge == BoardEdge::kLeft) {
        EXPECT_LT(right, -3);
      }
      if (edge == BoardEdge::kRight) {
        EXPECT_GT(right, 3);
      }
      if (edge == BoardEdge::kBelow) {
        EXPECT_GT(down, 3);
      }
    }
  }
}

TEST_F(Boards, ASensorThatSeesNoStructureHasNone) {
  SceneMesh mesh;
  AppendBoard(structure_, rays_, LookAt({1.5, 0.5, 1.2}, {3, 0.5, 3}, 0), 0.5, BoardEdge::kLeft,
              &mesh);
  EXPECT_TRUE(mesh.faces.empty());
  EXPECT_TRUE(mesh.objects.empty());
}

/// The paper's stack alone, from `eye`.
struct Seen {
  Intrinsics k{160, 144, 126, 126, 79.5, 71.5, {}};
  Pose pose;
  SceneMesh mesh;
  RenderedView view;
  Structure structure = ReadStructure("configs/structure.yaml");
  std::string sensor = "azure_kinect";

  explicit Seen(const Eigen::Vector3d& eye) : pose(LookAt(eye, {0, 0, 0}, 0)) {
    mesh.AppendStructure(structure);
    for (SceneObject& object : mesh.objects) object.is_structure = true;
    const std::unique_ptr<DepthRenderer> owned = GlRenderers()();
    DepthRenderer& renderer = *owned;
    renderer.Render(mesh, k, pose, &view);
  }
  NoiseInput Input() const { return {view, mesh, structure, k, pose, sensor}; }
};

TEST(Subpixels, FindsTheFacesOfPixelsAlongTheirRays) {
  const Seen seen({1.4, 0.3, 1.4});
  const Subpixels subpixels(seen.Input());
  int shown = 0, found = 0;
  for (const auto [u, v] : Pixels(seen.k.width, seen.k.height)) {
    const int face = seen.view.faces(u, v) - 1;
    if (face < 0) continue;
    ++shown;
    const Eigen::Vector3f ray = subpixels.Ray(u, v);
    found += subpixels.FaceAlong(ray, u, v) == face;
    EXPECT_NEAR(subpixels.Depth(face, ray), seen.view.depth(u, v), 0.03);
  }
  EXPECT_GT(shown, 2000);
  // Pixels whose centre lies on an edge, to rounding, may be either face's.
  EXPECT_GE(found, shown - 3);
}

TEST(Subpixels, ASideBulgesAlikeForAllWhoSeeIt) {
  const Seen seen({1.4, 0.3, 1.4}), from_elsewhere({1.7, -0.1, 1.1});
  const Subpixels a(seen.Input()), b(from_elsewhere.Input());
  ASSERT_EQ(seen.mesh.faces.size(), from_elsewhere.mesh.faces.size());
  int bulged = 0;
  for (int i = 0; i < static_cast<int>(seen.mesh.faces.size()); ++i) {
    EXPECT_EQ(a.face(i).bulge, b.face(i).bulge);
    EXPECT_LT(std::abs(a.face(i).bulge), 0.01F);
    bulged += a.face(i).bulge != 0;
    // In the middle, towards the sensor where it is outwards, and not at the border.
    const SeenFace& face = a.face(i);
    if (!(face.height > 0.1F)) continue;
    const Eigen::Vector3f middle = face.corner + 0.5F * (face.along_u + face.along_v);
    if (!(middle.z() > 0.1F)) continue;
    EXPECT_NEAR(face.normal.dot(a.Depth(i, middle / middle.z()) * middle / middle.z() - middle),
                face.bulge, 1e-4);
    const Eigen::Vector3f border = face.corner + 0.5F * face.along_u;
    EXPECT_NEAR(a.Depth(i, border / border.z()), border.z(), 1e-4);
  }
  EXPECT_GT(bulged, 10);
}

}  // namespace
}  // namespace volalign::scene_test
