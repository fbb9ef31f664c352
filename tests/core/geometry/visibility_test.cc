#include "core/geometry/visibility.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/frame_errors.h"
#include "core/geometry/kd_tree.h"
#include "core/geometry/lens.h"
#include "core/geometry/sensor_kind.h"
#include "core/geometry/structure.h"
#include "tests/core/base/long_tests.h"
#include "tests/core/base/pixels.h"
#include "tests/core/geometry/mesh_shapes.h"

namespace volalign::visibility_test {
namespace {

using Eigen::Vector3d;

Structure PaperStructure() { return ReadStructure("configs/structure.yaml"); }

// Boxes that stand askew are compared with meshes in part_mesh_test.
TEST(CastRay, ClosedForms) {
  const Structure box = Structure::FromBoxes("s", {Box::FromMinMax("a", {-1, -1, -1}, {1, 1, 1})});
  const auto cast = [&](const Vector3d& o, const Vector3d& d) { return CastRay(box, o, d); };
  const auto name = [&](const RayHit& hit) {
    return hit.side < 0 ? std::string("none")
                        : box.sides()[static_cast<std::size_t>(hit.side)].name;
  };
  // Along the axes, with zero components in the direction.
  for (const Side& side : box.sides())
    EXPECT_EQ(name(cast(5 * side.normal, -side.normal)), side.name);
  EXPECT_DOUBLE_EQ(cast({5, 0.2, 0}, {-2, 0, 0}).t, 2);
  EXPECT_EQ(name(cast({5, 0, 0}, {1, 0, 0})), "none");   // behind
  EXPECT_EQ(name(cast({5, 2, 0}, {-1, 0, 0})), "none");  // passes above, parallel to it
  // The `down` side is solid and has no label.
  const RayHit below = cast({0.3, -5, 0.3}, {0, 1, 0});
  EXPECT_DOUBLE_EQ(below.t, 4);
  EXPECT_EQ(box.sides()[static_cast<std::size_t>(below.side)].label, 0);
}

TEST(CastRay, FromInsideABoxThatBoxIsNotSeen) {
  const Structure two = Structure::FromBoxes("s", {Box::FromMinMax("a", {-1, -1, -1}, {1, 1, 1}),
                                                   Box::FromMinMax("b", {3, -1, -1}, {4, 1, 1})});
  EXPECT_EQ(CastRay(two, {0, 0, 0}, {-1, 0, 0}).side, -1);
  const RayHit hit = CastRay(two, {0, 0, 0}, {1, 0, 0});
  ASSERT_GE(hit.side, 0);
  EXPECT_EQ(two.sides()[static_cast<std::size_t>(hit.side)].name, "b/back");
  EXPECT_DOUBLE_EQ(hit.t, 3);
}

// Tiles of rays are compared with boxes together: also at the corners of a strong lens, where some
// pixels have no ray, with many boxes, within their bounding sphere, and away from them.
TEST(CastView, IsWhatItsRaysHit) {
  RayTable rays = ComputeRays({43, 37, 30, 30, 21.2, 17.9, {-0.2, 0.05, 0, 0}});
  rays.rays.front() = rays.rays[500].setConstant(std::numeric_limits<float>::quiet_NaN());
  const auto count_hits = [&](const Structure& structure, const Pose& pose) {
    const ExpectedView view = CastView(structure, rays, pose);
    int hits = 0;
    for (const auto [u, v] : Pixels(rays.width, rays.height)) {
      const Vector3d ray(rays.at(u, v).x(), rays.at(u, v).y(), 1);
      const RayHit hit = CastRay(structure, pose.translation(), pose.linear() * ray);
      const bool any = hit.side >= 0;
      EXPECT_NEAR(view.depth(u, v), any ? hit.t : 0, 1e-6) << u << ", " << v;
      EXPECT_EQ(view.labels(u, v),
                any ? structure.sides()[static_cast<std::size_t>(hit.side)].label : 0);
      hits += any;
    }
    return hits;
  };
  std::vector<Box> tower;
  for (int i = 0; i < kMaxBoxes; ++i) {
    const double x = 0.05 * (i % 3);
    tower.push_back(
        Box::FromMinMax("b" + std::to_string(i), {x, 0.1 * i, 0}, {x + 0.4, 0.1 * (i + 1), 0.3}));
  }
  for (const double height : {0.3, 2.5, 5.4})
    EXPECT_GT(count_hits(Structure::FromBoxes("tower", tower),
                         LookAt({1.1, height, 0.9}, {0.2, height, 0.1}, 0.3)),
              100);
  RandomStream random(4, 0, "views");
  for (std::uint64_t i = 0; i < 12; ++i) {
    const double phi = random.Uniform(0, 6.28), rho = random.Uniform(1.0, 3.0);
    const Vector3d position(rho * std::cos(phi), random.Uniform(-0.7, 0.9), rho * std::sin(phi));
    EXPECT_GT(count_hits(mesh_shapes::RandomCuboids(i),
                         LookAt(position, {0, 0, 0}, random.Uniform(-3, 3))),
              20);
  }
  const Structure paper = PaperStructure();
  EXPECT_GT(count_hits(paper, LookAt({0.4, 0.3, 0.4}, {0, 0, 0}, 0.4)), 100);
  EXPECT_EQ(count_hits(paper, LookAt({2, 0.3, 0.4}, {4, 0, 0}, 0)), 0);
  EXPECT_GT(count_hits(paper, LookAt({0.9, 0, -1}, {0.9, 0.1, 2}, 0)), 5);  // at the border only
}

/// Boxes at random yaws that stand on each other, hang over and stick into each other.
Structure RandomStack(std::uint64_t index) {
  RandomStream random(1, index, "stack");
  std::vector<Box> boxes;
  for (int b = 0; b < 4; ++b) {
    Box& box = boxes.emplace_back();
    box.name = "box" + std::to_string(b);
    box.size = {random.Uniform(0.2, 0.6), 0.3 + 0.01 * b, random.Uniform(0.2, 0.6)};
    const double foot = b < 2 ? 0 : 0.3;
    box.structure_from_box.translation() =
        Vector3d{random.Uniform(-0.2, 0.2), foot + box.size.y() / 2, random.Uniform(-0.2, 0.2)};
    box.structure_from_box.linear() = RotationExp({0, random.Uniform(-1, 1), 0});
  }
  return Structure::FromBoxes("random", boxes);
}

// The grid looks each of its points up in the other boxes; what a Side says of its exposed part is
// cut out in polygons.
TEST(SampleExposedSurface, CountTimesCellIsTheExposedArea) {
  std::vector<Pose> offsets(4, Pose::Identity());
  offsets[1].linear() = RotationExp({0, 0.1, 0});
  offsets[3].linear() = RotationExp({0, -0.2, 0});
  std::vector<Structure> structures = {PaperStructure(), PaperStructure().Displaced(offsets, 1.01)};
  for (std::uint64_t i = 0; i < Rounds(2, 6); ++i) structures.push_back(RandomStack(i));
  for (const Structure& structure : structures) {
    for (const double spacing : {0.002, 0.02}) {
      SCOPED_TRACE(spacing);
      std::vector<Vector3d> sums(structure.sides().size(), Vector3d::Zero());
      std::vector<double> counts(structure.sides().size());
      for (const auto& p : SampleExposedSurface(structure, spacing)) {
        const SurfaceDistance distance = DistanceToSurface(structure, p);
        EXPECT_LT(distance.distance, 1e-9);
        sums[static_cast<std::size_t>(distance.side)] += p;
        ++counts[static_cast<std::size_t>(distance.side)];
        // No box holds the point just above it: whatever looks at it from there sees it.
        const Side& side = structure.sides()[static_cast<std::size_t>(distance.side)];
        for (const Box& box : structure.boxes()) {
          const Vector3d q = box.structure_from_box.inverse() * Vector3d(p + 2e-3 * side.normal);
          EXPECT_FALSE((q.cwiseAbs().array() < box.size.array() / 2 - 1e-3).all()) << side.name;
        }
      }
      double total = 0, area = 0;
      for (std::size_t i = 0; i < sums.size(); ++i) {
        const Side& side = structure.sides()[i];
        if (side.face() == Face::kDown) {
          EXPECT_EQ(counts[i], 0) << side.name;
          continue;
        }
        total += counts[i] * spacing * spacing;
        area += side.exposed_area;
        const double u = 2 * side.half_u, v = 2 * side.half_v;
        const double cell = u / std::round(u / spacing) * v / std::round(v / spacing);
        EXPECT_NEAR(counts[i] * cell, side.exposed_area, spacing) << side.name;
        // First moments: the centroid of a sliver says little.
        const Vector3d moment = cell * (sums[i] - counts[i] * side.centre),
                       expected = side.exposed_area * (side.exposed_centroid - side.centre);
        EXPECT_LT((moment - expected).norm(), spacing / 2) << side.name;
      }
      EXPECT_NEAR(total, area, 0.01 * area);
    }
  }
}

const Side& SideNamed(const Structure& structure, const std::string& name) {
  for (const Side& side : structure.sides()) {
    if (side.name == name) return side;
  }
  throw std::runtime_error(name);
}

TEST(SeamDistance, IsToWhereSurfacesMeetAtAnInwardCorner) {
  const Structure structure = ReadStructure("configs/structure.yaml");
  const auto side = [&](const char* name) -> const Side& { return SideNamed(structure, name); };
  // The bottom box's front stands on the floor (y = -0.81).
  const Side& front = side("bottom/front");
  for (const double height : {0.0, 0.15, 0.36})
    EXPECT_NEAR(SeamDistance(structure, front, {0.275, -0.81 + height, 0}), height, 1e-9);
  // On its top, beside the next box, which ends at x = 0.05.
  EXPECT_NEAR(SeamDistance(structure, side("bottom/up"), {0.11, -0.405, 0}), 0.06, 1e-9);
  // The top box's front: the bottom box rises before it, and ends at y = -0.405. Before its top,
  // nothing does.
  EXPECT_NEAR(SeamDistance(structure, side("top/front"), {0.05, 0.6, 0}), 1.005, 1e-9);
  EXPECT_EQ(SeamDistance(structure, side("top/up"), {0.05, 0.81, 0}), kNoSeam);
}

// A point at 4 m of a stereo camera, whose errors grow with the square of the depth.
TEST(FrameErrors, GrowFromTheMiddleOfThePicture) {
  const DepthErrorModel errors = ErrorsOf("realsense_d415");
  const Eigen::Vector3d p(1.2, -0.8, 4), faced = -p.normalized();
  const FrameErrorVector at = FrameErrorsAt(errors, p, faced);
  EXPECT_TRUE(at.head<2>().isApprox(4 * Eigen::Vector2d(0.3, -0.2), 1e-12)) << at.transpose();
  EXPECT_TRUE(FrameErrorsAt(errors, {0, 0, 4}, -Eigen::Vector3d::UnitZ()).isZero());
  const FrameErrorVector sigmas = FrameErrorSigmas(errors);
  EXPECT_EQ(sigmas[kTiltRows], errors.tilt_m);
  EXPECT_EQ(sigmas[kTiltColumns], errors.tilt_m);
  EXPECT_EQ(sigmas[kShear], errors.shear_m);
  EXPECT_EQ(sigmas[kDiffuseMultipath], 0);
  const DepthErrorModel tof = ErrorsOf("azure_kinect_nfov_binned");
  EXPECT_NEAR(FrameErrorSigmas(tof)[kDiffuseMultipath], 2 / std::sqrt(3) * tof.bounce_m, 1e-12);
}

// Two pictures of a texture without direction on a slanted plane, of which the right one is a row
// fraction lower: the shift along the row that makes them most alike, in least squares of the
// brightness: over many points and directions, -d sum(g_x g_y) / sum(g_x g_x).
TEST(FrameErrors, ShearIsTheShiftThatMatchesRowsThatDoNotMeet) {
  DepthErrorModel errors;
  errors.smooth_rad = errors.seam_reach_m = errors.bounce_reach_m = 1;
  RandomStream random(3, 0, "shear");
  for (int trial = 0; trial < 20; ++trial) {
    const Eigen::Vector3d ray(random.Uniform(-0.5, 0.5), random.Uniform(-0.4, 0.4), 1);
    const Eigen::Vector3d normal =
        Eigen::Vector3d(random.Normal(0, 0.4), random.Normal(0, 0.4), -1).normalized();
    const Eigen::Vector3d along_u = normal.unitOrthogonal(), along_v = normal.cross(along_u);
    const Eigen::Vector3d p = 2 * ray;
    const auto on_plane = [&](double x, double y) -> Eigen::Vector2d {
      const Eigen::Vector3d other(ray.x() + x, ray.y() + y, 1);
      const Eigen::Vector3d q = normal.dot(p) / normal.dot(other) * other;
      return {along_u.dot(q), along_v.dot(q)};
    };
    constexpr double kStep = 1e-5;
    const Eigen::Vector2d by_x = (on_plane(kStep, 0) - on_plane(-kStep, 0)) / (2 * kStep);
    const Eigen::Vector2d by_y = (on_plane(0, kStep) - on_plane(0, -kStep)) / (2 * kStep);
    double xy = 0, xx = 0;
    for (int k = 0; k < 360; ++k) {  // a gradient of every direction on the plane
      const Eigen::Vector2d gradient(std::cos(k * M_PI / 180), std::sin(k * M_PI / 180));
      xy += gradient.dot(by_x) * gradient.dot(by_y);
      xx += gradient.dot(by_x) * gradient.dot(by_x);
    }
    EXPECT_NEAR(FrameErrorsAt(errors, p, normal)[kShear], xy / xx, 1e-6);
  }
}

TEST(DiffuseMultipathShare, IsMostAtItsReachAndGrowsWithTheSlant) {
  const Structure structure = ReadStructure("configs/structure.yaml");
  const Side& front = SideNamed(structure, "bottom/front");
  const double floor = structure.FloorHeight();
  const auto share = [&](double height, const Eigen::Vector3d& eye) {
    return DiffuseMultipathShare(structure, front, {0.275, floor + height, 0}, eye, 0.2);
  };
  // From afar at 45 deg, where floor and side are lit and seen alike, and cosines cancel out.
  const Eigen::Vector3d afar = 1e6 * Eigen::Vector3d(1, 1, 0);
  EXPECT_EQ(share(0, afar), 0) << "both ways are as long at the seam";
  EXPECT_NEAR(share(0.2, afar), 1, 1e-3);
  for (const double height : {0.05, 0.15, 0.25, 0.4}) EXPECT_LT(share(height, afar), 0.99);
  EXPECT_NEAR(share(0.1, afar), 0.5 * std::exp(0.5), 1e-3);
  // The floor is lit by the sine of the sensor's elevation, the side is seen at the cosine.
  const double low = M_PI / 9;
  EXPECT_NEAR(share(0.2, 1e6 * Eigen::Vector3d(std::cos(low), std::sin(low), 0)), std::tan(low),
              1e-3);
  // A lamp below the floor lights none of it, and a side is seen at kGrazing at the least.
  EXPECT_EQ(share(0.2, {1e6, -1e6, 0}), 0);
  EXPECT_NEAR(share(0.2, {0.275, 1000, 0}), 1 / kGrazing, 1e-2);
}

TEST(DiffuseMultipathShare, AddsWhatTheFloorAndBoxesThrow) {
  const Structure structure = ReadStructure("configs/structure.yaml");
  // Before the front of the second box the first one rises, and is lit from above alone; the floor
  // is 40 cm below it.
  const Side& front = SideNamed(structure, "mid_bottom/front");
  const Eigen::Vector3d q(0.05, -0.405 + 0.15, 0), eye(1000, 1000, 0);
  const double floor = 0.555 / 0.2 * std::exp(1 - 0.555 / 0.2);
  EXPECT_NEAR(DiffuseMultipathShare(structure, front, q, eye, 0.2), 1 + floor, 1e-3);
  // The floor has light of the box that stands on it, and a top none where nothing rises.
  EXPECT_NEAR(
      DiffuseMultipathShare(structure, FloorOf(structure), {0.275 + 0.15, -0.81, 0}, eye, 0.2), 1,
      0.05);
  EXPECT_EQ(
      DiffuseMultipathShare(structure, SideNamed(structure, "top/up"), {0.05, 0.81, 0}, eye, 0.2),
      0);
  // A top before a box has more than the floor has there.
  const Side top = SideNamed(structure, "bottom/up");
  Side floor_there = top;
  floor_there.box = -1;
  const Eigen::Vector3d before(0.05 + 0.15, -0.405, 0);
  const double share = DiffuseMultipathShare(structure, floor_there, before, eye, 0.2);
  EXPECT_NEAR(share, 1, 0.01);
  EXPECT_NEAR(DiffuseMultipathShare(structure, top, before, eye, 0.2), 1.3 * share, 1e-9);
}

std::vector<Eigen::Vector3d> RandomPoints(std::uint64_t seed, int count) {
  RandomStream random(seed, 0, "points");
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < count; ++i)
    points.emplace_back(random.Normal(), random.Normal(), random.Normal());
  return points;
}

TEST(KdTree, FindsWhatASearchThroughAllPointsFinds) {
  const std::vector<Eigen::Vector3d> points = RandomPoints(1, 500);
  KdTree moved = KdTree(RandomPoints(2, 3));
  moved = KdTree(points);
  const KdTree tree = std::move(moved);
  for (const Eigen::Vector3d& p : RandomPoints(3, 200)) {
    double least = std::numeric_limits<double>::infinity();
    int nearest = -1;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double squared = (points[i] - p).squaredNorm();
      if (squared < least) {
        least = squared;
        nearest = static_cast<int>(i);
      }
    }
    EXPECT_EQ(tree.Nearest(p).index, nearest);
    EXPECT_DOUBLE_EQ(tree.Nearest(p).squared_distance, least);
    EXPECT_EQ(tree.Nearest(p, 1.001 * std::sqrt(least)).index, nearest);
    EXPECT_EQ(tree.Nearest(p, 0.999 * std::sqrt(least)).index, -1);
  }
}

TEST(KdTree, APointAtTheLargestDistanceIsNearAndNothingHasNoNeighbour) {
  EXPECT_EQ(KdTree({Eigen::Vector3d(3, 0, 4)}).Nearest(Eigen::Vector3d::Zero(), 5).index, 0);
  EXPECT_EQ(KdTree({}).Nearest(Eigen::Vector3d::Zero()).index, -1);
}

}  // namespace
}  // namespace volalign::visibility_test
