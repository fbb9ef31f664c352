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
  std::size_t capture = 0, frame = 0;  ///< index of the capture, and of the frame in it

  bool operator==(const FrameId& other) const {
    return capture == other.capture && frame == other.frame;
  }
  bool operator<(const FrameId& other) const {
    return std::tie(capture, frame) < std::tie(other.capture, other.frame);
  }
};

/// A value of every frame.
template <class T>
class PerFrame {
 public:
  PerFrame() = default;
  /// The argument has the values of each capture's frames.
  explicit PerFrame(std::vector<std::vector<T>> captures) : captures_(std::move(captures)) {}

  T& operator[](FrameId id) { return captures_[id.capture][id.frame]; }
  const T& operator[](FrameId id) const { return captures_[id.capture][id.frame]; }
  std::vector<T>& OfCapture(std::size_t capture) { return captures_[capture]; }
  const std::vector<T>& OfCapture(std::size_t capture) const { return captures_[capture]; }
  std::size_t captures() const { return captures_.size(); }
  /// The ids of all frames, in order.
  std::vector<FrameId> Ids() const {
    std::vector<FrameId> ids;
    for (std::size_t s = 0; s < captures_.size(); ++s) {
      for (std::size_t i = 0; i < captures_[s].size(); ++i) ids.push_back({s, i});
    }
    return ids;
  }

 private:
  std::vector<std::vector<T>> captures_;
};

/// A value of some frames, in order.
template <class T>
using SomeFrames = std::map<FrameId, T>;

/// of(id) for the frames of `like`, on `threads` threads.
template <class T, class F>
auto MapFrames(const PerFrame<T>& like, int threads, const F& of) {
  using Value = std::decay_t<decltype(of(FrameId()))>;
  std::vector<std::vector<Value>> captures;
  for (std::size_t s = 0; s < like.captures(); ++s) captures.emplace_back(like.OfCapture(s).size());
  PerFrame<Value> values(std::move(captures));
  const std::vector<FrameId> ids = like.Ids();
  ParallelFor(ids.size(), threads, [&](std::size_t k) { values[ids[k]] = of(ids[k]); });
  return values;
}

/// The input of calibration. Frames of one name are of one sensor.
struct CaptureSet {
  CaptureSet(std::vector<Capture> captures, Structure structure);

  std::vector<Capture> captures;
  Structure structure;               ///< as described
  std::vector<std::string> sensors;  ///< names in the order in which they first occur
  PerFrame<std::size_t> sensor_of;   ///< index of each frame's sensor

  const SensorFrame& operator[](FrameId id) const { return captures[id.capture].frames[id.frame]; }
};

}  // namespace volalign
