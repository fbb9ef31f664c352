#include "infer/initial/rig_choice.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <memory>
#include <tuple>
#include <utility>

#include "core/base/odds.h"
#include "infer/depth/measured_view.h"
#include "infer/initial/pose_priors.h"
#include "infer/initial/symmetries.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// Natural logarithms of odds. The first settles a choice. The second is enough to choose by, but
/// leaves the choice ambiguous. The third decides unless something else speaks against it. One
/// sensor in a thousand is assumed to be mounted otherwise than several others, and one frame in a
/// thousand to have the labels of a symmetry.
const double kDecides = std::log(kDecisiveOdds), kTells = kDecides / 2,
             kUsual = std::log(kUnusualOdds);

/// For each sensor the index of its option; -1: it has none, or any.
using Choice = std::vector<int>;

/// The terms that count. kFit: the evidence alone. kAll: also the network's orientation, and labels
/// that tell up from down. A choice by more than evidence is ambiguous.
enum class Count { kFit, kAll };

/// Hypotheses that are not about the same pose. Each stands for all that are about its pose, with
/// the most evidence of any. Those of a labelling's own pose are kept, then the first.
std::vector<Hypothesis> Distinct(const SensorHypotheses& sensor, const Structure& structure) {
  const auto has_labels = [](const Hypothesis& each) {
    return each.source == PoseSource::kNetwork && each.symmetry < 0;
  };
  std::vector<Hypothesis> distinct;
  for (const Hypothesis& pose : sensor.poses) {
    const auto same = std::find_if(distinct.begin(), distinct.end(), [&](const Hypothesis& other) {
      return SamePose(structure, other.structure_from_sensor, pose.structure_from_sensor);
    });
    if (same == distinct.end()) {
      distinct.push_back(pose);
      continue;
    }
    const Hypothesis before = *same;
    if (has_labels(pose) && !has_labels(before)) *same = pose;
    for (double Hypothesis::*by : {&Hypothesis::by_depth, &Hypothesis::by_outline,
                                   &Hypothesis::by_floor, &Hypothesis::by_labels})
      (*same).*by = std::max(before.*by, pose.*by);
  }
  return distinct;
}

double Fit(const Hypothesis& option) { return option.by_depth + option.by_outline; }

class Rig {
 public:
  Rig(const std::vector<SensorHypotheses>& sensors, const Structure& structure)
      : structure_(structure), measured_(sensors.size()) {
    for (const SensorHypotheses& sensor : sensors) {
      options_.push_back(Distinct(sensor, structure));
      views_.push_back(sensor.view);
      DropImprobable(options_.size() - 1);
    }
    WeighPriors(sensors);
  }

  std::size_t size() const { return options_.size(); }
  const std::vector<Hypothesis>& options(std::size_t i) const { return options_[i]; }

  /// Log odds of a choice, up to a constant.
  double Score(const Choice& choice, Count count) {
    double score = ByPriors(choice) - Deviations(choice);
    CauseShares between = {};
    for (std::size_t i = 0; i < size(); ++i) {
      if (choice[i] < 0) continue;
      score += Own(i, choice[i], count);
      for (std::size_t j = 0; j < i; ++j) {
        if (choice[j] < 0) continue;
        const CauseShares& pair = OfPair(i, choice[i], j, choice[j]);
        for (std::size_t cause = 0; cause < kCauses; ++cause) between[cause] += pair[cause];
      }
    }
    return LogOddsOfPairs(between) + score;
  }

  /// The best choice that has the options of `fixed` where these are not -1. The one found from
  /// `near`, if given, comes before equally good ones.
  Choice Best(const Choice& fixed, Count count, const Choice& near = {}) {
    std::vector<Choice> starts;
    if (!near.empty()) starts.push_back(near);
    for (const std::size_t upright : {0, 2}) {
      for (const std::size_t on_its_side : {1, 3})
        starts.push_back(AllUpright(upright, on_its_side, count));
    }
    Choice best;
    double best_score = 0;
    for (Choice& start : starts) {
      for (std::size_t i = 0; i < size(); ++i) {
        if (fixed[i] >= 0) start[i] = fixed[i];
      }
      Choice choice = Improve(std::move(start), fixed, count);
      const double score = Score(choice, count);
      if (!best.empty() && score <= best_score) continue;
      best_score = score;
      best = std::move(choice);
    }
    return best;
  }

