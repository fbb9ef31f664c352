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

}  // namespace
}  // namespace volalign
