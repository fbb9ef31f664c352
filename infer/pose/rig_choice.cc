#include "infer/pose/rig_choice.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <memory>
#include <tuple>
#include <utility>

#include "core/kd_tree.h"
#include "core/visibility.h"
#include "infer/pose/same_pose.h"

namespace volalign {

namespace {

// Everything is counted in margins: a difference of one decides.
constexpr double kDecides = 0.99;  // but for rounding
/// A floor that decides goes before everything else.
constexpr double kFloorDecides = 3;
/// Most that labels count where they tell up from down: enough to choose by.
constexpr double kLabelsTellUp = 0.5;
/// Against a sensor that is mounted otherwise than those of the network: enough to choose by.
constexpr double kOtherThanNetwork = 0.3;
/// Against a sensor that is mounted otherwise than several others, or than one other.
constexpr double kMountedAsOthers = 1, kMountedAsOne = 0.5;
/// Most that what two sensors measured beside the structure counts.
constexpr double kMostShared = 3;

/// Points of a sensor that are looked for among another one's, and rays of those.
constexpr double kProbeRays = 400, kCloudRays = 6000;
constexpr double kSharedDistance = 0.08;   // m, of points of one surface at poses not refined yet
constexpr double kBesideStructure = 0.15;  // m from it
constexpr int kMostSweeps = 10;
/// The side of the picture that is up where it stands upright, and where it lies on its side.
constexpr std::array<std::array<std::size_t, 2>, 4> kUpright = {{{0, 1}, {0, 3}, {2, 1}, {2, 3}}};

/// The index of the pose that each sensor has, of its options; -1: it has none.
using Choice = std::vector<int>;

/// One of the poses that a sensor may have, and those of its competitors that are about the same.
struct Option {
  PoseEvidence pose;  // the one with the best labels of its own, with the best network score
  int upright = 0;    // UprightTurns
  int turns = 0;      // into the network's orientation
};

std::vector<Option> Distinct(const SensorCandidates& sensor, const Structure& structure) {
  std::vector<Option> distinct;
  for (std::size_t k = 0; k < sensor.poses.size(); ++k) {
    const PoseEvidence& pose = sensor.poses[k];
    const auto same = std::find_if(distinct.begin(), distinct.end(), [&](const Option& option) {
      return SamePose(structure, option.pose.structure_from_sensor, pose.structure_from_sensor);
    });
    if (same == distinct.end()) {
      distinct.push_back({pose, UprightTurns(pose.structure_from_sensor),
                          sensor.turns.empty() ? 0 : sensor.turns[k]});
      continue;
    }
    const double network_score = std::max(same->pose.network_score, pose.network_score);
    const double floor = std::max(same->pose.floor, pose.floor);
    if (pose.label_score > same->pose.label_score) same->pose = pose;
    same->pose.network_score = network_score;
    same->pose.floor = floor;
  }
  return distinct;
}

/// A sensor's points, sensor frame: few that are looked for, and many to find them among.
class Cloud {
 public:
  explicit Cloud(const SensorView& view) {
    probes_ = Points(view, kProbeRays);
    tree_ = std::make_unique<KdTree>(Points(view, kCloudRays));
  }
  /// Share of another sensor's points, those beside the structure, that lie on this one's.
  double ShareOf(const Cloud& other, const Pose& pose, const Pose& others,
                 const Structure& structure) const {
    const Pose this_from_structure = pose.inverse();
    int beside = 0, shared = 0;
    for (const Eigen::Vector3d& probe : other.probes_) {
      const Eigen::Vector3d p = others * probe;
      if (DistanceToSurface(structure, p).distance < kBesideStructure) continue;
      ++beside;
      const KdTree::Neighbour nearest = tree_->Nearest(this_from_structure * p);
      shared += nearest.index >= 0 && nearest.squared_distance < kSharedDistance * kSharedDistance;
    }
    return beside > 0 ? static_cast<double>(shared) / beside : 0;
  }

