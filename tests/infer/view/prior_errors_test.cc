#include "infer/view/prior_errors.h"

#include <gtest/gtest.h>

#include "core/geometry/sensor_kind.h"

namespace volalign {
namespace {

TEST(PriorErrorsOf, HasTheKindsErrorsButForTheSmoothOne) {
  for (const char* kind : {"realsense_d415", "azure_kinect_nfov_binned", "lidar"}) {
    const DepthErrorModel prior = PriorErrorsOf(kind);
    EXPECT_EQ(prior.Smooth(3), ErrorsOf("lidar").Smooth(3)) << kind;
    EXPECT_EQ(prior.White(3), ErrorsOf(kind).White(3)) << kind;
    EXPECT_EQ(prior.gain, ErrorsOf(kind).gain) << kind;
  }
  EXPECT_LT(PriorErrorsOf("realsense_d415").Smooth(2), ErrorsOf("realsense_d415").Smooth(2));
}

}  // namespace
}  // namespace volalign
