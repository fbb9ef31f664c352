#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/config/config.h"
#include "core/geometry/structure.h"
#include "infer/checks/arrangements.h"
#include "infer/checks/outcome.h"
#include "infer/view/sensor_view.h"

namespace volalign {

struct AssemblyOptions {
  bool enabled = true;

  template <class Archive>
  void Describe(Archive& ar) {
    using Harmless = std::vector<std::string>;
    const char* const instead = "stacks are compared by odds; leave the key out";
    ar("enabled", enabled,
       "if sensors fail or contradict each other, look for mirrored frames and for a stack that is "
       "not built as the structure says",
       Removed("suspicious_shape_iou", instead, Harmless{"0.92"}),
       Removed("min_shape_iou", instead, Harmless{"0.7"}),
       Removed("margin", instead, Harmless{"0.08"}),
       Removed("suspicious_frame_shape_iou", instead, Harmless{"0.85"}));
  }
};

/// The stack's arrangement, as far as the sensors show it.
struct AssemblyReport {
  Arrangement arrangement;           ///< code kNone: as described, or not known
  double described_share = 0;        ///< share of points at the described boxes that lie on them
  double share = 0;                  ///< the same of `arrangement`
  std::vector<std::size_t> seen_by;  ///< indices of the views that have the arrangement's shape
  /// Indices of the views that are mirrored, while others show the stack as described.
  std::vector<std::size_t> mirrored_frames;

  bool altered() const { return arrangement.code != SensorCode::kNone; }
};

/// Does another arrangement explain the views more probably than the described one? Each is
/// searched for in every view by its shape alone (FindBestOnFloors). Its worth is the sum of the
/// log odds (ViewFit::LogOdds) of the views that have its shape. The best one has to be more
/// probable than the described one by kDecisiveOdds times the number of arrangements. As many views
/// have to show it. Beside Arrangements, each box is searched for beside its place. With the boxes
/// on it, it is searched for beside, above and below its place, and all boxes on another one. The
/// sentence names others that are about as probable.
///
/// Single frames are mirrored if the mirror image explains them, others show the stack as
/// described, and no one arrangement explains them all as well. Each such frame beyond the first
/// has to be worth another kDecisiveOdds.
///
/// Views that are null, or show no floor, do not count. Takes some 10 s on one processor, so it is
/// for stacks that were not found.
AssemblyReport InspectAssembly(const std::vector<const SensorView*>& views,
                               const Structure& structure, int threads);

}  // namespace volalign
