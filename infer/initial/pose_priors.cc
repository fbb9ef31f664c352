#include "infer/initial/pose_priors.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

#include "core/base/odds.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// The pose that a sensor has, and its prior.
struct Match {
  const PosePrior* prior;
  const Pose* pose;
};

/// The similarity that brings the priors of these sensors onto their poses, by least squares: each
/// sensor's position, and the points on its axes at which a turn by sigma_deg is as far as sigma_m.
WorldPlacement Fit(const std::vector<Match>& matches, WorldPlacement start) {
  const bool free_scale = matches.front().prior->world == PriorWorld::kScaleFree;
  const auto count = static_cast<Eigen::Index>(matches.size());
  for (int round = 0; round < kRounds; ++round) {
    Eigen::Matrix3Xd from(3, 7 * count), to(3, 7 * count);
    for (Eigen::Index k = 0; k < count; ++k) {
      const auto& [prior, pose] = matches[static_cast<std::size_t>(k)];
      const double arm = prior->sigma_m / (prior->sigma_deg * kDegree);
      Eigen::Matrix<double, 3, 7> axes;
      axes << Eigen::Vector3d::Zero(), arm * Eigen::Matrix3d::Identity(),
          -arm * Eigen::Matrix3d::Identity();
      from.middleCols<7>(7 * k) = (prior->world_from_sensor.linear() * axes).colwise() +
                                  start.scale * prior->world_from_sensor.translation();
      to.middleCols<7>(7 * k) = (pose->linear() * axes).colwise() + pose->translation();
    }
    start.structure_from_world.matrix() = Eigen::umeyama(from, to, false);
    if (!free_scale || count < 2) break;
    // The sensors' positions alone tell the scale.
    Eigen::Matrix3Xd before(3, count), after(3, count);
    for (Eigen::Index k = 0; k < count; ++k) {
      const auto& [prior, pose] = matches[static_cast<std::size_t>(k)];
      before.col(k) = start.structure_from_world.linear() * prior->world_from_sensor.translation();
      after.col(k) = pose->translation();
    }
    before.colwise() -= before.rowwise().mean().eval();
    after.colwise() -= after.rowwise().mean().eval();
    if (before.squaredNorm() > 0)
      start.scale = std::abs(before.cwiseProduct(after).sum()) / before.squaredNorm();
  }
  return start;
}

/// Half the squared distance of a sensor's pose from the expected one, in standard deviations of
/// the prior. Both poses are structure_from_sensor.
double PriorMisfit(const PosePrior& prior, const Pose& expected, const Pose& pose) {
  const PoseError apart = ComparePoses(expected, pose);
  return (std::pow(apart.translation_m / prior.sigma_m, 2) +
          std::pow(apart.rotation_deg / prior.sigma_deg, 2)) /
         2;
}

/// A sensor's most likely pose if the world lies here, and its log likelihood.
std::pair<double, const Pose*> Likeliest(const PosePrior& prior, const std::vector<Pose>& poses,
                                         const WorldPlacement& world) {
  const Pose expected = world.Place(prior.world_from_sensor);
  std::pair<double, const Pose*> best{-std::numeric_limits<double>::infinity(), nullptr};
  for (const Pose& pose : poses)
    best = std::max(best, {-PriorMisfit(prior, expected, pose), &pose},
                    [](const auto& a, const auto& b) { return a.first < b.first; });
  return best;
}

/// Logarithm of how much more probable a pose at the expected place is by the prior than by a prior
/// that is wrong.
double LogOddsOfWrong(const PosePrior& prior) {
  const double anywhere = std::pow(kFarthest, 3) * 8 * M_PI * M_PI;  // m^3 rad^3: all poses
  const double spread = 2 * M_PI * prior.sigma_m * prior.sigma_deg * kDegree;
  return std::max(0.0, std::log(kUnusualOdds * anywhere / std::pow(spread, 3)));
}

}  // namespace

Pose WorldPlacement::Place(const Pose& world_from_sensor) const {
  Pose scaled = world_from_sensor;
  scaled.translation() *= scale;
  return structure_from_world * scaled;
}

double PriorLogLikelihood(const PosePrior& prior, const Pose& expected, const Pose& pose) {
  return -std::min(PriorMisfit(prior, expected, pose), LogOddsOfWrong(prior));
}

std::vector<WorldPlacement> FindWorlds(const std::vector<const PosePrior*>& priors,
                                       const std::vector<std::vector<Pose>>& poses) {
  const auto given = std::find_if(priors.begin(), priors.end(),
                                  [](const PosePrior* prior) { return prior != nullptr; });
  if (given == priors.end()) return {};
  const PriorWorld kind = (*given)->world;
  if (kind == PriorWorld::kStructure) return {WorldPlacement()};
  std::vector<std::size_t> known;
  for (std::size_t i = 0; i < priors.size(); ++i) {
    if (priors[i] && !poses[i].empty()) known.push_back(i);
  }
  if (kind == PriorWorld::kScaleFree && known.size() < 3) return {};

  std::vector<WorldPlacement> starts;
  for (const std::size_t i : known) {
    for (const Pose& pose : poses[i]) {
      const Match first{priors[i], &pose};
      if (kind == PriorWorld::kMetric) {
        starts.push_back(Fit({first}, {}));
        continue;
      }
      for (const std::size_t j : known) {
        if (j <= i) continue;
        for (const Pose& other : poses[j]) starts.push_back(Fit({first, {priors[j], &other}}, {}));
      }
    }
  }
  std::vector<std::pair<double, WorldPlacement>> found;
  for (WorldPlacement& world : starts) {
    double likelihood = 0;
    // A start by one sensor or two is inexact elsewhere: the nearest poses first, then the likely.
    for (int round = 0; round < kRounds; ++round) {
      std::vector<Match> matches;
      likelihood = 0;
      for (const std::size_t i : known) {
        const auto [log_likelihood, pose] = Likeliest(*priors[i], poses[i], world);
        const double wrong = -LogOddsOfWrong(*priors[i]);
        likelihood += std::max(log_likelihood, wrong);
        if (round == 0 || log_likelihood > wrong) matches.push_back({priors[i], pose});
      }
      if (matches.empty() || round == kRounds - 1) break;
      world = Fit(matches, world);
    }
    found.emplace_back(likelihood, world);
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<WorldPlacement> worlds;
  for (const auto& [likelihood, world] : found) {
    const auto is_same = [&, &found_world = world](const WorldPlacement& other) {
      const PoseError apart =
          ComparePoses(other.structure_from_world, found_world.structure_from_world);
      return apart.translation_m < kSamePlace && apart.rotation_deg < 1 &&
             std::abs(std::log(other.scale / found_world.scale)) < kSamePlace;
    };
    if (std::none_of(worlds.begin(), worlds.end(), is_same)) worlds.push_back(world);
    if (worlds.size() == kBeam) break;
  }
  return worlds;
}

}  // namespace volalign
