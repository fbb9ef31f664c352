#include "infer/initial/stack_search.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "core/base/lists.h"
#include "core/base/stop.h"
#include "infer/initial/stack_votes.h"

namespace volalign {

namespace {

/// Candidates nearer than this, in cells and in steps of the turn, are one.
constexpr double kSameSteps = 2.5;

std::vector<Peak> Distinct(std::vector<Peak> peaks, std::size_t most, std::size_t turns,
                           bool every_turn) {
  SortLargestFirst(&peaks, [](const Peak& peak) { return peak.votes; });
  std::vector<Peak> distinct;
  for (const Peak& peak : peaks) {
    if (distinct.size() == most || peak.votes < kLeastVotes * peaks.front().votes) break;
    const bool known = std::any_of(distinct.begin(), distinct.end(), [&](const Peak& other) {
      int steps = std::abs(peak.turn - other.turn);
      if (every_turn) steps = std::min(steps, static_cast<int>(turns) - steps);
      return peak.foot == other.foot &&
             std::hypot(peak.x - other.x, peak.z - other.z) < kSameSteps &&
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

/// The votes that one guess gets.
class GuessVotes {
 public:
  GuessVotes(const std::vector<OrientedPoint>& points, const StackOutline& outline,
             const StandingGuess& guess)
      : guess_(guess), outline_(outline), room_(RoomFromSensor(guess.up)) {
    for (const double foot : guess.feet) {
      occupied_.push_back(FindOccupied(points, outline, foot, room_));
      maps_.emplace_back(occupied_.back(), outline);
    }
  }

  void Count(const Votes& votes, std::size_t turn) {
    for (std::size_t f = 0; f < maps_.size(); ++f) {
      if (occupied_[f].empty()) continue;
      maps_[f].Count(occupied_[f], votes);
      maps_[f].AppendPeaks(static_cast<int>(turn), static_cast<int>(f), &highest_, &peaks_);
    }
  }

  std::vector<StackCandidate> Candidates(const std::vector<double>& turns, std::size_t most) const {
    std::vector<StackCandidate> candidates;
    for (const Peak& peak : Distinct(peaks_, most, turns.size(), guess_.yaws.empty())) {
      Pose room_from_structure = Pose::Identity();
      room_from_structure.linear() =
          Eigen::AngleAxisd(turns[static_cast<std::size_t>(peak.turn)], Eigen::Vector3d::UnitY())
              .toRotationMatrix();
      room_from_structure.translation() =
          Eigen::Vector3d(peak.x * outline_.cell, guess_.feet[static_cast<std::size_t>(peak.foot)],
                          peak.z * outline_.cell) -
          room_from_structure.linear() * outline_.foot;
      Pose room_from_sensor = Pose::Identity();
      room_from_sensor.linear() = room_;
      candidates.push_back({room_from_structure.inverse() * room_from_sensor, peak.votes});
    }
    return candidates;
  }

 private:
  const StandingGuess& guess_;
  const StackOutline& outline_;
  Eigen::Matrix3d room_;
  std::vector<std::vector<OccupiedCell>> occupied_;  // of each foot
  std::vector<VoteMap> maps_;
  std::vector<Peak> peaks_;
  float highest_ = 0;
};

}  // namespace

Eigen::Matrix3d RoomFromSensor(const Eigen::Vector3d& up) {
  Eigen::Matrix3d room;
  const Eigen::Vector3d x = up.unitOrthogonal();
  room << x.transpose(), up.transpose(), x.cross(up).transpose();
  return room;
}

std::vector<std::vector<StackCandidate>> SearchStack(const std::vector<OrientedPoint>& points,
                                                     const StackOutline& outline,
                                                     const std::vector<StandingGuess>& guesses,
                                                     std::size_t most) {
  std::vector<GuessVotes> searches;
  for (const StandingGuess& guess : guesses) searches.emplace_back(points, outline, guess);
  std::vector<std::vector<StackCandidate>> candidates;
  if (guesses.empty()) return candidates;
  const std::vector<double> turns = Turns(outline, guesses.front());
  Votes votes(outline);
  for (std::size_t k = 0; k < turns.size(); ++k) {
    ThrowIfStopped();
    votes.Make(outline.pieces, turns[k]);
    for (GuessVotes& search : searches) search.Count(votes, k);
  }
  for (const GuessVotes& search : searches) candidates.push_back(search.Candidates(turns, most));
  return candidates;
}

}  // namespace volalign
