#pragma once

// The frames of a capture, and values of each of them.

#include <cstddef>
#include <map>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include "core/base/parallel_for.h"
#include "core/geometry/structure.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

/// The identity of a frame: one sensor in one capture.
struct FrameId {
  std::size_t still = 0, frame = 0;  ///< index of the capture, and of the frame in it

  bool operator==(const FrameId& other) const {
    return still == other.still && frame == other.frame;
  }
  bool operator<(const FrameId& other) const {
    return std::tie(still, frame) < std::tie(other.still, other.frame);
  }
};

/// A value of every frame.
template <class T>
class PerFrame {
 public:
  PerFrame() = default;
  /// The argument has the values of each capture's frames.
  explicit PerFrame(std::vector<std::vector<T>> stills) : stills_(std::move(stills)) {}

  T& operator[](FrameId id) { return stills_[id.still][id.frame]; }
  const T& operator[](FrameId id) const { return stills_[id.still][id.frame]; }
  std::vector<T>& OfStill(std::size_t still) { return stills_[still]; }
  const std::vector<T>& OfStill(std::size_t still) const { return stills_[still]; }
  std::size_t stills() const { return stills_.size(); }
  /// The ids of all frames, in order.
  std::vector<FrameId> Ids() const {
    std::vector<FrameId> ids;
    for (std::size_t s = 0; s < stills_.size(); ++s) {
      for (std::size_t i = 0; i < stills_[s].size(); ++i) ids.push_back({s, i});
    }
    return ids;
  }

 private:
  std::vector<std::vector<T>> stills_;
};

/// A value of some frames, in order.
template <class T>
using SomeFrames = std::map<FrameId, T>;

/// of(id) for the frames of `like`, on `threads` threads.
template <class T, class F>
auto MapFrames(const PerFrame<T>& like, int threads, const F& of) {
  using Value = std::decay_t<decltype(of(FrameId()))>;
  std::vector<std::vector<Value>> stills;
  for (std::size_t s = 0; s < like.stills(); ++s) stills.emplace_back(like.OfStill(s).size());
  PerFrame<Value> values(std::move(stills));
  const std::vector<FrameId> ids = like.Ids();
  ParallelFor(ids.size(), threads, [&](std::size_t k) { values[ids[k]] = of(ids[k]); });
  return values;
}

/// The input of calibration. Frames of one name are of one sensor.
struct CaptureSet {
  CaptureSet(std::vector<Still> stills, Structure structure);

  std::vector<Still> stills;
  Structure structure;               ///< as described
  std::vector<std::string> sensors;  ///< names in the order in which they first occur
  PerFrame<std::size_t> sensor_of;   ///< index of each frame's sensor

  const SensorFrame& operator[](FrameId id) const { return stills[id.still].frames[id.frame]; }
};

}  // namespace volalign
