#pragma once

// Stills for the tests of infer/evaluate.

#include <string>
#include <vector>

#include "infer/evaluate/items.h"
#include "infer/evaluate/variants.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::testing_infer {

struct Ring {
  EvaluationStill still;
  Rig rig;
};

/// Sensors about the structure, its boxes displaced by `offsets` where there are some.
inline Ring MakeRing(const std::vector<Pose>& offsets = {}, int sensors = 3) {
  const Structure nominal = PaperStructure();
  Ring ring{{}, {offsets.empty() ? nominal : nominal.Displaced(offsets), {}, {}}};
  for (int i = 0; i < sensors; ++i) {
    ring.rig.Add("S" + std::to_string(i), RingPose(120.0 * i + 20, 2.0, 0.3 + 0.05 * i));
  }
  ring.still.structure = nominal;
  ring.still.frames = ring.rig.frames;
  ring.still.labels = ring.rig.labels;
  return ring;
}

/// Adds a still of the same sensors while the structure stands elsewhere, and its labels to the
/// segmenter.
inline void AddPlacement(const Pose& first_from_placement, Ring* ring, StoredSegmenter* segmenter) {
  Rig there{ring->rig.structure, {}, {}};
  for (const SensorFrame& frame : ring->rig.frames) {
    there.Add(frame.name, first_from_placement.inverse() * *frame.ground_truth);
    segmenter->Store(there.frames.back().depth, Certain(there.labels.back()));
  }
  ring->still.further.push_back({there.frames, there.labels});
}

inline std::vector<EvaluationVariant> TwoVariants() {
  EvaluationVariant network{"network", {}}, paper{"paper", {}};
  paper.options.initial.method = PoseMethod::kPaper;
  return {network, paper};
}

}  // namespace volalign::testing_infer
