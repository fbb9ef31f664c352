#include "infer/rigcheck/movement.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>
#include <set>
#include <unsupported/Eigen/SpecialFunctions>
#include <utility>

#include "core/base/error.h"

namespace volalign {

namespace {

constexpr int kFreedoms = 6;      // of a pose
constexpr double kPower = 1.645;  // 95 % of a normal distribution exceed -kPower
constexpr int kMotionIterations = 4;
/// m and deg: most error of a place and aim with another sensor's intrinsics.
constexpr double kSameStand = 0.15, kSameAim = 5;

/// The sensor whose last pose is about this one, or null.
const SensorEstimate* NearestPlace(const std::vector<SensorEstimate>& last, const Pose& pose) {
  const SensorEstimate* nearest = nullptr;
  double distance = kSameStand;
  for (const SensorEstimate& sensor : last) {
    const PoseError apart = ComparePoses(pose, sensor.structure_from_sensor);
    if (apart.translation_m > distance || apart.rotation_deg > kSameAim) continue;
    distance = apart.translation_m;
    nearest = &sensor;
  }
  return nearest;
}

/// Probability that the sum of squares of `kFreedoms` standard normal numbers exceeds `square`.
double ChiSquareTail(double square) {
  return Eigen::numext::igammac(0.5 * kFreedoms, 0.5 * std::max(square, 0.0));
}

/// The same if `square` was divided by a variance that `freedoms` others show.
double FTail(double square, double freedoms) {
  return Eigen::numext::betainc(0.5 * freedoms, 0.5 * kFreedoms,
                                freedoms / (freedoms + std::max(square, 0.0)));
}

/// Two poses of one sensor, compared through a motion of the structure.
struct PosePair {
  const SensorEstimate* last;
  const SensorEstimate* now;

  Pose Now(const Pose& last_from_now) const { return last_from_now * now->structure_from_sensor; }
  Vector6d Difference(const Pose& last_from_now) const {
    return LeftDifference(Now(last_from_now), last->structure_from_sensor);
  }
  Matrix6d NowCovariance(const Pose& last_from_now) const {
    const Matrix6d turn = Adjoint(last_from_now);
    return turn * now->covariance * turn.transpose();
  }
  Matrix6d Covariance(const Pose& last_from_now) const {
    return last->covariance + NowCovariance(last_from_now);
  }
};

double Square(const Vector6d& difference, const Matrix6d& covariance) {
  return difference.dot(covariance.ldlt().solve(difference));
}

/// The structure's motion by a set of sensors that stayed.
struct Motion {
  Pose last_from_now = Pose::Identity();
  Matrix6d covariance = Matrix6d::Zero();
  double squares = 0;  ///< of their differences, in standard deviations
  std::size_t sensors = 0;

