#include "infer/refine/observations.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "tests/infer/refine/points_and_evidence.h"

namespace volalign::refine_internal {
namespace {

using testing_infer::PaperStructure;

TEST(SeamShare, SeamsAreWhereSurfacesMeetAtAnInwardCorner) {
  const Structure structure = PaperStructure();
  const auto side = [&](const char* name) -> const Side& {
    for (const Side& s : structure.sides()) {
      if (s.name == name) return s;
    }
    throw std::runtime_error(name);
  };
  // The bottom box's front stands on the floor (y = -0.81): the share
  // falls linearly to none at 0.3 m above it.
  const Side& front = side("bottom/front");
  EXPECT_NEAR(SeamShare(structure, front, {0.275, -0.81, 0}), 1, 1e-9);
  EXPECT_NEAR(SeamShare(structure, front, {0.275, -0.66, 0}), 0.5, 1e-9);
  EXPECT_NEAR(SeamShare(structure, front, {0.275, -0.45, 0}), 0, 1e-9);
  // On its top, beside the next box, which ends at x = 0.05.
  EXPECT_NEAR(SeamShare(structure, side("bottom/up"), {0.11, -0.405, 0}), 0.8, 1e-9);
  // The top box's front: nothing rises before it.
  EXPECT_NEAR(SeamShare(structure, side("top/front"), {0.05, 0.6, 0}), 0, 1e-9);
}

}  // namespace
}  // namespace volalign::refine_internal
