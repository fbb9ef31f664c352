#include "infer/initial/stack_outline.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "tests/infer/initial/geometry_frames.h"

namespace volalign::stack_outline_test {
namespace {

using testing_infer::PaperStructure;
using testing_infer::Standing;

/// A box that is as high as 9 slabs of a third of it, so that nothing is cut.
Structure Crate() {
  return Structure::FromBoxes("crate", {Box::FromMinMax("c", {1, 2, 3}, {1.4, 2.6, 3.32})});
}

TEST(MakeStackOutline, IsAsFineAsTheSmallestBox) {
  const StackOutline outline = MakeStackOutline(Crate());
  EXPECT_NEAR(outline.radius, std::hypot(0.4, 0.32) / 2, 1e-12);
  EXPECT_NEAR(outline.cell, 0.32 / 8, 1e-12);
  EXPECT_NEAR(outline.slab, 0.6 / 3, 1e-12);
  EXPECT_NEAR(outline.yaw_step, outline.cell / outline.radius, 1e-12);
  EXPECT_TRUE(outline.foot.isApprox(Eigen::Vector3d(1.2, 2, 3.16), 1e-12));
  // A slab more than the stack is high, for its top and what is measured a little above it.
  EXPECT_EQ(outline.slabs, 4);
  EXPECT_NEAR(MakeStackOutline(Crate(), 16).cell, 0.32 / 16, 1e-12);
}

TEST(MakeStackOutline, HasLimits) {
  const auto outline = [](const Eigen::Vector3d& size) {
    return MakeStackOutline(Structure::FromBoxes("box", {Standing("b", size, {0, 0, 0})}));
  };
  EXPECT_NEAR(outline({0.9, 2.5, 0.9}).cell, 0.06, 1e-12);
  EXPECT_NEAR(outline({0.9, 2.5, 0.9}).slab, 0.2, 1e-12);
  // 5 m high in 16 slabs; a radius of 2 m in 16 cells.
  EXPECT_NEAR(outline({0.3, 5, 0.3}).slab, 5.0 / 16, 1e-12);
  EXPECT_NEAR(outline({4, 0.5, 0.3}).cell, std::hypot(4, 0.3) / 2 / 16, 1e-12);
}

/// Area by the way that surfaces face, m^2, as the pieces have it.
struct Areas {
  std::map<int, double> aside;  // by heading in degrees
  double up = 0;
};

Areas AreasOf(const StackOutline& outline) {
  Areas areas;
  for (const StackPiece& piece : outline.pieces) {
    if (piece.kind == StackPiece::kTop) areas.up += piece.weight * outline.cell * outline.cell;
    if (piece.kind == StackPiece::kSide) {
      areas.aside[static_cast<int>(std::lround(piece.heading * 180 / M_PI))] +=
          piece.weight * outline.cell * outline.slab;
    }
  }
  return areas;
}

TEST(MakeStackOutline, PiecesMakeUpTheSurface) {
  const StackOutline outline = MakeStackOutline(Crate(), 16);
  for (const StackPiece& piece : outline.pieces) {
    // The top is at the third slab's end, and is measured a little below it or above.
    if (piece.kind == StackPiece::kTop) {
      EXPECT_EQ(piece.slab, 2);
    }
  }
  const Areas areas = AreasOf(outline);
  EXPECT_NEAR(areas.up, 0.4 * 0.32, 0.05 * 0.4 * 0.32);
  ASSERT_EQ(areas.aside.size(), 4u);
  for (const auto& [heading, area] : areas.aside) {
    const double expected = (std::abs(heading) == 90 ? 0.4 : 0.32) * 0.6;
    EXPECT_NEAR(area, expected, 0.05 * expected) << heading;
  }
}

// Of several boxes, what no other box covers: its area is known from the structure's sides.
TEST(MakeStackOutline, PiecesAreThoseThatAreExposed) {
  const Structure structure = PaperStructure();
  const Areas areas = AreasOf(MakeStackOutline(structure, 16));
  double up = 0;
  std::map<int, double> aside;
  for (const Side& side : structure.sides()) {
    if (side.normal.y() > 0.9) up += side.exposed_area;
    if (std::abs(side.normal.y()) < 0.1)
      aside[static_cast<int>(std::lround(Heading(side.normal) * 180 / M_PI))] += side.exposed_area;
  }
  EXPECT_NEAR(areas.up, up, 0.07 * up);
  ASSERT_EQ(areas.aside.size(), aside.size());
  for (const auto& [heading, area] : areas.aside)
    EXPECT_NEAR(area, aside.at(heading), 0.07 * aside.at(heading)) << heading;
}

TEST(MakeStackOutline, PiecesLieWhereTheSurfaceIs) {
  const Structure structure = testing_infer::RandomStack(4);
  const StackOutline outline = MakeStackOutline(structure);
  const auto nearest = [&](const Eigen::Vector3d& p) {
    double distance = 1e9;
    for (const Side& side : structure.sides())
      distance = std::min(distance, (side.ClosestPoint(p) - p).norm());
    return distance;
  };
  const auto inside = [&](const Eigen::Vector3d& p) {
    return std::any_of(structure.boxes().begin(), structure.boxes().end(), [&](const Box& box) {
      const Eigen::Vector3d local = box.structure_from_box.inverse() * p;
      return (local.cwiseAbs().array() < box.size.array() / 2 + 1e-9).all();
    });
  };
  int deep = 0;
  for (const StackPiece& piece : outline.pieces) {
    ASSERT_TRUE(outline.Has(piece.slab));
    const Eigen::Vector3d p =
        outline.foot + Eigen::Vector3d(piece.x, (piece.slab + 0.5) * outline.slab, piece.z);
    if (piece.kind == StackPiece::kInside) {
      ++deep;
      EXPECT_EQ(piece.weight, kInsideVote);
      EXPECT_TRUE(inside(p));
      EXPECT_GT(nearest(p), outline.cell) << "no measured surface can be there";
    } else {
      // Within its slab, of which the middle is taken here.
      EXPECT_LT(nearest(p), outline.slab);
    }
  }
  EXPECT_GT(deep, 10);
}

TEST(StackOutline, CountsSlabsFromTheFoot) {
  StackOutline outline;
  outline.slab = 0.2;
  outline.slabs = 3;
  EXPECT_EQ(outline.SlabAt(-0.01), -1);
  EXPECT_EQ(outline.SlabAt(0), 0);
  EXPECT_EQ(outline.SlabAt(0.19), 0);
  EXPECT_EQ(outline.SlabAt(0.41), 2);
  EXPECT_FALSE(outline.Has(-1));
  EXPECT_TRUE(outline.Has(0));
  EXPECT_TRUE(outline.Has(2));
  EXPECT_FALSE(outline.Has(3));
}

}  // namespace
}  // namespace volalign::stack_outline_test
