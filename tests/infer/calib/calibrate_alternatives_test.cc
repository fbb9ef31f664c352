// A stack that looks alike from two sides: which side a sensor stands on is a question of the rig.

#include <gtest/gtest.h>

#include <cmath>

#include "core/base/error.h"
#include "infer/calib/calibrate.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/calib/calibrate_rig.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::calibrate_alternatives_test {
namespace {

using namespace testing_infer;

// The row may be taken for itself from behind, but not by one of the two alone: they would see
// through what the other one sees, although walls and floor then lie in the same places.
TEST(CalibrateAlternatives, ARowFromBothSides) {
  for (const double azimuth : {80.0, 90.0, 100.0, 115.0}) {
    SCOPED_TRACE(azimuth);
    const Rig rig = RowFromBothSides(azimuth);
    const CalibrationResult result = CalibrateByShape(rig.frames, rig.structure);
    for (const FrameResult& sensor : result.sensors) {
      ASSERT_TRUE(sensor.structure_from_sensor.has_value());
      EXPECT_EQ(sensor.code, SensorCode::kAmbiguous) << "both may be turned together";
    }
    const auto between = [](const Pose& a, const Pose& b) { return Pose(a.inverse() * b); };
    EXPECT_TRUE(
        Within(ComparePoses(between(*result.sensors[0].structure_from_sensor,
                                    *result.sensors[1].structure_from_sensor),
                            between(*rig.frames[0].ground_truth, *rig.frames[1].ground_truth)),
               0.03, 0.3));
  }
}

// Both sensors have one other set of poses, at the other side of the row, which --choose chooses
// for both by either.
TEST(CalibrateAlternatives, TheOtherSideIsInTheResultAndCanBeChosen) {
  const Rig rig = RowFromBothSides(100);
  CalibrateOptions options;
  const auto calibrate = [&] { return CalibrateByShape(rig.frames, rig.structure, options); };
  const CalibrationResult first = calibrate();
  ASSERT_FALSE(first.alternatives.empty());
  const RigAlternative& alternative = first.alternatives.front();
  ASSERT_EQ(alternative.sensors.size(), 2u) << "neither turns without the other";
  EXPECT_LT(alternative.log_odds, std::log(kDecisiveOdds));
  options.orientation.choose = {"S1=2"};
  const CalibrationResult second = calibrate();
  for (std::size_t i = 0; i < 2; ++i) {
    const FrameResult& sensor = second.sensors[i];
    ASSERT_TRUE(sensor.structure_from_sensor.has_value());
    EXPECT_LT(
        ComparePoses(*sensor.structure_from_sensor, alternative.sensors[i].structure_from_sensor)
            .translation_m,
        0.05);
    EXPECT_NE(sensor.code, SensorCode::kAmbiguous) << "the choice is made";
  }
  for (const char* wrong : {"S1=9", "S1", "S1=0", "S1=x", "S9=2"}) {
    options.orientation.choose = {wrong};
    EXPECT_THROW(calibrate(), ConfigError) << wrong;
  }
}

}  // namespace
}  // namespace volalign::calibrate_alternatives_test
