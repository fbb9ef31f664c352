#pragma once

// Which sensors of a rig were moved between two captures.

#include <optional>
#include <string>
#include <vector>

#include "core/config/config_word.h"
#include "core/geometry/pose.h"

namespace volalign {

/// A sensor as one capture places it.
struct SensorEstimate {
  std::string name;
  Pose structure_from_sensor = Pose::Identity();
  Matrix6d covariance = Matrix6d::Zero();  ///< of delta, see PerturbLeft
};

struct MovementOptions {
  /// Probability of taking a sensor that stayed for a moved one, if errors are normal.
  double false_alarm = 1e-5;
  /// Errors that both captures have in common cancel. The sensors that stayed tell by how much, as
  /// a factor on the variances, which is not taken to be below this one.
  double least_variance_factor = 0.1;
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
  /// Of such a difference if it stands where it stood, by chance: as probable as that or less.
  double probability = 1;
  /// A movement of its place, or a turn about it, in the direction in which the captures tell least
  /// has to be so large to be found with 95 % probability; m, deg.
  double found_from_m = 0, found_from_deg = 0;
  /// Where it stands now, in the last structure frame, with the uncertainty of both captures.
  Pose structure_from_sensor = Pose::Identity();
  Matrix6d covariance = Matrix6d::Zero();
};

struct Movements {
  /// Where the structure of the new capture stands in that of the last one, by the sensors that
  /// stayed. Absent where these are not known.
  std::optional<Pose> last_from_now;
  Matrix6d covariance = Matrix6d::Zero();  ///< of last_from_now
  double variance_factor = 1;
  std::vector<SensorMovement> sensors;  ///< that both captures have, in order of the last one
};

/// A sensor that stands where another one stood: it has that one's depth file, or its name.
struct Exchanged {
  std::string name, place_of;
};

/// The sensors that have exchanged their places among each other, wherever the structure stands
/// now: with them taken for each other, more sensors stand where one stood than without. Empty
/// where none have.
std::vector<Exchanged> FindExchanged(const std::vector<SensorEstimate>& last,
                                     const std::vector<SensorEstimate>& now);

/// Compares two captures of one rig, between which the structure may have been moved: sensors that
/// stayed have moved by one motion, the structure's, and the largest set of sensors that agrees on
/// one stayed, if it is more than half of them. Where there are several such sets, sensors that are
/// in some of them only are kUndecided; all are where none has more than half of the sensors, as
/// with two that contradict each other. A sensor is tested against the motion that the others show,
/// with the covariances of both captures, which are taken to be independent; where those that
/// stayed agree better than that, by the variance that they show (F test). This is the congruence
/// test of geodetic deformation analysis (H. Pelzer, Zur Analyse geodaetischer
/// Deformationsmessungen, DGK C 164, 1971). Throws DataError for poses or covariances that are not
/// finite.
Movements FindMovements(const std::vector<SensorEstimate>& last,
                        const std::vector<SensorEstimate>& now,
                        const MovementOptions& options = {});

}  // namespace volalign
