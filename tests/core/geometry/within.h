#pragma once

#include <gtest/gtest.h>

#include "core/geometry/pose.h"

namespace volalign {

/// Whether two poses are apart by less than this, as ComparePoses says it; says by how much.
inline testing::AssertionResult Within(const PoseError& error, double metres, double degrees) {
  const bool within = error.translation_m < metres && error.rotation_deg < degrees;
  return (within ? testing::AssertionSuccess() : testing::AssertionFailure())
         << 1000 * error.translation_m << " mm and " << error.rotation_deg << " deg apart; "
         << 1000 * metres << " mm and " << degrees << " deg are the limits";
}

}  // namespace volalign
