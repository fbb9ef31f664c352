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
       "extrinsics.json of accepted calibrations of the structure, whose frames are mixed into "
       "training with the labels that the structure has at their poses");
    ar("share", share, "of the training samples that are such frames", Between(0, 1));
    ar("validation", validation,
       "such files whose frames are held out: validation is on all of them, once, instead of on "
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
