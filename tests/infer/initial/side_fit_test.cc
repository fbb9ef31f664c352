#include "infer/initial/side_fit.h"

#include <gtest/gtest.h>

#include <vector>

#include "infer/initial/pose_candidates.h"
#include "infer/view/held_out.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::side_fit_test {
namespace {

using testing_infer::Certain;
using testing_infer::Kinect;
using testing_infer::PaperStructure;
using testing_infer::Render;
using testing_infer::RingPose;

class FitToSidesTest : public ::testing::Test {
 protected:
  void See(double phi_deg) {
    truth = RingPose(phi_deg);
    const auto rendered = Render(structure, Kinect(), truth);
    view = MakeSensorView(rendered.depth, Kinect());
    patches = LargestPatches(CollectPatches(view, Certain(rendered.labels), structure, {}));
  }
  Pose Start() const {
    Vector6d delta;
    delta << 0.01, -0.012, 0.008, 0.006, -0.004, 0.008;
    return PerturbLeft(delta, truth);
  }

  Structure structure = PaperStructure();
  Pose truth;
  SensorView view;
  std::vector<SidePatch> patches;
  InitialPoseOptions options;
};

TEST_F(FitToSidesTest, BringsAPoseThatIsACentimetreOffBack) {
  for (const double phi : {15.0, 130.0, 250.0}) {
    See(phi);
    const PoseError before = ComparePoses(Start(), truth);
    const PoseError after =
        ComparePoses(FitToSides(view, patches, structure, options, Start()), truth);
    EXPECT_GT(before.translation_m, 0.015) << phi;
    EXPECT_FALSE(!(after.translation_m < 0.001)) << phi << ": " << after.translation_m;
    EXPECT_FALSE(!(after.rotation_deg < 0.05)) << phi << ": " << after.rotation_deg;
  }
}

TEST_F(FitToSidesTest, HeldOutPointsHaveNoSay) {
  See(15);
  const Pose fitted = FitToSides(view, patches, structure, options, Start());
  SensorView spoilt = view;
  int changed = 0;
  for (const SidePatch& patch : patches) {
    for (const int pixel : patch.pixels) {
      const int u = pixel % view.width(), v = pixel / view.width();
      if (!HeldOut(u, v)) continue;
      // Less than the distance at which a measurement hides the side from the visibility check.
      spoilt.depth(u, v) -= 0.03f;
      ++changed;
    }
  }
  ASSERT_GT(changed, 1000);
  const Pose same = FitToSides(spoilt, patches, structure, options, Start());
  EXPECT_EQ((same.matrix() - fitted.matrix()).cwiseAbs().maxCoeff(), 0);
}

TEST_F(FitToSidesTest, WithoutStepsOrPatchesThePoseStays) {
  See(15);
  options.side_fit_steps = 0;
  EXPECT_TRUE(FitToSides(view, patches, structure, options, Start()).isApprox(Start(), 0));
  options.side_fit_steps = 5;
  EXPECT_TRUE(FitToSides(view, {}, structure, options, Start()).isApprox(Start(), 0));
}

}  // namespace
}  // namespace volalign::side_fit_test
