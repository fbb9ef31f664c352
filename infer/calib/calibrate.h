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
    ar("device", device, "device that runs the network: cpu, cuda or cuda:N");
  }
};

/// Called at the start of each stage with a few words for a person: "first poses". Some stages come
/// again if a lens has changed.
using CalibrateProgress = std::function<void(const std::string& stage)>;

/// Calibrates a rig from depth maps and intrinsics in memory, without files or a GL context. Each
/// element of the first argument is a capture; only the stack may move between captures. Poses are
/// in the structure where it stood in the first one. Without a segmenter (null), initial poses come
/// from the structure's shape alone. A sensor that cannot be placed is `failed` with a code; the
/// others are placed without it. Throws ConfigError for invalid options. Throws DataError for
/// frames that contradict their intrinsics or share a name in one capture, and for captures that
/// share a name. It also throws DataError for a sensor that differs between two captures, or has
/// the same depth map in both.
CalibrationResult Calibrate(const std::vector<Capture>& captures, const Structure& structure,
                            Segmenter* segmenter, const CalibrateOptions& options = {},
                            const CalibrateProgress& progress = nullptr);
CalibrationResult Calibrate(const std::vector<Capture>& captures, const Structure& structure,
                            Segmenter& segmenter, const CalibrateOptions& options = {});

/// The same for a single capture.
CalibrationResult Calibrate(const std::vector<SensorFrame>& frames, const Structure& structure,
                            Segmenter& segmenter, const CalibrateOptions& options = {});

}  // namespace volalign
