#include "render/scene_mesh.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <set>

namespace volalign::scene_mesh_test {
namespace {

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

}  // namespace
}  // namespace volalign::scene_mesh_test
