#pragma once

#include <string>
#include <vector>

#include "core/config.h"
#include "core/structure.h"
#include "infer/checks/outcome.h"
#include "infer/pose/initial_pose.h"
#include "infer/view/segmenter.h"
#include "infer/view/sensor_view.h"

namespace volalign {

struct AssemblyOptions {
  bool enabled = true;
  double suspicious_overlap = 0.92;
  double min_overlap = 0.7;
  double margin = 0.08;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("enabled", enabled, "look for a stack that is built otherwise than the structure says");
    ar("suspicious_overlap", suspicious_overlap,
       "overlap of the structure as described with what the sensors see, below which other "
       "arrangements are tried",
       Between(0, 1));
    ar("min_overlap", min_overlap, "least overlap of another arrangement that is believed",
       Between(0, 1));
    ar("margin", margin, "by how much its overlap has to exceed that of the structure as described",
       Between(0, 1));
  }
};

/// A way in which people build a stack wrongly.
struct Arrangement {
  /// One of the kAssembly codes; kNone: as described.
  SensorCode code = SensorCode::kNone;
  std::string sentence;  ///< "box mid_top is turned by 90 deg about the vertical (...)"
  std::string box, other_box;
  int turn_deg = 0;     ///< about the vertical, from +x towards +z
  Structure structure;  ///< boxes and labels as described, moved
};

/// The arrangement as described, first, and every other one that can be told from it: each box
/// missing (what stood on it comes down), the stack mirrored, each box turned by 90, 180 or 270 deg
/// about the column that all boxes share, or by 90 deg about its own middle, each two boxes
/// exchanged. Of several ways to the same boxes in the same places the first is kept, so that
/// exchanges that amount to a mirror image are called mirrored. A box that is turned by half a turn
/// about its own middle, or exchanged with one of the same size, is the same structure to a depth
/// sensor and in no list.
///
/// A side's label goes by the direction that it faces in the stack, as a network that was trained
/// on the described stack labels it: a box that is turned by 90 deg has its front where its left
/// side was.
std::vector<Arrangement> Arrangements(const Structure& structure);

struct AssemblySensor {
  const SensorView* view = nullptr;
  const SegmentationResult* segmentation = nullptr;
  const InitialPose* initial = nullptr;  ///< of the arrangement as described
};

struct AssemblyReport {
  Arrangement arrangement;       ///< code kNone: nothing speaks for another one
  double described_overlap = 0;  ///< over all sensors, both / either
  double overlap = 0;            ///< of `arrangement`
  double runner_up = 0;          ///< of the next best of the others, 0 where none was tried
  bool altered() const { return arrangement.code != SensorCode::kNone; }
};

/// Does another arrangement explain the sensors' views clearly better than the one described?
/// Others are tried where the one described leaves something to explain; each sensor's pose is
/// estimated for each anew, and has to stand on a floor where there is one. At most `max_sensors`
/// with the most labelled pixels are asked. `threads` >= 1.
AssemblyReport InspectAssembly(const std::vector<AssemblySensor>& sensors,
                               const Structure& structure, const InitialPoseOptions& initial,
                               const AssemblyOptions& options, int threads,
                               std::size_t max_sensors = 8);

}  // namespace volalign
