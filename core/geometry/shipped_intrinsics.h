#pragma once

namespace volalign::shipped {

/// The text of configs/intrinsics.yaml, embedded by cmake/EmbedText.cmake.
extern const char kIntrinsics[];

}  // namespace volalign::shipped
