#include "infer/report/world_frame.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/text.h"
#include "core/geometry/procrustes.h"
#include "core/json/json_archive.h"

namespace volalign {

namespace {

constexpr char kWorldFormat[] = "volalign.world/1";
constexpr int kIterations = 10;
/// Least turns of the carrier, deg, root mean square about the second axis.
constexpr double kLeastTurn = 5;
/// rad: the axis of a larger turn may have either sign.
constexpr double kMostTurn = 170 * kDegree;

}  // namespace

template <class Archive>
void Describe(Archive& ar, TouchedPoint& point) {
  ar("box", point.box);
  ar("corner", point.corner);
  ar("xyz_m", point.xyz_m);
}

template <class Archive>
void Describe(Archive& ar, WorldObservation& world) {
  ar.Constant("format", kWorldFormat);
  ar("name", world.name);
  ar.Optional("world_from_structure", world.world_from_structure);
  ar.Optional("points", world.points);
  ar.Optional("world_from_carrier", world.world_from_carrier);
  ar("sigma_m", world.sigma_m);
  if (world.points.empty()) ar("sigma_deg", world.sigma_deg);
}

WorldObservation ReadWorldObservation(const std::filesystem::path& path) {
  auto world = ReadDescribed<WorldObservation>(ReadFile(path, kMaxResultBytes), path.string());
  RequirePlainName(world.name, path.string());
  if (world.name.empty()) throw DataError(fmt::format("{}: name is empty", path.string()));
  const int given = (world.world_from_structure ? 1 : 0) + (world.points.empty() ? 0 : 1) +
                    (world.world_from_carrier.empty() ? 0 : 1);
  if (given != 1) {
    throw DataError(fmt::format(
        "{}: exactly one of world_from_structure, points and world_from_carrier is needed",
        path.string()));
  }
  if (!(world.sigma_m > 0) || (world.points.empty() && !(world.sigma_deg > 0))) {
    throw DataError(
        fmt::format("{}: sigma_m, and sigma_deg of poses, have to be above 0", path.string()));
  }
  return world;
}

namespace {

Matrix6d CovarianceOf(const WorldObservation& observation) {
  const double turn = observation.sigma_deg * kDegree;
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(observation.sigma_m * observation.sigma_m),
      Eigen::Vector3d::Constant(turn * turn);
  return variances.asDiagonal();
}

/// The factor on variances that residuals show; at least 1.
double VarianceFactor(double squares, double freedoms) {
  return freedoms > 0 ? std::max(1.0, squares / freedoms) : 1;
}

Eigen::Vector3d CornerOf(const TouchedPoint& point, const Structure& nominal,
                         const Structure& built) {
  const std::vector<Box>& boxes = nominal.boxes();
  const auto found = std::find_if(boxes.begin(), boxes.end(),
                                  [&](const Box& box) { return box.name == point.box; });
  if (found == boxes.end())
    throw ConfigError(fmt::format("--world: no box is named \"{}\"", Shortened(point.box)));
  if (point.corner.size() != 3 || point.corner.find_first_not_of("+-") != std::string::npos) {
    throw ConfigError(fmt::format(
        "--world: a corner is three signs, of the box's x, y and z, as \"+-+\", and not \"{}\"",
        Shortened(point.corner)));
  }
  const Box& box = built.boxes()[static_cast<std::size_t>(found - boxes.begin())];
  if (box.mesh) {
    throw ConfigError(fmt::format(
        "--world: \"{}\" is a mesh, which has no corners with names; give world_from_structure",
        Shortened(point.box)));
  }
  Eigen::Vector3d corner = 0.5 * box.size;
  for (int i = 0; i < 3; ++i)
    if (point.corner[static_cast<std::size_t>(i)] == '-') corner[i] = -corner[i];
  return box.structure_from_box * corner;
}

WorldFrame FromPoints(const WorldObservation& observation, const Structure& nominal,
                      const Structure& built) {
  std::vector<Eigen::Vector3d> corners, points;
  for (const TouchedPoint& point : observation.points) {
    corners.push_back(CornerOf(point, nominal, built));
    points.push_back(point.xyz_m);
  }
  if (points.size() < 3 || SecondSingularValue(corners) < kMinSecondSingularValue) {
    throw ConfigError(
        "--world: the points do not fix a frame; it takes three corners that are not on one line");
  }
  const ProcrustesResult fit = AlignPoints(corners, points);
  WorldFrame world;
  world.world_from_structure = fit.target_from_source;
  world.rms_m = fit.rms;
  Matrix6d information = Matrix6d::Zero();
  for (const Eigen::Vector3d& corner : corners) {
    Eigen::Matrix<double, 3, 6> by_delta;
    by_delta << Eigen::Matrix3d::Identity(), -Cross(fit.target_from_source * corner);
    information += by_delta.transpose() * by_delta;
  }
  const double variance = observation.sigma_m * observation.sigma_m;
  const auto count = static_cast<double>(points.size());
  world.covariance = information.inverse() * variance *
                     VarianceFactor(fit.rms * fit.rms * count / variance, 3 * count - 6);
  return world;
}

/// A capture with the structure on its carrier.
struct Carried {
  Pose world_from_carrier, first_from_placement;
  Matrix6d covariance;  ///< of the difference, world frame
};

/// X of C_i X = W T_i by the motions between all pairs of captures.
Pose CarrierFromStructure(const std::vector<Carried>& captures) {
  Eigen::Matrix3d turns = Eigen::Matrix3d::Zero();
  std::vector<std::pair<Pose, Pose>> motions;  // of the carrier, of the structure
  for (std::size_t i = 0; i < captures.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const Pose a = captures[i].world_from_carrier.inverse() * captures[j].world_from_carrier;
      const Pose b = captures[i].first_from_placement.inverse() * captures[j].first_from_placement;
      const Eigen::Vector3d of_a = RotationLog(a.linear()), of_b = RotationLog(b.linear());
      if (of_a.norm() < kMostTurn && of_b.norm() < kMostTurn) turns += of_a * of_b.transpose();
      motions.emplace_back(a, b);
    }
  }
  turns /= kDegree * kDegree * static_cast<double>(motions.size());
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(turns, Eigen::ComputeFullU | Eigen::ComputeFullV);
  if (!(svd.singularValues()[1] > kLeastTurn * kLeastTurn)) {
    throw ConfigError(
        "--world: the carrier has to be turned about two axes, by 10 to 170 degrees, between the "
        "captures. Other turns do not show where it holds the structure");
  }
  Eigen::Vector3d signs(1, 1, (svd.matrixU() * svd.matrixV().transpose()).determinant());
  Pose x = Pose::Identity();
  x.linear() = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  Eigen::MatrixXd rows(3 * motions.size(), 3);
  Eigen::VectorXd values(3 * motions.size());
  for (std::size_t m = 0; m < motions.size(); ++m) {
    const auto& [a, b] = motions[m];
    const auto row = static_cast<Eigen::Index>(3 * m);
    rows.middleRows<3>(row) = a.linear() - Eigen::Matrix3d::Identity();
    values.segment<3>(row) = x.linear() * b.translation() - a.translation();
  }
  x.translation() = rows.colPivHouseholderQr().solve(values);
  return x;
}

WorldFrame FromCarrier(const WorldObservation& observation, const CalibrationResult& result) {
  std::vector<Carried> captures;
  if (observation.world_from_carrier.size() != result.captures.size()) {
    throw ConfigError(fmt::format(
        "--world: it has {} poses of the carrier, and there {} {} "
        "capture{}; each capture needs one",
        observation.world_from_carrier.size(), result.captures.size() > 1 ? "are" : "is",
        std::max<std::size_t>(result.captures.size(), 1), result.captures.size() > 1 ? "s" : ""));
  }
  for (std::size_t i = 0; i < result.captures.size(); ++i) {
    const CaptureResult& capture = result.captures[i];
    const bool placed =
        std::any_of(capture.sensors.begin(), capture.sensors.end(),
                    [](const FrameResult& sensor) { return sensor.structure_from_sensor; });
    if (placed)
      captures.push_back(
          {observation.world_from_carrier[i], capture.first_from_placement, capture.covariance});
  }
  if (captures.size() < 3) {
    throw ConfigError(
        "--world: world_from_carrier takes three captures in which a sensor is placed");
  }
  Pose x = CarrierFromStructure(captures);
  Pose w = captures[0].world_from_carrier * x * captures[0].first_from_placement.inverse();
  const Matrix6d of_carrier = CovarianceOf(observation), turn = Adjoint(w);
  for (Carried& capture : captures) {
    // The carrier's sigmas are of its own position and rotation.
    Pose here = Pose::Identity();
    here.translation() = capture.world_from_carrier.translation();
    capture.covariance = turn * capture.covariance * turn.transpose() +
                         Adjoint(here) * of_carrier * Adjoint(here).transpose();
  }
  Eigen::Matrix<double, 12, 12> information;
  double residuals = 0;  // sum of their squares, in standard deviations
  for (int iteration = 0; iteration <= kIterations; ++iteration) {
    information.setZero();
    residuals = 0;
    Eigen::Matrix<double, 12, 1> pull = Eigen::Matrix<double, 12, 1>::Zero();
    for (const auto& [carrier, placement, covariance] : captures) {
      const Vector6d difference = LeftDifference(w * placement, carrier * x);
      Eigen::Matrix<double, 6, 12> by_delta;
      by_delta << Matrix6d::Identity(), -Adjoint(carrier);
      const Matrix6d weight = covariance.inverse();
      information += by_delta.transpose() * weight * by_delta;
      pull += by_delta.transpose() * weight * difference;
      residuals += difference.dot(weight * difference);
    }
    if (iteration == kIterations) break;
    const Eigen::Matrix<double, 12, 1> delta = information.ldlt().solve(pull);
    w = PerturbLeft(delta.head<6>(), w);
    x = PerturbLeft(delta.tail<6>(), x);
  }
  WorldFrame world;
  world.world_from_structure = w;
  world.carrier_from_structure = x;
  world.covariance = information.inverse().topLeftCorner<6, 6>() *
                     VarianceFactor(residuals, 6.0 * static_cast<double>(captures.size()) - 12);
  double squares = 0;
  for (const Carried& capture : captures) {
    squares += (capture.world_from_carrier * x * Eigen::Vector3d::Zero() -
                w * capture.first_from_placement * Eigen::Vector3d::Zero())
                   .squaredNorm();
  }
  world.rms_m = std::sqrt(squares / static_cast<double>(captures.size()));
  return world;
}

}  // namespace