  double freedoms() const { return kFreedoms * (static_cast<double>(sensors) - 1); }
  double VarianceFactor(const MovementOptions& options) const {
    if (sensors < 2) return 1;
    return std::clamp(squares / freedoms(), options.least_variance_factor, 1.0);
  }
  /// Probability of the difference of another sensor, if it stayed too. `square`: with the
  /// covariances of both captures and of the motion.
  double Probability(double square, const MovementOptions& options) const {
    const double expected = ChiSquareTail(square);
    const double factor = VarianceFactor(options);
    return factor < 1 ? std::min(expected, FTail(square / factor, freedoms())) : expected;
  }
};

using Set = std::vector<std::size_t>;

Motion FitMotion(const std::vector<PosePair>& pairs, const Set& set, const Pose& start) {
  Motion motion;
  motion.last_from_now = start;
  motion.sensors = set.size();
  for (int iteration = 0; iteration <= kMotionIterations; ++iteration) {
    Matrix6d information = Matrix6d::Zero();
    Vector6d pull = Vector6d::Zero();
    motion.squares = 0;
    for (const std::size_t i : set) {
      const Vector6d difference = pairs[i].Difference(motion.last_from_now);
      const Matrix6d weight = pairs[i].Covariance(motion.last_from_now).inverse();
      information += weight;
      pull += weight * difference;
      motion.squares += difference.dot(weight * difference);
    }
    motion.covariance = information.inverse();
    if (iteration < kMotionIterations)
      motion.last_from_now = PerturbLeft(motion.covariance * pull, motion.last_from_now);
  }
  return motion;
}

/// Probability that sensor i, which is not one of the motion's, is so far from it by chance.
double Probability(const std::vector<PosePair>& pairs, std::size_t i, const Motion& motion,
                   const MovementOptions& options) {
  const Matrix6d covariance = pairs[i].Covariance(motion.last_from_now) + motion.covariance;
  return motion.Probability(Square(pairs[i].Difference(motion.last_from_now), covariance), options);
}

Set Without(const Set& set, std::size_t i) {
  Set others;
  std::copy_if(set.begin(), set.end(), std::back_inserter(others),
               [i](std::size_t other) { return other != i; });
  return others;
}

/// The sensors that agree with sensor `first` on one motion. The nearest ones are added one by one,
/// as long as any agrees. Then those that the others contradict are removed again.
Set Agreeing(const std::vector<PosePair>& pairs, std::size_t first,
             const MovementOptions& options) {
  Set set{first};
  Motion motion = FitMotion(
      pairs, set,
      pairs[first].last->structure_from_sensor * pairs[first].now->structure_from_sensor.inverse());
  while (set.size() < pairs.size()) {
    std::size_t nearest = pairs.size();
    double best = options.false_alarm;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      if (std::find(set.begin(), set.end(), i) != set.end()) continue;
      const double probability = Probability(pairs, i, motion, options);
      if (probability > best) {
        nearest = i;
        best = probability;
      }
    }
    if (nearest == pairs.size()) break;
    set.push_back(nearest);
    motion = FitMotion(pairs, set, motion.last_from_now);
  }
  std::sort(set.begin(), set.end());
  while (set.size() > 2) {
    std::pair<double, std::size_t> worst{1, 0};
    for (const std::size_t i : set) {
      const Motion others = FitMotion(pairs, Without(set, i), motion.last_from_now);
      worst = std::min(worst, {Probability(pairs, i, others, options), i});
    }
    if (worst.first >= options.false_alarm) break;
    set = Without(set, worst.second);
  }
  return set;
}

struct Sets {
  Set stayed;     ///< in every largest set that agrees; empty if these are at most half
  Set contested;  ///< only in some of these sets
};

Sets LargestSets(const std::vector<PosePair>& pairs, const MovementOptions& options) {
  std::vector<Set> largest;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    Set set = Agreeing(pairs, i, options);
    if (!largest.empty() && set.size() < largest.front().size()) continue;
    if (!largest.empty() && set.size() > largest.front().size()) largest.clear();
    largest.push_back(std::move(set));
  }
  Sets sets;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const auto in =
        static_cast<std::size_t>(std::count_if(largest.begin(), largest.end(), [i](const Set& set) {
          return std::binary_search(set.begin(), set.end(), i);
        }));
    if (in == largest.size()) {
      sets.stayed.push_back(i);
    } else if (in > 0) {
      sets.contested.push_back(i);
    }
  }
  const std::size_t least = options.one_may_stay && pairs.size() == 1 ? 1 : 2;
  if (2 * sets.stayed.size() <= pairs.size() || sets.stayed.size() < least) sets.stayed.clear();
  return sets;
}

/// The mean square, in standard deviations, of a movement that the test finds with 95 %
/// probability. By the normal approximation of the noncentral chi-square distribution.
double FoundSquare(const Motion& motion, const MovementOptions& options) {
  double low = 0, high = 1e6;  // the square at which the test's probability is false_alarm
  for (int i = 0; i < 100; ++i) {
    const double middle = (low + high) / 2;
    (motion.Probability(middle, options) > options.false_alarm ? low : high) = middle;
  }
  const double factor = motion.VarianceFactor(options), limit = high / factor;
  // limit = k + l - p sqrt(2 (k + 2 l)), solved for l.
  const double m = limit - kFreedoms, p2 = kPower * kPower;
  return factor * (m + 2 * p2 + kPower * std::sqrt(4 * m + 4 * p2 + 2 * kFreedoms));
}

/// Standard deviation, m or rad, in the least certain direction of a movement with the derivatives
/// `directions`.
double LargestSigma(const Matrix6d& information, const Eigen::Matrix<double, 6, 3>& directions) {
  const Eigen::Matrix3d of_movement = directions.transpose() * information * directions;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(of_movement, Eigen::EigenvaluesOnly);
  return 1 / std::sqrt(std::max(solver.eigenvalues()[0], 1e-12));
}

void CheckFinite(const SensorEstimate& sensor) {
  if (sensor.structure_from_sensor.matrix().allFinite() && sensor.covariance.allFinite()) return;
  throw DataError(
      fmt::format("sensor \"{}\": its pose or its covariance is not finite", sensor.name));
}

std::vector<PosePair> PairUp(const std::vector<SensorEstimate>& last,
                             const std::vector<SensorEstimate>& now) {
  std::vector<PosePair> pairs;
  for (const SensorEstimate& sensor : last) {
    const auto found = std::find_if(now.begin(), now.end(), [&](const SensorEstimate& other) {
      return other.name == sensor.name;
    });
    if (found == now.end()) continue;
    CheckFinite(sensor);
    CheckFinite(*found);
    pairs.push_back({&sensor, &*found});
  }
  return pairs;
}