 private:
  static std::vector<Eigen::Vector3d> Points(const SensorView& view, double rays) {
    const int stride = StrideForRays(view.depth.size(), rays);
    std::vector<Eigen::Vector3d> points;
    for (int v = stride / 2; v < view.height(); v += stride) {
      for (int u = stride / 2; u < view.width(); u += stride) {
        if (view.depth(u, v) > 0) points.push_back(view.Point(u, v));
      }
    }
    return points;
  }

  std::vector<Eigen::Vector3d> probes_;
  std::unique_ptr<KdTree> tree_;
};

class Rig {
 public:
  Rig(const std::vector<SensorCandidates>& sensors, const Structure& structure,
      const PoseChoiceOptions& limits)
      : structure_(structure), limits_(limits) {
    for (const SensorCandidates& sensor : sensors) {
      options_.push_back(Distinct(sensor, structure));
      clouds_.push_back(sensor.poses.empty() ? nullptr : std::make_unique<Cloud>(*sensor.view));
    }
  }

  std::size_t size() const { return options_.size(); }
  const std::vector<Option>& options(std::size_t i) const { return options_[i]; }

  /// What speaks for a choice. `to_choose`: with what leaves a choice ambiguous, too.
  double Score(const Choice& choice, bool to_choose) {
    double score = -Deviations(choice);
    for (std::size_t i = 0; i < size(); ++i) {
      if (choice[i] < 0) continue;
      score += Own(i, choice[i], to_choose);
      for (std::size_t j = 0; j < i; ++j) {
        if (choice[j] >= 0) score += Shared(i, choice[i], j, choice[j]);
      }
    }
    return score;
  }

  /// From `choice` on, sensor by sensor, until no other pose of one of them is better. `fixed`
  /// stays as it is.
  Choice Improve(Choice choice, std::size_t fixed, bool to_choose) {
    for (int sweep = 0; sweep < kMostSweeps; ++sweep) {
      bool changed = false;
      for (std::size_t i = 0; i < size(); ++i) {
        if (i == fixed || options_[i].size() < 2) continue;
        Choice best = choice;
        double best_score = Score(choice, to_choose);
        for (int k = 0; k < static_cast<int>(options_[i].size()); ++k) {
          Choice other = choice;
          other[i] = k;
          const double score = Score(other, to_choose);
          if (score <= best_score) continue;
          best_score = score;
          best = std::move(other);
          changed = true;
        }
        choice = std::move(best);
      }
      if (!changed) break;
    }
    return choice;
  }

  /// The best choice in which `fixed` (none of the sensors: nothing is fixed) has the option `k`.
  Choice Best(std::size_t fixed, int k, bool to_choose) {
    Choice best;
    double best_score = 0;
    for (const auto& upright : kUpright) {
      Choice start = AllUpright(upright, to_choose);
      if (fixed < size()) start[fixed] = k;
      Choice choice = Improve(std::move(start), fixed, to_choose);
      const double score = Score(choice, to_choose);
      if (!best.empty() && score <= best_score) continue;
      best_score = score;
      best = std::move(choice);
    }
    return best;
  }

 private:
  /// Floor and labels of a sensor's option, against the best of all its options.
  double Own(std::size_t i, int k, bool to_choose) const {
    double best_floor = -2, best_label = 0;
    std::size_t best = 0;
    for (std::size_t other = 0; other < options_[i].size(); ++other) {
      const PoseEvidence& pose = options_[i][other].pose;
      best_floor = std::max(best_floor, pose.floor);
      if (pose.network_score > best_label) best = other;
      best_label = std::max(best_label, pose.network_score);
    }
    const Option& option = options_[i][static_cast<std::size_t>(k)];
    const double floor = (best_floor - option.pose.floor) / std::max(limits_.floor_margin, 1e-9);
    const double label =
        (best_label - option.pose.network_score) / std::max(limits_.score_margin, 1e-9);
    const bool turned_over =
        TurnsOver(options_[i][best].pose.structure_from_sensor, option.pose.structure_from_sensor);
    double score = -floor * (floor < 1 ? 1 : kFloorDecides);
    if (!turned_over) score -= label;
    if (turned_over && to_choose) score -= std::min(label, kLabelsTellUp);
    if (option.turns != 0 && to_choose) score -= kOtherThanNetwork;
    return score;
  }

