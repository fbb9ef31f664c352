#include "infer/checks/outcome.h"

#include <gtest/gtest.h>

#include <string>

namespace volalign::outcome_test {
namespace {

// Files of earlier versions have these words.
TEST(SensorCode, HasTheWordsOfTheFiles) {
  std::string words;
  for (const SensorCode code : AllOf(SensorCode())) words += std::string(ToString(code)) + " ";
  EXPECT_EQ(words,
            " no_depth wrong_units no_structure degenerate_sides inconsistent assembly_mirrored "
            "assembly_turned assembly_swapped assembly_missing assembly_shifted assembly_height "
            "frame_mirrored unconnected duplicate_depth intrinsics_suspect disagrees ambiguous "
            "not_finite unsolved unsettled "
            "same_pose by_neighbours few_inliers large_residual labels_disagree lens_suspect "
            "uncertain typical_intrinsics ");
}

}  // namespace
}  // namespace volalign::outcome_test