 private:
  /// Improves `choice` sensor by sensor until no other pose of one of them is better. Sensors in
  /// `fixed` stay as they are.
  Choice Improve(Choice choice, const Choice& fixed, Count count) {
    for (bool changed = true; changed;) {
      changed = false;
      for (std::size_t i = 0; i < size(); ++i) {
        if (fixed[i] >= 0 || options_[i].size() < 2) continue;
        Choice best = choice;
        double best_score = Score(choice, count);
        for (int k = 0; k < static_cast<int>(options_[i].size()); ++k) {
          Choice other = choice;
          other[i] = k;
          const double score = Score(other, count);
          if (score <= best_score) continue;
          best_score = score;
          best = std::move(other);
          changed = true;
        }
        choice = std::move(best);
      }
    }
    return choice;
  }

  /// Log likelihoods of the options by the sensors' priors, in each world that is possible.
  void WeighPriors(const std::vector<SensorHypotheses>& sensors) {
    std::vector<const PosePrior*> priors;
    std::vector<std::vector<Pose>> poses(size());
    for (std::size_t i = 0; i < size(); ++i) {
      priors.push_back(sensors[i].prior);
      for (const Hypothesis& option : options_[i]) poses[i].push_back(option.structure_from_sensor);
    }
    for (const WorldPlacement& world : FindWorlds(priors, poses)) {
      std::vector<std::vector<double>> of_options(size());
      for (std::size_t i = 0; i < size(); ++i) {
        if (!priors[i]) continue;
        const Pose expected = world.Place(priors[i]->world_from_sensor);
        for (const Pose& pose : poses[i])
          of_options[i].push_back(PriorLogLikelihood(*priors[i], expected, pose));
      }
      by_priors_.push_back(std::move(of_options));
    }
  }

  double ByPriors(const Choice& choice) const {
    double best = by_priors_.empty() ? 0 : -std::numeric_limits<double>::infinity();
    for (const std::vector<std::vector<double>>& of_options : by_priors_) {
      double sum = 0;
      for (std::size_t i = 0; i < size(); ++i) {
        if (choice[i] >= 0 && !of_options[i].empty())
          sum += of_options[i][static_cast<std::size_t>(choice[i])];
      }
      best = std::max(best, sum);
    }
    return best;
  }

  /// Sensors with one option left are not compared with each other. This halves the time for the
  /// first poses of 20.
  void DropImprobable(std::size_t i) {
    std::vector<double> own;
    for (int k = 0; k < static_cast<int>(options_[i].size()); ++k)
      own.push_back(Own(i, k, Count::kFit));
    std::vector<Hypothesis> kept;
    for (std::size_t k = 0; k < own.size(); ++k) {
      if (own[k] >= *std::max_element(own.begin(), own.end()) - std::log(kNamedOdds))
        kept.push_back(options_[i][k]);
    }
    options_[i] = std::move(kept);
  }

  /// Log odds of a sensor's option by its own view, against the best of all its options.
  double Own(std::size_t i, int k, Count count) const {
    const Hypothesis& option = OptionOf(i, k);
    double fit = 0, floor = 0;
    const Hypothesis* named = &option;  // the one with the most evidence by labels
    for (const Hypothesis& other : options_[i]) {
      fit = std::max(fit, Fit(other) - Fit(option));
      floor = std::max(floor, other.by_floor - option.by_floor);
      if (other.by_labels > named->by_labels) named = &other;
    }
    const double labels = std::min(named->by_labels - option.by_labels, kUsual);
    double score = 0;
    // Poses that are a centimetre off differ by less, and in a large rig that would add up.
    if (fit >= kTells) score -= fit;
    score -= floor;
    if (!TurnsOver(named->structure_from_sensor, option.structure_from_sensor)) {
      score -= labels;
    } else if (count == Count::kAll) {
      score -= std::min(labels, kTells);
    }
    if (option.turns != 0 && count == Count::kAll) score -= kTells;
    return score;
  }

