#pragma once

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "core/geometry/camera.h"

namespace volalign {

/// A renderer's tables for recent intrinsics, so that a pool's lenses are not inverted for each
/// picture.
template <class T>
class RecentLenses {
 public:
  /// `make` gives the T of new intrinsics. The reference is valid until the next call.
  template <class Make>
  const T& Get(const Intrinsics& intrinsics, const Make& make) {
    const auto known = std::find_if(recent_.begin(), recent_.end(), [&](const Entry& entry) {
      return entry.intrinsics == intrinsics;
    });
    if (known != recent_.end()) return *known->value;
    auto value = std::make_unique<const T>(make(intrinsics));
    if (recent_.size() == kMost) recent_.erase(recent_.begin());
    recent_.push_back({intrinsics, std::move(value)});
    return *recent_.back().value;
  }

 private:
  static constexpr std::size_t kMost = 64;
  struct Entry {
    Intrinsics intrinsics;
    std::unique_ptr<const T> value;
  };
  std::vector<Entry> recent_;
};

}  // namespace volalign
