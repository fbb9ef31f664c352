#include "infer/initial/target_quality.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "infer/plan/target_report.h"
#include "tests/core/base/expect_error.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::target_quality_test {
namespace {

Structure Stack(const std::vector<Box>& boxes) { return Structure::FromBoxes("stack", boxes); }

Structure TwoEqual() {
  return Stack({Box::FromMinMax("a", {-0.2, -0.4, -0.2}, {0.2, 0, 0.2}),
                Box::FromMinMax("b", {-0.2, 0, -0.2}, {0.2, 0.4, 0.2})});
}

Structure Uneven() {
  return Stack({Box::FromMinMax("a", {-0.3, -0.4, -0.2}, {0.3, 0, 0.2}),
                Box::FromMinMax("b", {-0.1, 0, -0.2}, {0.3, 0.25, 0.45})});
}

TargetViewOptions FewViews() {
  TargetViewOptions options;
  options.directions = 8;
  options.heights_m = {1.2};
  return options;
}

TEST(TargetQuality, AStackWithTurnsThatLookAlikeIsPoor) {
  const Structure structure = TwoEqual();
  const TargetQuality quality = MeasureTarget(structure, FewViews());
  ASSERT_EQ(quality.views.size(), 8u);
  for (const TargetView& view : quality.views) {
    // A square stack: three turns, and as many poses upside down.
    EXPECT_GE(view.look_alike.size(), 7u);
    EXPECT_TRUE(view.sides_fix_pose);
  }
  EXPECT_TRUE(std::any_of(
      quality.symmetries.begin(), quality.symmetries.end(),
      [](const TargetSymmetry& symmetry) { return symmetry.all && !symmetry.floor_tells; }));
  const std::string text = FormatTarget(structure, quality);
  EXPECT_TRUE(Has(text, "poor: from 100 %",
                  "Turned by 90 deg, the stack looks the same from every direction."));
}

TEST(TargetQuality, AStackWithoutThemIsGood) {
  const Structure structure = Uneven();
  const TargetQuality quality = MeasureTarget(structure, FewViews());
  for (const TargetView& view : quality.views) {
    EXPECT_TRUE(view.look_alike.empty()) << view.phi_deg;
    EXPECT_TRUE(view.sides_fix_pose) << view.phi_deg;
    EXPECT_LT(view.weakest_m, 0.03);
  }
  EXPECT_FALSE(Has(FormatTarget(structure, quality), "let sensors see the floor"));
}

// Of a wall that fills the picture nothing tells where along it the sensor is.
TEST(TargetQuality, AWallFixesNoPlace) {
  TargetViewOptions options;
  options.directions = 4;
  options.heights_m = {50};
  const Structure wall = Stack({Box::FromMinMax("wall", {-0.1, -50, -50}, {0.1, 50, 50})});
  const TargetQuality quality = MeasureTarget(wall, options);
  EXPECT_TRUE(std::isinf(quality.views[0].weakest_m)) << quality.views[0].weakest_m;
  EXPECT_FALSE(quality.views[0].sides_fix_pose);
}

TEST(TargetQuality, ThePapersStackNeedsTheFloor) {
  const Structure structure = testing_infer::PaperStructure();
  const TargetQuality quality = MeasureTarget(structure, FewViews());
  for (const TargetView& view : quality.views) {
    EXPECT_FALSE(view.look_alike.empty());
    for (const int symmetry : view.look_alike)
      EXPECT_TRUE(quality.symmetries[static_cast<std::size_t>(symmetry)].floor_tells);
  }
  const std::string text = FormatTarget(structure, quality);
  EXPECT_TRUE(Has(text, "good: ", "let sensors see the floor"));
}

// Its four borders tell the place along it, in both directions: 5 mm and a pixel at 2 m are
// millimetres.
TEST(TargetQuality, AFacingSideAloneFixesNoPose) {
  TargetViewOptions options;
  options.directions = 4;  // along the axes
  options.heights_m = {0.4};
  const TargetQuality quality =
      MeasureTarget(Stack({Box::FromMinMax("a", {-0.2, -0.8, -0.2}, {0.2, 0, 0.2})}), options);
  for (const TargetView& view : quality.views) {
    EXPECT_EQ(view.sides, 1);
    EXPECT_FALSE(view.sides_fix_pose);
    EXPECT_LT(view.weakest_m, 0.03) << view.phi_deg;
  }
}

TEST(TargetQuality, FartherIsWeaker) {
  TargetViewOptions options = FewViews();
  const TargetQuality near = MeasureTarget(Uneven(), options);
  options.distance_m = 4;
  const TargetQuality far = MeasureTarget(Uneven(), options);
  for (std::size_t i = 0; i < near.views.size(); ++i)
    EXPECT_GT(far.views[i].weakest_m, 1.5 * near.views[i].weakest_m);
}

}  // namespace
}  // namespace volalign::target_quality_test
