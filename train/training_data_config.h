#pragma once

#include <string>
#include <vector>

#include "core/config/config.h"
#include "render/sample_config.h"

namespace volalign {

/// Recorded frames beside the rendered ones.
struct RealConfig {
  std::vector<std::string> calibrations;
  double share = 0.25;
  std::vector<std::string> validation;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("calibrations", calibrations,
       "extrinsics.json files whose frames are mixed into training, with the labels that the "
       "structure has at their poses");
    ar("share", share, "share of these frames in the training samples", Between(0, 1));
    ar("validation", validation,
       "extrinsics.json files whose frames are held out: the run is validated on them, not on "
       "rendered samples");
  }
};

/// Training samples.
struct TrainingDataConfig : SampleConfig {
  RealConfig real;

  template <class Archive>
  void Describe(Archive& ar) {
    SampleConfig::Describe(ar);
    ar("real", real, "recorded frames; only in training");
  }
};

}  // namespace volalign
