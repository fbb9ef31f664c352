#pragma once

// Finds the sensors of a rig that were moved between two captures.

#include <optional>
#include <string>
#include <vector>

#include "core/config/config_word.h"
#include "core/geometry/pose.h"

namespace volalign {

/// A sensor's pose by one capture.
struct SensorEstimate {
  std::string name;
  Pose structure_from_sensor = Pose::Identity();
  Matrix6d covariance = Matrix6d::Zero();  ///< of delta, see PerturbLeft
};

struct MovementOptions {
  /// Probability that a sensor that stayed is called moved, if errors are normal.
  double false_alarm = 1e-5;
  /// Least factor on the variances. Errors that both captures have in common cancel, and the
  /// sensors that stayed show by how much.
  double least_variance_factor = 0.1;
  /// Names of sensors that are known to have moved. They say nothing about the structure's motion.
  std::vector<std::string> moved;
  /// May a single other sensor stay? Nothing but the caller's word then says that it did.
  bool one_may_stay = false;
};

enum class Movement { kStayed, kMoved, kUndecided };
constexpr Words<Movement, 3> WordsOf(Movement) {
  return {{{"stayed", Movement::kStayed},
           {"moved", Movement::kMoved},
           {"undecided", Movement::kUndecided}}};
}

/// A sensor's two poses in the last structure frame.
struct SensorMovement {
  std::string name;
  Movement movement = Movement::kStayed;
  double translation_m = 0, rotation_deg = 0;  ///< between them, see ComparePoses
  /// Probability of such a difference, or a larger one, by chance, if the sensor did not move.
  double probability = 1;
  /// Least movement of its place, m, or turn about it, deg, that is found with 95 % probability, in
  /// the least certain direction. NaN for a single sensor that stays.
  double found_from_m = 0, found_from_deg = 0;
  /// Its pose now, in the last structure frame, with the uncertainty of both captures.
  Pose structure_from_sensor = Pose::Identity();
  Matrix6d covariance = Matrix6d::Zero();
};

struct Movements {
  /// Pose of the new capture's structure in the last one's, by the sensors that stayed. Absent if
  /// these are not known.
  std::optional<Pose> last_from_now;
  Matrix6d covariance = Matrix6d::Zero();  ///< of last_from_now
  double variance_factor = 1;
  /// Those of both captures, in order of the last one; after them MovementOptions::moved.
  std::vector<SensorMovement> sensors;
};

/// A sensor at another one's place: it has that one's depth file, or its name.
struct Exchanged {
  std::string name, place_of;
};

/// Finds sensors that have exchanged their places among each other, wherever the structure stands
/// now. If they are taken for each other, more sensors stand where one stood. Empty if there are
/// none.
std::vector<Exchanged> FindExchanged(const std::vector<SensorEstimate>& last,
                                     const std::vector<SensorEstimate>& now);

/// Compares two captures of one rig. The structure may have been moved between them; sensors that
/// stayed then share its motion. The largest set of sensors that agrees on one motion stayed, if it
/// is more than half of all. If there are several such sets, sensors that are only in some of them
/// are kUndecided. If the sensors in all of them are no more than half, all are, for example two
/// that contradict each other.
///
/// A sensor is tested against the motion of the others, with the covariances of both captures,
/// which count as independent. If those that stayed agree better than that, the test uses the
/// variance that they show (F test). This is the congruence test of geodetic deformation analysis
/// (H. Pelzer, Zur Analyse geodaetischer Deformationsmessungen, DGK C 164, 1971). Throws DataError
/// for poses or covariances that are not finite.
Movements FindMovements(const std::vector<SensorEstimate>& last,
                        const std::vector<SensorEstimate>& now,
                        const MovementOptions& options = {});

}  // namespace volalign
