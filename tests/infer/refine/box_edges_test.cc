#include "infer/refine/box_edges.h"

#include <gtest/gtest.h>

namespace volalign::refine_internal::box_edges_test {
namespace {

// LikeliestEdge: tests/infer/calib/hypotheses_test.cc.

double Bottom(const Structure& structure, std::size_t box) {
  const Box& of = structure.boxes()[box];
  return of.structure_from_box.translation().y() - of.size.y() / 2;
}

TEST(WithEdge, AHigherBoxLiftsWhatRestsOnItAndNothingElse) {
  const Structure structure =
      Structure::FromBoxes("four", {Box::FromMinMax("low", {-0.3, 0, -0.2}, {0.3, 0.3, 0.2}),
                                    Box::FromMinMax("middle", {-0.2, 0.3, -0.1}, {0.2, 0.6, 0.1}),
                                    Box::FromMinMax("high", {-0.1, 0.6, -0.1}, {0.3, 0.8, 0.1}),
                                    Box::FromMinMax("beside", {0.4, 0, -0.2}, {0.7, 0.3, 0.2})});
  const Structure higher = WithEdge(structure, 1, 1, 0.02);
  EXPECT_NEAR(Bottom(higher, 0), 0, 1e-12);
  EXPECT_NEAR(Bottom(higher, 1), 0.3, 1e-12);
  EXPECT_NEAR(higher.boxes()[1].size.y(), 0.32, 1e-12);
  EXPECT_NEAR(Bottom(higher, 2), 0.62, 1e-12);
  EXPECT_NEAR(Bottom(higher, 3), 0, 1e-12);
  const Structure lowest = WithEdge(structure, 0, 1, -0.02);
  EXPECT_NEAR(Bottom(lowest, 2), 0.58, 1e-12);
  const Structure wider = WithEdge(structure, 0, 2, 0.02);
  EXPECT_NEAR(wider.boxes()[0].size.z(), 0.42, 1e-12);
  EXPECT_TRUE(
      wider.boxes()[0].structure_from_box.isApprox(structure.boxes()[0].structure_from_box));
  EXPECT_NEAR(Bottom(wider, 1), 0.3, 1e-12);
  EXPECT_EQ(wider.SideNames(), structure.SideNames());
}

}  // namespace
}  // namespace volalign::refine_internal::box_edges_test
