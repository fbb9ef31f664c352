#include "infer/pose/stack_search.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

#include "infer/pose/stack_votes.h"

namespace volalign {

namespace {

/// Candidates nearer than this, in cells and in steps of the turn, are one.
constexpr double kSameCells = 2.5, kSameSteps = 2.5;

std::vector<Peak> Distinct(std::vector<Peak> peaks, std::size_t most, std::size_t turns,
                           bool every_turn) {
  std::stable_sort(peaks.begin(), peaks.end(),
                   [](const Peak& a, const Peak& b) { return a.votes > b.votes; });
  std::vector<Peak> distinct;
  for (const Peak& peak : peaks) {
    if (distinct.size() == most || peak.votes < kLeastVotes * peaks.front().votes) break;
    const bool known = std::any_of(distinct.begin(), distinct.end(), [&](const Peak& other) {
      int steps = std::abs(peak.turn - other.turn);
      if (every_turn) steps = std::min(steps, static_cast<int>(turns) - steps);
      return peak.foot == other.foot &&
             std::hypot(peak.x - other.x, peak.z - other.z) < kSameCells &&
             (every_turn ? steps < kSameSteps : steps == 0);
    });
    if (!known) distinct.push_back(peak);
  }
  return distinct;
}

std::vector<double> Turns(const StackOutline& outline, const StandingGuess& guess) {
  if (!guess.yaws.empty()) return guess.yaws;
  const int count = static_cast<int>(std::ceil(2 * M_PI / outline.yaw_step));
  std::vector<double> turns;
  for (int k = 0; k < count; ++k) turns.push_back(2 * M_PI * k / count);
  return turns;
}

}  // namespace

Eigen::Matrix3d RoomFromSensor(const Eigen::Vector3d& up) {
  Eigen::Matrix3d room;
  const Eigen::Vector3d x = up.unitOrthogonal();
  room << x.transpose(), up.transpose(), x.cross(up).transpose();
  return room;
}

std::vector<StackCandidate> SearchStack(const std::vector<OrientedPoint>& points,
                                        const StackOutline& outline, const StandingGuess& guess,
                                        std::size_t most) {
  const Eigen::Matrix3d room = RoomFromSensor(guess.up);
  std::vector<std::vector<OccupiedCell>> occupied;
  std::vector<VoteMap> maps;
  for (const double foot : guess.feet) {
    occupied.push_back(FindOccupied(points, outline, foot, room));
    maps.emplace_back(occupied.back(), outline);
  }
  const std::vector<double> turns = Turns(outline, guess);
  Votes votes(outline);
  std::vector<Peak> peaks;
  float highest = 0;
  for (std::size_t k = 0; k < turns.size(); ++k) {
    votes.Make(outline.pieces, turns[k]);
    for (std::size_t f = 0; f < maps.size(); ++f) {
      if (occupied[f].empty()) continue;
      maps[f].Count(occupied[f], votes);
      maps[f].AppendPeaks(static_cast<int>(k), static_cast<int>(f), &highest, &peaks);
    }
  }
  std::vector<StackCandidate> candidates;
  for (const Peak& peak : Distinct(std::move(peaks), most, turns.size(), guess.yaws.empty())) {
    Pose room_from_structure = Pose::Identity();
    room_from_structure.linear() =
        Eigen::AngleAxisd(turns[static_cast<std::size_t>(peak.turn)], Eigen::Vector3d::UnitY())
            .toRotationMatrix();
    room_from_structure.translation() =
        Eigen::Vector3d(peak.x * outline.cell, guess.feet[static_cast<std::size_t>(peak.foot)],
                        peak.z * outline.cell) -
        room_from_structure.linear() * outline.foot;
    Pose room_from_sensor = Pose::Identity();
    room_from_sensor.linear() = room;
    candidates.push_back({room_from_structure.inverse() * room_from_sensor, peak.votes});
  }
  return candidates;
}

}  // namespace volalign