/// Compares a sensor with the motion of those that stayed, without itself.
SensorMovement Compare(const PosePair& pair, const Motion& others, Movement movement,
                       const MovementOptions& options) {
  SensorMovement out;
  out.name = pair.last->name;
  out.movement = movement;
  const Pose& last = pair.last->structure_from_sensor;
  out.structure_from_sensor = pair.Now(others.last_from_now);
  out.covariance = pair.NowCovariance(others.last_from_now) + others.covariance;
  const PoseError moved = ComparePoses(last, out.structure_from_sensor);
  out.translation_m = moved.translation_m;
  out.rotation_deg = moved.rotation_deg;
  const Matrix6d covariance = pair.last->covariance + out.covariance;
  const Vector6d difference = pair.Difference(others.last_from_now);
  out.probability = others.Probability(Square(difference, covariance), options);
  const Matrix6d information = covariance.inverse();
  const double found = std::sqrt(FoundSquare(others, options));
  Eigen::Matrix<double, 6, 3> shift = Eigen::Matrix<double, 6, 3>::Zero(), turn = shift;
  shift.topRows<3>().setIdentity();
  turn.topRows<3>() = Cross(last.translation());
  turn.bottomRows<3>().setIdentity();
  out.found_from_m = found * LargestSigma(information, shift);
  out.found_from_deg = found * LargestSigma(information, turn) / kDegree;
  return out;
}

}  // namespace

Movements FindMovements(const std::vector<SensorEstimate>& last,
                        const std::vector<SensorEstimate>& now, const MovementOptions& options) {
  std::vector<PosePair> pairs = PairUp(last, now);
  const auto known = std::stable_partition(pairs.begin(), pairs.end(), [&](const PosePair& pair) {
    return std::find(options.moved.begin(), options.moved.end(), pair.last->name) ==
           options.moved.end();
  });
  const std::vector<PosePair> moved(known, pairs.end());
  pairs.erase(known, pairs.end());
  Movements result;
  const auto [stayed, contested] = LargestSets(pairs, options);
  if (stayed.empty()) {
    for (const PosePair& pair : pairs)
      result.sensors.push_back({pair.last->name, Movement::kUndecided});
    for (const PosePair& pair : moved)
      result.sensors.push_back({pair.last->name, Movement::kMoved});
    return result;
  }
  const PosePair& one = pairs[stayed.front()];
  const Motion motion = FitMotion(
      pairs, stayed, one.last->structure_from_sensor * one.now->structure_from_sensor.inverse());
  result.last_from_now = motion.last_from_now;
  result.covariance = motion.covariance;
  result.variance_factor = motion.VarianceFactor(options);
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (pairs.size() == 1) {  // nothing to compare it with
      const SensorEstimate& only = *pairs[i].last;
      constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
      result.sensors.push_back({only.name, Movement::kStayed, 0, 0, 1, unknown, unknown,
                                only.structure_from_sensor, only.covariance});
      break;
    }
    const bool is_of_motion = std::binary_search(stayed.begin(), stayed.end(), i);
    const bool is_contested = std::binary_search(contested.begin(), contested.end(), i);
    result.sensors.push_back(Compare(
        pairs[i],
        is_of_motion ? FitMotion(pairs, Without(stayed, i), motion.last_from_now) : motion,
        is_of_motion ? Movement::kStayed : (is_contested ? Movement::kUndecided : Movement::kMoved),
        options));
  }
  for (const PosePair& pair : moved)
    result.sensors.push_back(Compare(pair, motion, Movement::kMoved, options));
  return result;
}

std::vector<Exchanged> FindExchanged(const std::vector<SensorEstimate>& last,
                                     const std::vector<SensorEstimate>& now) {
  // Most sensors have to stand where one stood; then as many as possible in their own place.
  std::vector<Exchanged> best;
  std::pair<std::size_t, std::size_t> most(0, 0);
  for (const SensorEstimate& from : now) {
    for (const SensorEstimate& to : last) {
      const Pose last_from_now = to.structure_from_sensor * from.structure_from_sensor.inverse();
      std::vector<Exchanged> exchanged;
      std::set<std::string> taken;
      std::size_t own = 0;
      for (const SensorEstimate& sensor : now) {
        const Pose pose = last_from_now * sensor.structure_from_sensor;
        const SensorEstimate* place = NearestPlace(last, pose);
        if (!place || !taken.insert(place->name).second) continue;
        if (place->name == sensor.name) {
          ++own;
        } else {
          exchanged.push_back({sensor.name, place->name});
        }
      }
      if (const std::pair found(taken.size(), own); found > most) {
        most = found;
        best = std::move(exchanged);
      }
    }
  }
  // Two sensors that merely moved next to each other's places are not exchanged.
  std::set<std::string> names, places;
  for (const auto& [name, place_of] : best) {
    names.insert(name);
    places.insert(place_of);
  }
  return names == places ? best : std::vector<Exchanged>();
}

}  // namespace volalign
