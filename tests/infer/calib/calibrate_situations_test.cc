// Situations that rendered rooms do not have: sides of one direction, exact boxes. Each of
// them from several places.

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "infer/calib/calibrate.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/calib/calibrate_rig.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::calibrate_situations_test {
namespace {

using namespace testing_infer;

// Straight before the four sides that face along +z, so low that no top is seen: nothing but their
// silhouettes fixes the place along them. Without a depth behind them there are none.
TEST(FourParallelSides, FixAPoseIfSomethingIsBehindThem) {
  for (int k = 0; k < 6; ++k) {
    const bool room = k < 5;
    Rig rig{PaperStructure(), {}, {}};
    Pose pose = RingPose(90, 2.0 + 0.1 * k, -0.6, 90 + 2 * k, {-0.1, -0.1, 0});
    pose.translation().x() = -0.1;
    rig.Add("S", pose, {false, room ? 3.5 : 0});
    LabelImage& labels = rig.labels[0];
    for (int label = 1; label < rig.structure.num_classes(); ++label) {
      const bool seen = std::count(labels.begin(), labels.end(), label) > 0;
      const bool parallel = rig.structure.SideOfLabel(label).normal.z() > 0.9;
      ASSERT_TRUE(!seen || parallel) << label;
    }
    const int most = k % 3;  // px missing round each edge
    LeaveGaps(&rig.frames[0].depth, &labels, most > 0 ? 1 : 0, most, static_cast<unsigned>(k));
    AddNoise(&rig.frames[0].depth, 0.002, static_cast<unsigned>(k));
    const FrameResult sensor = CalibrateRig(rig).sensors[0];
    if (!room) {
      EXPECT_EQ(sensor.code, SensorCode::kDegenerateSides) << sensor.reason;
      continue;
    }
    EXPECT_EQ(sensor.status, SensorStatus::kOk) << k << ": " << sensor.reason;
    ASSERT_TRUE(sensor.error.has_value());
    EXPECT_TRUE(Within(*sensor.error, 0.012, 0.5)) << k;
    const Eigen::Vector3d off = sensor.structure_from_sensor->translation() - pose.translation();
    EXPECT_LT((off.cwiseAbs() - 3 * sensor.sigma_position_m()).maxCoeff(), 0) << k;
  }
}

/// m, mean error of the positions of six sensors round boxes that stand as described.
double ErrorWithExactBoxes(std::uint64_t seed, const std::string& estimate) {
  Rig rig{PaperStructure(), {}, {}};
  for (unsigned i = 0; i < 6; ++i) {
    rig.Add(RingPose(60.0 * i + 17 * static_cast<double>(seed), 2.0, 0.3), {true, 3.5});
    AddNoise(&rig.frames[i].depth, 0.001, seed + i);
    AddSmoothError(&rig.frames[i].depth, 0.001, 6, seed + i);
  }
  CalibrateOptions options;
  options.refine.estimate = estimate;
  double sum = 0;
  for (const FrameResult& sensor : CalibrateRig(rig, options).sensors)
    sum += sensor.error ? sensor.error->translation_m : 1;
  return sum / 6;
}

TEST(ExactBoxes, CostNothingWhereMoreIsEstimated) {
  for (const std::uint64_t seed : {3, 30}) {
    const double nominal = ErrorWithExactBoxes(seed, "none");
    const double estimated = ErrorWithExactBoxes(seed, "auto");
    EXPECT_LT(estimated, 0.0015) << seed;
    EXPECT_LT(estimated, nominal + 0.0005) << seed << ": " << nominal;
  }
}

}  // namespace
}  // namespace volalign::calibrate_situations_test
