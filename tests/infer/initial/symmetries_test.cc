#include "infer/initial/symmetries.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <string>
#include <vector>

#include "core/base/random.h"
#include "tests/core/geometry/mesh_shapes.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::aliases_test {
namespace {

using namespace testing_infer;

/// Boxes of 25 cm on a grid of 5 x 3 x 4 places, of which some stay empty, so that many turns and
/// steps bring most boxes onto boxes.
Structure Grid(int boxes) {
  std::vector<Box> list;
  for (int i = 0; static_cast<int>(list.size()) < boxes; ++i) {
    if (i % 7 == 3) continue;
    const int x = i % 5, y = i / 15, z = i / 5 % 3;
    const Eigen::Vector3d low = 0.25 * Eigen::Vector3d(x, y, z);
    list.push_back(
        Box::FromMinMax("b" + std::to_string(i), low, low + Eigen::Vector3d::Constant(0.25)));
  }
  return Structure::FromBoxes("grid", list);
}

/// Boxes of a few sizes, some of them turned, in any place, some a few millimetres off another's.
Structure Heap(int boxes) {
  RandomStream random(7, 0, "heap");
  std::vector<Box> list;
  for (int i = 0; i < boxes; ++i) {
    Box box;
    box.name = "b" + std::to_string(i);
    box.size = i % 3 == 0 ? Eigen::Vector3d(0.3, 0.4, 0.5) : Eigen::Vector3d(0.3, 0.3, 0.4);
    if (i % 5 == 0) {
      box.structure_from_box.linear() =
          Eigen::AngleAxisd(random.Uniform(0, 2 * M_PI), Eigen::Vector3d::UnitY())
              .toRotationMatrix();
    }
    const auto place = [&] { return 0.4 * random.Below(8) + random.Uniform(-0.012, 0.012); };
    box.structure_from_box.translation() = Eigen::Vector3d(place(), place(), place());
    list.push_back(box);
  }
  return Structure::FromBoxes("heap", list);
}

std::vector<Eigen::Vector3d> CornersOf(const Box& box, const Pose& motion) {
  std::vector<Eigen::Vector3d> corners;
  for (const double x : {-0.5, 0.5}) {
    for (const double y : {-0.5, 0.5}) {
      for (const double z : {-0.5, 0.5})
        corners.push_back(motion *
                          (box.structure_from_box *
                           Eigen::Vector3d(Eigen::Vector3d(x, y, z).cwiseProduct(box.size))));
    }
  }
  return corners;
}

/// Boxes that the motion brings onto a box, by definition.
int CountMoved(const Structure& structure, const Pose& motion) {
  int count = 0;
  for (const Box& box : structure.boxes()) {
    const auto moved = CornersOf(box, motion);
    count += std::any_of(structure.boxes().begin(), structure.boxes().end(), [&](const Box& other) {
      const auto corners = CornersOf(other, Pose::Identity());
      return std::all_of(moved.begin(), moved.end(), [&](const Eigen::Vector3d& p) {
        return std::any_of(corners.begin(), corners.end(),
                           [&](const Eigen::Vector3d& q) { return (p - q).norm() < 0.02; });
      });
    });
  }
  return count;
}

/// Every symmetry by definition: all turns that take the axes to the axes, all pairs of boxes.
std::vector<StructureSymmetry> SymmetriesByDefinition(const Structure& structure) {
  std::vector<StructureSymmetry> symmetries;
  for (int code = 0; code < 6 * 8; ++code) {
    std::array<int, 3> axes{0, 1, 2};
    for (int k = 0; k < code / 8; ++k) std::next_permutation(axes.begin(), axes.end());
    Eigen::Matrix3d turn = Eigen::Matrix3d::Zero();
    for (int k = 0; k < 3; ++k) turn(axes[static_cast<std::size_t>(k)], k) = code >> k & 1 ? -1 : 1;
    if (turn.determinant() < 0) continue;
    for (const Box& from : structure.boxes()) {
      for (const Box& to : structure.boxes()) {
        StructureSymmetry symmetry;
        symmetry.motion.linear() = turn;
        symmetry.motion.translation() =
            to.structure_from_box.translation() - turn * from.structure_from_box.translation();
        const auto known = [&](const Pose& other) {
          return (other.linear() - turn).norm() < 1e-9 &&
                 (other.translation() - symmetry.motion.translation()).norm() < 0.04;
        };
        if (known(Pose::Identity()) ||
            std::any_of(symmetries.begin(), symmetries.end(),
                        [&](const StructureSymmetry& other) { return known(other.motion); }))
          continue;
        symmetry.boxes = CountMoved(structure, symmetry.motion);
        if (2 * symmetry.boxes < static_cast<int>(structure.boxes().size())) continue;
        symmetries.push_back(symmetry);
      }
    }
  }
  std::stable_sort(
      symmetries.begin(), symmetries.end(),
      [](const StructureSymmetry& a, const StructureSymmetry& b) { return a.boxes > b.boxes; });
  return symmetries;
}

TEST(FindSymmetries, AreThoseOfTheStackHoweverItIsTurned) {
  const Structure structure = PaperStructure();
  const Pose turn(Eigen::AngleAxisd(M_PI / 6, Eigen::Vector3d::UnitY()));
  std::vector<Box> boxes = structure.boxes();
  for (Box& box : boxes) box.structure_from_box = turn * box.structure_from_box;
  const Structure turned = Structure::FromBoxes("turned", boxes);
  const std::vector<StructureSymmetry> before = FindSymmetries(structure),
                                       after = FindSymmetries(turned);
  ASSERT_EQ(after.size(), before.size());
  for (const StructureSymmetry& symmetry : before) {
    const Pose motion = turn * symmetry.motion * turn.inverse();
    EXPECT_TRUE(std::any_of(after.begin(), after.end(), [&](const StructureSymmetry& other) {
      return other.motion.isApprox(motion, 1e-6) && other.boxes == symmetry.boxes;
    }));
  }
}

TEST(FindSymmetries, AreThoseOfTheStackAlsoWhereTheFirstBoxIsTurnedALittle) {
  std::vector<Box> boxes = PaperStructure().boxes();
  const std::size_t straight = FindSymmetries(PaperStructure()).size();
  boxes[0].structure_from_box.rotate(Eigen::AngleAxisd(0.06, Eigen::Vector3d::UnitY()));
  const std::size_t askew = FindSymmetries(Structure::FromBoxes("askew", boxes)).size();
  std::rotate(boxes.begin(), boxes.begin() + 1, boxes.end());
  EXPECT_EQ(FindSymmetries(Structure::FromBoxes("last", boxes)).size(), askew);
  EXPECT_GT(askew, 0U);
  EXPECT_LE(askew, straight);
}

TEST(FindSymmetries, AreAllMotionsByDefinition) {
  std::size_t all = 0;
  for (const Structure& structure : {PaperStructure(), Grid(9), Heap(6), Heap(3), Grid(1)}) {
    const std::vector<StructureSymmetry> expected = SymmetriesByDefinition(structure);
    const std::vector<StructureSymmetry> found = FindSymmetries(structure);
    ASSERT_EQ(found.size(), expected.size()) << structure.name();
    for (std::size_t a = 0; a < found.size(); ++a) {
      EXPECT_EQ(found[a].boxes, expected[a].boxes) << structure.name() << " " << a;
      EXPECT_LT((found[a].motion.matrix() - expected[a].motion.matrix()).norm(), 1e-12) << a;
    }
    all += found.size();
  }
  EXPECT_GT(all, 50u);
}

// 51 boxes, the most that labels can name, have 60,000 motions that bring a box onto a box. To try
// each of them with each pair of boxes, as the definition says, takes 250 times as long. Times of
// this process' processor, against each other: neither the machine nor a sanitizer counts.
TEST(FindSymmetries, FiftyOneBoxesTakeFarLessThanToTryEachMotion) {
  double by_definition = 0;
  for (const Structure& structure : {Grid(51), Heap(51)}) {
    const std::clock_t start = std::clock();
    const std::vector<StructureSymmetry> symmetries = FindSymmetries(structure);
    const std::clock_t found = std::clock();
    int tried = 0;
    for (std::size_t a = 0; a < symmetries.size(); a += 1 + symmetries.size() / 100, ++tried)
      EXPECT_EQ(symmetries[a].boxes, CountMoved(structure, symmetries[a].motion))
          << structure.name();
    if (tried > 20) {
      by_definition = 60000. / tried * static_cast<double>(std::clock() - found);
    }
    EXPECT_LT(static_cast<double>(found - start), by_definition / 50) << structure.name();
  }
}

TEST(FindSymmetries, OfMeshes) {
  const auto upright = [](const Structure& structure) {
    int count = 0;
    for (const StructureSymmetry& symmetry : FindSymmetries(structure))
      count += symmetry.keeps_up() ? 1 : 0;
    return count;
  };
  using namespace mesh_shapes;
  EXPECT_EQ(upright(StructureOf(Table())), 1) << "half a turn";
  EXPECT_EQ(upright(StructureOf(Ell())), 0);
  EXPECT_EQ(upright(StructureOf(Stool())), 0);
  const auto drum = [](int segments) {
    return StructureOf({"drum", {Joined("drum", {Cylinder({0.7, 0, 0.2}, 0.3, 0.5, segments)})}});
  };
  EXPECT_EQ(upright(drum(3)), 2);
  EXPECT_EQ(upright(drum(8)), 7);
}

}  // namespace
}  // namespace volalign::aliases_test