  /// Penalty for sensors that are mounted otherwise than most on the same axis of the picture, and
  /// for those on the other axis than most.
  double Deviations(const Choice& choice) const {
    std::array<int, 4> mounted{};
    for (std::size_t i = 0; i < size(); ++i) {
      if (choice[i] >= 0) ++mounted[UprightOf(i, choice[i])];
    }
    const auto deviation = [](int count, int other) {
      return std::min(count, other) * (std::max(count, other) > 1 ? kUsual : kTells);
    };
    return deviation(mounted[0], mounted[2]) + deviation(mounted[1], mounted[3]) +
           deviation(mounted[0] + mounted[2], mounted[1] + mounted[3]);
  }

  const Hypothesis& OptionOf(std::size_t i, int k) const {
    return options_[i][static_cast<std::size_t>(k)];
  }
  std::size_t UprightOf(std::size_t i, int k) const {
    return static_cast<std::size_t>(UprightTurns(PoseOf(i, k)));
  }
  const Pose& PoseOf(std::size_t i, int k) const { return OptionOf(i, k).structure_from_sensor; }

  const MeasuredView& Measured(std::size_t i) {
    if (!measured_[i]) {
      std::vector<Pose> poses;
      for (const Hypothesis& option : options_[i]) poses.push_back(option.structure_from_sensor);
      measured_[i] = std::make_unique<MeasuredView>(*views_[i], structure_, poses);
    }
    return *measured_[i];
  }

  const CauseShares& OfPair(std::size_t i, int k, std::size_t j, int l) {
    const auto [known, missing] = of_pairs_.try_emplace({i, j, k, l}, CauseShares());
    // Two settled sensors say nothing about the others.
    if (missing && (options_[i].size() > 1 || options_[j].size() > 1)) {
      known->second =
          ExplainPair(Measured(i), Measured(j), PoseOf(i, k).inverse() * PoseOf(j, l), kRoughPose);
    }
    return known->second;
  }

  /// Every sensor's own best option, of those with the given side of the picture up where it has
  /// one: `upright` or `on_its_side`.
  Choice AllUpright(std::size_t upright, std::size_t on_its_side, Count count) const {
    Choice choice;
    for (std::size_t i = 0; i < size(); ++i) {
      int best = -1;
      for (int k = 0; k < static_cast<int>(options_[i].size()); ++k) {
        const auto rank = [&](int option) {
          const std::size_t own = UprightOf(i, option);
          return std::make_pair(own == upright || own == on_its_side, Own(i, option, count));
        };
        if (best < 0 || rank(k) > rank(best)) best = k;
      }
      choice.push_back(best);
    }
    return choice;
  }

  const Structure& structure_;
  std::vector<const SensorView*> views_;
  std::vector<std::vector<Hypothesis>> options_;
  std::vector<std::unique_ptr<MeasuredView>> measured_;  // made on demand
  std::map<std::tuple<std::size_t, std::size_t, int, int>, CauseShares> of_pairs_;
  /// Of each possible world, for each sensor with a prior and each of its options.
  std::vector<std::vector<std::vector<double>>> by_priors_;
};

/// Another choice, and the log odds of the chosen one against it.
struct Alternative {
  Choice choice;
  double log_odds = 0;
};

