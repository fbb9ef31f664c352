#include "render/pose_sampler.h"

#include <cmath>

#include "core/base/error.h"
#include "core/base/portable_math.h"

namespace volalign {

namespace {

double SampleAzimuth(const PoseConfig& config, RandomStream& random) {
  if (config.phi_deg.empty()) return random.Uniform(0, 2 * M_PI);
  const double azimuth =
      config
          .phi_deg[static_cast<std::size_t>(random.Below(static_cast<int>(config.phi_deg.size())))];
  return (azimuth + random.Uniform(-config.phi_jitter_deg, config.phi_jitter_deg)) * M_PI / 180;
}

}  // namespace

Pose SamplePose(const PoseConfig& config, RandomStream& random) {
  if (config.roll_offsets_deg.empty()) {
    throw ConfigError(
        "pose.roll_offsets_deg = [] has no mounting roll; give at least one, e.g. [90]");
  }
  const double rho = 0.01 * random.Uniform(config.rho_cm[0], config.rho_cm[1]);
  const double phi = SampleAzimuth(config, random);
  const double y = 0.01 * random.Uniform(config.height_cm[0], config.height_cm[1]);
  const SinCos place = PortableSinCos(phi);
  const Eigen::Vector3d position(rho * place.cos, y, rho * place.sin);

  const double cos_polar = random.Uniform(-1, 1);
  const double azimuth = random.Uniform(0, 2 * M_PI);
  const double radius = 0.01 * config.look_at_radius_cm * PortableCbrt(random.Uniform());
  const double sin_polar = std::sqrt(1 - cos_polar * cos_polar);
  const SinCos aside = PortableSinCos(azimuth);
  const Eigen::Vector3d target =
      radius * Eigen::Vector3d(sin_polar * aside.cos, cos_polar, sin_polar * aside.sin);

  const double roll = random.Uniform(-config.roll_deg, config.roll_deg);
  const double offset = config.roll_offsets_deg[static_cast<std::size_t>(
      random.Below(static_cast<int>(config.roll_offsets_deg.size())))];
  return LookAt(position, target, (roll + offset) * M_PI / 180);
}

}  // namespace volalign
