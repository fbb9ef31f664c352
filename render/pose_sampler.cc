#include "render/pose_sampler.h"

#include <cmath>

#include "core/base/error.h"
#include "core/geometry/point_in_ball.h"

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
  const Eigen::Vector3d position(rho * std::cos(phi), y, rho * std::sin(phi));

  const Eigen::Vector3d target = PointInBall(0.01 * config.look_at_radius_cm, random);
  const double roll = random.Uniform(-config.roll_deg, config.roll_deg);
  const double offset = config.roll_offsets_deg[static_cast<std::size_t>(
      random.Below(static_cast<int>(config.roll_offsets_deg.size())))];
  return LookAt(position, target, (roll + offset) * M_PI / 180);
}

}  // namespace volalign