/// For each sensor that is not fixed and each of its other poses, the best choice with that pose.
/// The most probable first.
std::vector<Alternative> OtherChoices(const Choice& best, const Choice& fixed, Rig* rig) {
  const double score = rig->Score(best, Count::kFit);
  std::vector<Alternative> alternatives;
  for (std::size_t i = 0; i < rig->size(); ++i) {
    if (fixed[i] >= 0 || best[i] < 0) continue;
    for (int k = 0; k < static_cast<int>(rig->options(i).size()); ++k) {
      if (k == best[i]) continue;
      Choice other = fixed;
      other[i] = k;
      other = rig->Best(other, Count::kFit, best);
      const bool known =
          std::any_of(alternatives.begin(), alternatives.end(),
                      [&](const Alternative& alternative) { return alternative.choice == other; });
      if (!known) alternatives.push_back({other, score - rig->Score(other, Count::kFit)});
    }
  }
  std::stable_sort(
      alternatives.begin(), alternatives.end(),
      [](const Alternative& a, const Alternative& b) { return a.log_odds < b.log_odds; });
  return alternatives;
}

/// The other poses of a sensor, in the order of the most probable choice that has each.
std::vector<int> OtherPoses(const std::vector<Alternative>& alternatives, const Choice& best,
                            std::size_t i) {
  std::vector<int> poses;
  for (const Alternative& alternative : alternatives) {
    const int k = alternative.choice[i];
    if (k != best[i] && std::find(poses.begin(), poses.end(), k) == poses.end()) poses.push_back(k);
  }
  return poses;
}

/// The options that a person has chosen where the views leave them open, else -1. `best`: the
/// choice without these.
Choice GivenPoses(const std::vector<SensorHypotheses>& sensors, const Choice& best, Rig* rig) {
  Choice given(rig->size(), -1);
  const std::vector<Alternative> alternatives = OtherChoices(best, given, rig);
  for (std::size_t i = 0; i < rig->size(); ++i) {
    const int chosen = sensors[i].chosen;
    const std::vector<int> others = OtherPoses(alternatives, best, i);
    if (chosen == 1) given[i] = best[i];
    if (chosen < 2 || chosen - 2 >= static_cast<int>(others.size())) continue;
    const int asked = others[static_cast<std::size_t>(chosen - 2)];
    if (std::any_of(alternatives.begin(), alternatives.end(), [&](const Alternative& each) {
          return each.choice[i] == asked && each.log_odds < kDecides;
        })) {
      given[i] = asked;
    }
  }
  return given;
}

}  // namespace

bool PoseChoice::ambiguous() const {
  return !alternatives.empty() && alternatives.front().log_odds < kDecides;
}

std::vector<PoseChoice> ChooseTogether(const std::vector<SensorHypotheses>& sensors,
                                       const Structure& structure) {
  Rig rig(sensors, structure);
  Choice fixed(rig.size(), -1);
  Choice best = rig.Best(fixed, Count::kAll);
  if (std::any_of(sensors.begin(), sensors.end(),
                  [](const SensorHypotheses& sensor) { return sensor.chosen > 0; })) {
    fixed = GivenPoses(sensors, best, &rig);
    best = rig.Best(fixed, Count::kFit, best);
  }
  const std::vector<Alternative> alternatives = OtherChoices(best, fixed, &rig);
  std::vector<PoseChoice> choices(rig.size());
  for (std::size_t i = 0; i < rig.size(); ++i) {
    if (best[i] < 0) continue;
    const auto pose_of = [&](int k) { return rig.options(i)[static_cast<std::size_t>(k)]; };
    PoseChoice& choice = choices[i];
    choice.found = true;
    choice.best = pose_of(best[i]);
    const std::vector<int> others = OtherPoses(alternatives, best, i);
    for (std::size_t t = 0; t < alternatives.size(); ++t) {
      const int k = alternatives[t].choice[i];
      const auto at = std::find(others.begin(), others.end(), k);
      if (at == others.end()) continue;
      choice.alternatives.push_back({static_cast<int>(t), static_cast<int>(at - others.begin()) + 2,
                                     alternatives[t].log_odds, pose_of(k).structure_from_sensor});
    }
    choice.given = fixed[i] >= 0;
  }
  return choices;
}

}  // namespace volalign
