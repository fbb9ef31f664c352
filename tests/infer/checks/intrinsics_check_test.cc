#include "infer/checks/intrinsics_check.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/infer/view/synthetic.h"

namespace volalign::intrinsics_check_test {
namespace {

using namespace testing_infer;

/// A wide picture, so that exchanged coordinates of the principal point are far off.
Intrinsics Wide() {
  Intrinsics intrinsics = Kinect();
  intrinsics.height = 180;
  intrinsics.cx = 161;
  intrinsics.cy = 91;
  return intrinsics;
}

std::optional<BetterIntrinsics> Find(const Intrinsics& truth, const Intrinsics& given) {
  const Structure structure = PaperStructure();
  const auto rendered = Render(structure, truth, RingPose(35, 2.3), {true, 3.5});
  return FindBetterIntrinsics(MakeSensorView(rendered.depth, given), given,
                              Certain(rendered.labels), structure, {});
}

TEST(FindBetterIntrinsics, NothingBeatsTheTrueOnes) {
  EXPECT_FALSE(Find(Kinect(), Kinect()).has_value());
  EXPECT_FALSE(Find(Wide(), Wide()).has_value());
}

// The frame was ray-cast with the true focal length; 1.15 and 0.87 lie between the factors tried.
TEST(FindBetterIntrinsics, FindsTheFocalLength) {
  for (const double factor : {1.15, 0.87}) {
    Intrinsics given = Kinect();
    given.fx *= factor;
    given.fy *= factor;
    const auto better = Find(Kinect(), given);
    ASSERT_TRUE(better.has_value()) << factor;
    EXPECT_NEAR(better->intrinsics.fx, Kinect().fx, 0.02 * Kinect().fx) << factor;
    EXPECT_NEAR(better->intrinsics.fy, Kinect().fy, 0.02 * Kinect().fy) << factor;
    EXPECT_EQ(better->intrinsics.cx, given.cx);
    EXPECT_NEAR(better->size, std::abs(1 / factor - 1), 0.02) << factor;
    EXPECT_GT(better->score, 0.8) << factor;
    EXPECT_GT(better->score, better->given_score + 0.08) << factor;
    EXPECT_EQ(better->change.rfind("fx = ", 0), 0u) << better->change;
  }
}

TEST(FindBetterIntrinsics, FindsAnExchangedPrincipalPoint) {
  Intrinsics given = Wide();
  std::swap(given.cx, given.cy);
  const auto better = Find(Wide(), given);
  ASSERT_TRUE(better.has_value());
  EXPECT_EQ(better->intrinsics.cx, Wide().cx);
  EXPECT_EQ(better->intrinsics.cy, Wide().cy);
  EXPECT_EQ(better->intrinsics.fx, given.fx);
  EXPECT_EQ(better->change, "cx = 161.0, cy = 91.0");
  EXPECT_NEAR(better->size, std::hypot(70, 70) / 252.2, 1e-9);
}

TEST(FindBetterIntrinsics, FindsThePrincipalPointInTheMiddle) {
  Intrinsics truth = Wide();
  truth.cx = 159.5;
  truth.cy = 89.5;
  Intrinsics given = truth;
  given.cx = 210;
  given.cy = 40;
  const auto better = Find(truth, given);
  ASSERT_TRUE(better.has_value());
  EXPECT_EQ(better->intrinsics.cx, 159.5);
  EXPECT_EQ(better->intrinsics.cy, 89.5);
}

}  // namespace
}  // namespace volalign::intrinsics_check_test
