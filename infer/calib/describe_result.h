#pragma once

// The keys of a calibration's results in files. Any archive like those of core/json/json_archive.h
// serves; this header does without it. A quantity that is not finite is an absent key.

#include <fmt/format.h>

#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/geometry/metrics.h"
#include "infer/calib/result.h"
#include "infer/refine/refine.h"

namespace volalign {

template <class Archive>
void Describe(Archive& ar, LensOutcome& lens) {
  ar("source", lens.source);
  ar.IfFinite("sigma_focal", lens.sigmas[0]);
  ar.IfFinite("sigma_k1", lens.sigmas[1]);
  ar.IfFinite("sigma_k2", lens.sigmas[2]);
}

template <class Archive>
void Describe(Archive& ar, SolveReport& solution) {
  ar("rounds", solution.rounds);
  ar("settled", solution.settled);
  ar("converged", solution.converged);
  ar.IfFinite("moved_m", solution.moved_m);
  ar.IfFinite("moved_px", solution.moved_px);
}

template <class Archive>
void Describe(Archive& ar, SensorOutcome& sensor) {
  ar("status", sensor.status);
  ar.Optional("code", sensor.code);
  ar.Optional("reason", sensor.reason);
  ar.Optional("hint", sensor.hint);
  ar.Optional("structure_from_sensor", sensor.structure_from_sensor);
  const bool failed = sensor.status == SensorStatus::kFailed;
  if constexpr (Archive::kReading) {
    if (failed == sensor.structure_from_sensor.has_value()) {
      throw DataError(
          fmt::format("{}: status \"{}\" and the {} of structure_from_sensor contradict each other",
                      ar.where(), ToString(sensor.status), failed ? "presence" : "absence"));
    }
  }
  if (!sensor.structure_from_sensor) return;
  ar.IfFinite("initial", sensor.initial);
  ar.OptionalSinceVersion("initial_source", sensor.initial_source);
  if constexpr (Archive::kReading) {  // of earlier files
    std::string refinement;
    double rms = 0;
    ar.Optional("refinement", refinement);
    ar.IfFinite("rms_together_m", rms);
    ar.IfFinite("rms_alone_m", rms);
  }
  ar.Optional("prior", sensor.prior);
  if (sensor.prior) ar("prior_used", sensor.prior_used);
  ar.Optional("together", sensor.together);
  ar.Optional("disagrees_with", sensor.disagrees_with);
  ar.IfFinite("disagreement", sensor.disagreement);
  ar("sides", sensor.sides);
  ar("points", sensor.points);
  ar.IfFinite("rms_to_structure_m", sensor.rms_to_structure_m);
  ar.IfFinite("initial_rms_to_structure_m", sensor.initial_rms_to_structure_m);
  ar.IfFinite("inlier_share", sensor.inlier_share);
  ar.IfFinite("miou", sensor.miou);
  ar.IfFinite("label_iou", sensor.label_iou);
  ar.IfFinite("explained_share", sensor.explained_share);
  ar.IfFinite("depth_offset_m", sensor.depth_offset_m);
  // The first files have no gain.
  ar.IfFinite("depth_gain", sensor.depth_gain, 1.0);
  ar.IfFinite("sigma_depth_offset_m", sensor.sigma_depth_offset_m);
  ar.IfFinite("sigma_depth_gain", sensor.sigma_depth_gain);
  // Values that follow from the covariance are read and dropped.
  std::vector<std::string> unconstrained;
  if (!Archive::kReading && sensor.covariance.allFinite()) {
    unconstrained = UnconstrainedDirections(sensor.covariance);
  }
  ar.Optional("unconstrained", unconstrained);
  ar.IfFinite("covariance", sensor.covariance);
  if constexpr (Archive::kReading) {  // of earlier files: the covariance says it
    Eigen::Vector3d dropped;
    ar.IfFinite("sigma_translation_m", dropped);
  }
  Eigen::Vector3d sigma_position_m = sensor.sigma_position_m();
  Eigen::Vector3d sigma_rotation_deg = sensor.sigma_rotation_deg();
  ar.IfFinite("sigma_position_m", sigma_position_m);
  ar.IfFinite("sigma_rotation_deg", sigma_rotation_deg);
  ar.Optional("error", sensor.error);
  ar.Optional("initial_error", sensor.initial_error);
}

template <class Archive>
void Describe(Archive& ar, AssemblyReport& assembly) {
  Arrangement& found = assembly.arrangement;
  ar.Optional("code", found.code);
  ar("sentence", found.sentence);
  ar.Optional("box", found.box);
  ar.Optional("other_box", found.other_box);
  ar.Optional("turn_deg", found.turn_deg);
  ar.IfFinite("overlap", assembly.share);
  ar.IfFinite("described_overlap", assembly.described_share);
}

template <class Archive>
void Describe(Archive& ar, RigFinding& finding) {
  ar("code", finding.code);
  ar.Optional("about", finding.about);
  ar("reason", finding.reason);
  ar("hint", finding.hint);
}

template <class Archive>
void Describe(Archive& ar, PairResult& pair) {
  ar("a", pair.a);
  ar("b", pair.b);
  ar.IfFinite("overlap", pair.overlap);
  ar.IfFinite("rms_m", pair.rms_m);
  ar.IfFinite("predicted_rms_m", pair.predicted_rms_m);
  ar.IfFinite("covariance", pair.covariance);
  ar.IfFinite("sigma_m", pair.sigma_m);
  ar.IfFinite("sigma_deg", pair.sigma_deg);
}

template <class Archive>
void Describe(Archive& ar, SensorAlternative& sensor) {
  ar.Optional("twin", sensor.number);
  ar("structure_from_sensor", sensor.structure_from_sensor);
}

template <class Archive>
void Describe(Archive& ar, RigAlternative& alternative) {
  ar("log_odds", alternative.log_odds);
  ar.Optional("placement", alternative.capture);
  ar.ByName("sensors", alternative.sensors, &SensorAlternative::name);
}

template <class Archive>
void Describe(Archive& ar, SetDistances& distances) {
  ar.IfFinite("d1_m", distances.d1);
  ar.IfFinite("d2_m", distances.d2);
}

}  // namespace volalign
