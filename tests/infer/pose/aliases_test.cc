#include "infer/pose/aliases.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <vector>

#include "core/random.h"
#include "tests/infer/synthetic.h"

namespace volalign {
namespace {

using testing_infer::PaperStructure;

bool Inside(const Structure& structure, const Eigen::Vector3d& p, double slack) {
  return std::any_of(structure.boxes().begin(), structure.boxes().end(), [&](const Box& box) {
    const Eigen::Vector3d q = box.structure_from_box.inverse() * p;
    return ((q.cwiseAbs() - box.size / 2).array() < slack).all();
  });
}

// Independent of corners: the volume of the moved boxes, by random points.
TEST(FindAliases, CountsTheBoxesThatComeToLieOnBoxes) {
  const Structure structure = PaperStructure();
  const std::vector<StructureAlias> aliases = FindAliases(structure);
  ASSERT_GE(aliases.size(), 4u);
  RandomStream random(1, 0, "points");
  for (const StructureAlias& alias : aliases) {
    int covered = 0;
    for (const Box& box : structure.boxes()) {
      bool all = true;
      for (int k = 0; k < 200; ++k) {
        const Eigen::Vector3d p(random.Uniform(-0.5, 0.5), random.Uniform(-0.5, 0.5),
                                random.Uniform(-0.5, 0.5));
        all = all && Inside(structure,
                            alias.motion * (box.structure_from_box *
                                            Eigen::Vector3d(p.cwiseProduct(box.size))),
                            0.02);
      }
      covered += all ? 1 : 0;
    }
    EXPECT_EQ(covered, alias.boxes);
    for (int label = 1; label < structure.num_classes(); ++label) {
      const int after = alias.label_after[static_cast<std::size_t>(label)];
      if (after == 0) continue;
      const Side& side = structure.SideOfLabel(label);
      const Eigen::Vector3d p =
          alias.motion * Eigen::Vector3d(side.centre + 0.1 * side.half_u * side.axis_u);
      EXPECT_LT((structure.SideOfLabel(after).ClosestPoint(p) - p).norm(), 0.02);
    }
  }
  // The paper's stack by hand: half a turn about a horizontal diagonal keeps all four boxes, and
  // a step of the spiral three, a box height higher or lower.
  EXPECT_EQ(aliases[0].boxes, 4);
  EXPECT_FALSE(aliases[0].keeps_up());
  int up = 0, down = 0;
  for (const StructureAlias& alias : aliases) {
    if (alias.boxes != 3 || !alias.keeps_up()) continue;
    EXPECT_NEAR(std::abs(alias.motion.translation().y()), 0.405, 1e-6);
    EXPECT_NEAR(alias.motion.linear().trace(), 1, 1e-9);  // a quarter turn
    ++(alias.motion.translation().y() > 0 ? up : down);
  }
  EXPECT_EQ(up, 1);
  EXPECT_EQ(down, 1);
}

TEST(FindAliases, BoxesOfDifferentSizesHaveNone) {
  const Structure structure =
      Structure::FromBoxes("odd", {Box::FromMinMax("low", {-0.4, -0.8, -0.2}, {0.3, -0.3, 0.15}),
                                   Box::FromMinMax("middle", {-0.1, -0.3, -0.2}, {0.3, 0.1, 0.4}),
                                   Box::FromMinMax("high", {-0.3, 0.1, -0.1}, {0.3, 0.45, 0.15})});
  // Each box by itself is the same after half a turn about its own axes.
  for (const StructureAlias& alias : FindAliases(structure)) EXPECT_LT(alias.boxes, 2);
}

}  // namespace
}  // namespace volalign
