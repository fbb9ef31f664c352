#pragma once

#include <functional>
#include <string>
#include <vector>

#include "core/config/config.h"
#include "core/geometry/structure.h"
#include "infer/calib/result.h"
#include "infer/checks/assembly.h"
#include "infer/checks/verdict.h"
#include "infer/initial/initial_pose.h"
#include "infer/initial/orientation.h"
#include "infer/refine/refine.h"
#include "infer/view/segmenter.h"
#include "infer/view/sensor_frame.h"

namespace volalign {

struct CalibrateOptions {
  InitialPoseOptions initial;
  OrientationOptions orientation;
  RefineOptions refine;
  VerdictOptions verdict;
  AssemblyOptions assembly;
  int threads = 2;
  std::string device = "cpu";

  template <class Archive>
  void Describe(Archive& ar) {
    ar("initial", initial, "initial pose of each sensor");
    ar("orientation", orientation, "which way up a frame is, and which of several poses it shows");
    ar("refine", refine, "joint refinement");
    ar("verdict", verdict, "what a sensor has to show to be placed, and to be ok");
    ar("assembly", assembly, "recognition of a stack that is built otherwise");
    ar("threads", threads, "threads over sensors", AtLeast(1));
    ar("device", device, "what the network runs on: cpu, cuda or cuda:N");
  }
};

/// Told what begins, in a few words for a person: "first poses". Calibrations that look at a lens
/// again come to some stages twice.
using CalibrateProgress = std::function<void(const std::string& stage)>;

/// Calibrates a rig from depth maps and intrinsics in memory: no file, no GL context. Without a
/// segmenter (null), initial poses come from the structure's geometry alone. Between the
/// stills the stack was moved and nothing else; poses are in the structure where it stood in the
/// first. A sensor that cannot be placed is `failed` with a code; the others are placed without it.
/// Throws ConfigError for invalid options, and DataError for frames that contradict their
/// intrinsics or share a name in one still, for stills that share one, and for a sensor that is not
/// the same in two stills or has the same depth map in both.
CalibrationResult Calibrate(const std::vector<Still>& stills, const Structure& structure,
                            Segmenter* segmenter, const CalibrateOptions& options = {},
                            const CalibrateProgress& progress = nullptr);
CalibrationResult Calibrate(const std::vector<Still>& stills, const Structure& structure,
                            Segmenter& segmenter, const CalibrateOptions& options = {});

/// Of a single still.
CalibrationResult Calibrate(const std::vector<SensorFrame>& frames, const Structure& structure,
                            Segmenter& segmenter, const CalibrateOptions& options = {});

}  // namespace volalign
