#pragma once

#include <gtest/gtest.h>

#include "render/sample.h"

namespace volalign {

/// A sample that was read from a folder has no clean images: they are compared where `read` has
/// any.
inline void ExpectEqual(const Sample& read, const Sample& drawn) {
  SCOPED_TRACE(drawn.index);
  EXPECT_EQ(read.index, drawn.index);
  EXPECT_EQ(read.sensor, drawn.sensor);
  EXPECT_TRUE(read.intrinsics == drawn.intrinsics);
  EXPECT_EQ(read.structure_from_sensor.matrix(), drawn.structure_from_sensor.matrix());
  EXPECT_TRUE(read.depth == drawn.depth);
  EXPECT_TRUE(read.labels == drawn.labels);
  if (read.depth_clean.size() > 0) {
    EXPECT_TRUE(read.depth_clean == drawn.depth_clean);
    EXPECT_TRUE(read.labels_clean == drawn.labels_clean);
  }
  EXPECT_EQ(read.size_scale, drawn.size_scale);
  ASSERT_EQ(read.box_offsets.size(), drawn.box_offsets.size());
  for (std::size_t i = 0; i < read.box_offsets.size(); ++i)
    EXPECT_EQ(read.box_offsets[i].matrix(), drawn.box_offsets[i].matrix());
}

}  // namespace volalign
