// Structures of which a sensor sees little, before backgrounds that give no depth.

#include <gtest/gtest.h>

#include <string>

#include "infer/calibrate.h"
#include "infer/io/report.h"
#include "tests/infer/synthetic.h"

namespace volalign {
namespace {

using testing_infer::AddNoise;
using testing_infer::CalibrateRig;
using testing_infer::LeaveGaps;
using testing_infer::PaperStructure;
using testing_infer::Rig;
using testing_infer::RingPose;
using testing_infer::Scene;

/// In front of the sides that face along +z, below the top of the lowest box.
Pose Frontal(double x, double y, double rho, double roll) {
  return RingPose(90, rho, y, roll, {x, -0.1, 0});
}

TEST(Background, Four) {
  for (const int most : {0, 2, 4}) {
    for (int k = 0; k < 4; ++k) {
      Rig rig{PaperStructure(), {}, {}};
      Pose pose = Frontal(-0.1, -0.6, 2.0 + 0.1 * k, 90 + 2 * k);
      pose.translation().x() = -0.1;
      rig.Add("S", pose, {false, 0});
      LeaveGaps(&rig.frames[0].depth, &rig.labels[0], most > 0, most, k);
      AddNoise(&rig.frames[0].depth, 0.002, k);
      const CalibrationResult result = CalibrateRig(rig);
      const SensorResult& s = result.sensors[0];
      std::printf("most %d k %d: %s %s | %s | err %.1f mm %.2f deg sig %s sides", most, k, ToString(s.status), ToString(s.code), s.reason.c_str(),
        s.error ? 1000 * s.error->translation_m : -1, s.error ? s.error->rotation_deg : -1, s.structure_from_sensor ? std::to_string(1000*s.sigma_translation_m().maxCoeff()).c_str() : "");
      for (auto& e : s.sides) std::printf(" %s", e.c_str());
      if (s.error) { Eigen::Vector3d d = s.structure_from_sensor->translation() - rig.frames[0].ground_truth->translation(); std::printf(" d %.1f %.1f %.1f s %.1f %.1f %.1f", 1000*d.x(),1000*d.y(),1000*d.z(), 1000*s.sigma_translation_m()[0],1000*s.sigma_translation_m()[1],1000*s.sigma_translation_m()[2]);}
      std::printf("\n");
    }
  }
}


void Show(const char* what, int k, const CalibrationResult& result) {
  for (const SensorResult& s : result.sensors)
    std::printf("%s %d %s: %s %s | %s | err %.1f mm %.2f deg sig %.1f acc %d rms %.2f\n", what, k, s.name.c_str(), ToString(s.status), ToString(s.code), s.reason.c_str(),
          s.error ? 1000 * s.error->translation_m : -1, s.error ? s.error->rotation_deg : -1, s.structure_from_sensor ? 1000 * s.sigma_translation_m().maxCoeff() : -1, s.refinement_accepted, 1000*s.rms_to_structure_m);
  for (auto& [n, t] : result.timings_s) std::printf("%s %.2f ", n.c_str(), t);
  std::printf("\n");
}

TEST(Background, Neighbours) {
  for (const bool room : {true, false}) {
    for (int k = 0; k < 4; ++k) {
      Rig rig{PaperStructure(), {}, {}};
      for (int i = 0; i < 3; ++i)
        rig.Add("S" + std::to_string(i), RingPose(25.0 + 110 * i + 10 * k), room ? Scene{true, 3.5} : Scene{false, 0});
      rig.Add("S3", RingPose(90, 2.0, 0.3, 90, Eigen::Vector3d(k % 2 ? 0.6 : -1.1, 0, 0)), room ? Scene{true, 3.5} : Scene{false, 0});
      if (k < 3) {
      testing_infer::Restrict(rig.structure, &rig.labels[3], [&](const Side& side) {
        return k == 2 ? side.name == "mid_top/right" : side.name == "mid_bottom/right" || side.name == "mid_top/right" || side.name == "bottom/right";
      });
      } else {
       // in fact sees little: close, one side fills the view
       rig.frames.pop_back(); rig.labels.pop_back();
       rig.Add("S3", RingPose(90, 0.9, -0.1, 90, Eigen::Vector3d(-0.1, -0.1, 0)), room ? Scene{true, 3.5} : Scene{false, 0});
      }
      for (std::size_t i = 0; i < 4; ++i) AddNoise(&rig.frames[i].depth, 0.002, i);
      Show(room ? "room" : "none", k, CalibrateRig(rig));
    }
  }
}

TEST(Background, Mirrored) {
  for (int k = 0; k < 4; ++k) {
    Rig rig{PaperStructure(), {}, {}};
    for (int i = 0; i < 4; ++i)
      rig.Add("S" + std::to_string(i), RingPose(25.0 + 90 * i + 13 * k), {true, 3.5});
    for (std::size_t i = 0; i < 4; ++i) {
      AddNoise(&rig.frames[i].depth, 0.002, i);
      if (k == 0 || static_cast<int>(i) < k) testing_infer::FlipFrame(rig.structure, &rig.frames[i], &rig.labels[i]);
    }
    const CalibrationResult result = CalibrateRig(rig);
    Show("mirrored", k, result);
    std::printf("%s\n", FormatReport(result).c_str());
  }
}

}  // namespace
}  // namespace volalign