namespace {

/// Throws ConfigError if the observation contradicts the structure or itself.
void RequireFit(const WorldFrame& world, double sigma_m) {
  constexpr double kMostOff = 0.03;  // m, beside ten standard deviations
  if (world.rms_m && !(*world.rms_m < kMostOff + 10 * sigma_m)) {
    throw ConfigError(fmt::format(
        "--world: its positions are {:.3g} m (RMS) from where they should be. Check that they are "
        "in metres, in a right-handed frame, and of the right corners or captures",
        *world.rms_m));
  }
  if (!world.covariance.allFinite() || !world.world_from_structure.matrix().allFinite())
    throw ConfigError("--world: its numbers are too large or too small");
}

}  // namespace

WorldFrame FindWorldFrame(const WorldObservation& observation, const CalibrationResult& result,
                          const Structure& structure) {
  WorldFrame world;
  if (!observation.points.empty()) {
    world =
        FromPoints(observation, structure, result.built.boxes().empty() ? structure : result.built);
  } else if (!observation.world_from_carrier.empty()) {
    world = FromCarrier(observation, result);
  } else {
    world.world_from_structure = *observation.world_from_structure;
    Pose here = Pose::Identity();
    here.translation() = world.world_from_structure.translation();
    world.covariance = Adjoint(here) * CovarianceOf(observation) * Adjoint(here).transpose();
  }
  world.name = observation.name;
  RequireFit(world, observation.sigma_m);
  return world;
}

std::string WorldSentence(const WorldFrame& world) {
  const Eigen::Vector3d& t = world.world_from_structure.translation();
  std::string text = fmt::format(
      "the structure stands at {:+.3f}, {:+.3f}, {:+.3f} m in {} (sigma {:.1f} mm, {:.2f} deg)",
      t.x(), t.y(), t.z(), world.name,
      1000 * SigmaPosition(world.world_from_structure, world.covariance).maxCoeff(),
      SigmaRotationDeg(world.covariance).maxCoeff());
  if (world.rms_m) text += fmt::format("; the fit leaves {:.1f} mm RMS", 1000 * *world.rms_m);
  return text;
}

Matrix6d CovarianceInWorld(const WorldFrame& world, const Matrix6d& covariance) {
  const Matrix6d turn = Adjoint(world.world_from_structure);
  return turn * covariance * turn.transpose() + world.covariance;
}

}  // namespace volalign