  /// What speaks against sensors that are mounted otherwise than most: than most of those whose
  /// picture stands on the same axis, and for those on the other axis than most.
  double Deviations(const Choice& choice) const {
    std::array<int, 4> mounted{};
    for (std::size_t i = 0; i < size(); ++i) {
      if (choice[i] >= 0) ++mounted[UprightOf(i, choice[i])];
    }
    const auto deviation = [](int count, int other) {
      return std::min(count, other) *
             (std::max(count, other) > 1 ? kMountedAsOthers : kMountedAsOne);
    };
    return deviation(mounted[0], mounted[2]) + deviation(mounted[1], mounted[3]) +
           deviation(mounted[0] + mounted[2], mounted[1] + mounted[3]);
  }

  std::size_t UprightOf(std::size_t i, int k) const {
    return static_cast<std::size_t>(options_[i][static_cast<std::size_t>(k)].upright);
  }

  const Pose& PoseOf(std::size_t i, int k) const {
    return options_[i][static_cast<std::size_t>(k)].pose.structure_from_sensor;
  }

  double Shared(std::size_t i, int k, std::size_t j, int l) {
    // Two sensors of which nothing is open say nothing about the others.
    if (options_[i].size() < 2 && options_[j].size() < 2) return 0;
    const auto [known, missing] = shared_.try_emplace({i, j, k, l}, 0);
    if (missing) {
      const double share =
          (clouds_[i]->ShareOf(*clouds_[j], PoseOf(i, k), PoseOf(j, l), structure_) +
           clouds_[j]->ShareOf(*clouds_[i], PoseOf(j, l), PoseOf(i, k), structure_)) /
          2;
      known->second = std::min(kMostShared, share / std::max(limits_.overlap_margin, 1e-9));
    }
    return known->second;
  }

  /// Every sensor's own best option with one of these sides of the picture up, where it has one.
  Choice AllUpright(const std::array<std::size_t, 2>& upright, bool to_choose) const {
    Choice choice;
    for (std::size_t i = 0; i < size(); ++i) {
      int best = -1;
      for (int k = 0; k < static_cast<int>(options_[i].size()); ++k) {
        const auto rank = [&](int option) {
          const std::size_t own = UprightOf(i, option);
          return std::make_pair(own == upright[0] || own == upright[1], Own(i, option, to_choose));
        };
        if (best < 0 || rank(k) > rank(best)) best = k;
      }
      choice.push_back(best);
    }
    return choice;
  }

  const Structure& structure_;
  const PoseChoiceOptions& limits_;
  std::vector<std::vector<Option>> options_;
  std::vector<std::unique_ptr<Cloud>> clouds_;
  std::map<std::tuple<std::size_t, std::size_t, int, int>, double> shared_;
};

}  // namespace

std::vector<PoseChoice> ChooseTogether(const std::vector<SensorCandidates>& sensors,
                                       const Structure& structure,
                                       const PoseChoiceOptions& options) {
  Rig rig(sensors, structure, options);
  const Choice best = rig.Best(rig.size(), 0, true);
  const double score = rig.Score(best, false);
  std::vector<PoseChoice> choices(rig.size());
  for (std::size_t i = 0; i < rig.size(); ++i) {
    if (best[i] < 0) continue;
    choices[i].found = true;
    choices[i].best = rig.options(i)[static_cast<std::size_t>(best[i])].pose;
    double rival_score = score - kDecides;
    for (int k = 0; k < static_cast<int>(rig.options(i).size()); ++k) {
      if (k == best[i]) continue;
      const double other = rig.Score(rig.Best(i, k, false), false);
      if (other <= rival_score) continue;
      rival_score = other;
      choices[i].ambiguous = true;
      choices[i].rival = rig.options(i)[static_cast<std::size_t>(k)].pose;
    }
  }
  return choices;
}

}  // namespace volalign
