#include "infer/pose/aliases.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "infer/pose/agreement.h"

namespace volalign {

namespace {

constexpr double kSamePlace = 0.02;  // m
constexpr double kOnSide = 0.05;     // m: as in the pose search

using Corners = std::array<Eigen::Vector3d, 8>;

Corners CornersOf(const Box& box) {
  Corners corners;
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const Eigen::Vector3d sign(k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 : -1);
    corners[k] = box.structure_from_box * Eigen::Vector3d(sign.cwiseProduct(box.size) / 2);
  }
  return corners;
}

bool SameSolid(const Corners& a, const Corners& b) {
  return std::all_of(a.begin(), a.end(), [&](const Eigen::Vector3d& p) {
    return std::any_of(b.begin(), b.end(),
                       [&](const Eigen::Vector3d& q) { return (p - q).norm() < kSamePlace; });
  });
}

/// The 24 turns that take the axes to the axes.
std::vector<Eigen::Matrix3d> AxisTurns() {
  std::vector<Eigen::Matrix3d> turns;
  std::array<int, 3> order{0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      Eigen::Matrix3d turn = Eigen::Matrix3d::Zero();
      for (int axis = 0; axis < 3; ++axis)
        turn(order[static_cast<std::size_t>(axis)], axis) = signs >> axis & 1 ? -1 : 1;
      if (turn.determinant() > 0) turns.push_back(turn);
    }
  } while (std::next_permutation(order.begin(), order.end()));
  return turns;
}

std::vector<std::uint8_t> LabelsAfter(const Structure& structure, const Pose& motion) {
  std::vector<std::uint8_t> after(static_cast<std::size_t>(structure.num_classes()), 0);
  for (int label = 1; label < structure.num_classes(); ++label) {
    const Side& side = structure.SideOfLabel(label);
    for (const Side& other : structure.sides()) {
      if ((motion * side.centre - other.centre).norm() < kSamePlace &&
          (motion.linear() * side.normal).dot(other.normal) > 0.99)
        after[static_cast<std::size_t>(label)] = other.label;
    }
  }
  return after;
}

bool SamePose(const Pose& a, const Pose& b) {
  constexpr double kDistance = 0.2, kAngleDeg = 15;
  const PoseError gap = ComparePoses(a, b);
  return gap.translation_m < kDistance && gap.rotation_deg < kAngleDeg;
}

double FloorShare(const SensorView& view, const Structure& structure, const Pose& pose) {
  const FloorEvidence floor = FindFloor(view, structure, pose);
  return floor.pixels > 0 ? static_cast<double>(floor.balance()) / floor.pixels : 0;
}

}  // namespace

std::vector<StructureAlias> FindAliases(const Structure& structure) {
  const std::vector<Box>& boxes = structure.boxes();
  std::vector<Corners> corners;
  for (const Box& box : boxes) corners.push_back(CornersOf(box));
  std::vector<StructureAlias> aliases;
  for (const Eigen::Matrix3d& turn : AxisTurns()) {
    for (const Box& from : boxes) {
      for (const Box& to : boxes) {
        StructureAlias alias;
        alias.motion.linear() = turn;
        alias.motion.translation() =
            to.structure_from_box.translation() - turn * from.structure_from_box.translation();
        const auto known = [&](const StructureAlias& other) {
          return other.motion.linear().isApprox(turn) &&
                 (other.motion.translation() - alias.motion.translation()).norm() < 2 * kSamePlace;
        };
        const bool identity =
            turn.isIdentity() && alias.motion.translation().norm() < 2 * kSamePlace;
        if (identity || std::any_of(aliases.begin(), aliases.end(), known)) continue;
        for (const Corners& box : corners) {
          Corners moved = box;
          for (Eigen::Vector3d& p : moved) p = alias.motion * p;
          alias.boxes += std::any_of(corners.begin(), corners.end(),
                                     [&](const Corners& other) { return SameSolid(moved, other); });
        }
        if (alias.boxes == 0 || 2 * alias.boxes < static_cast<int>(boxes.size())) continue;
        alias.label_after = LabelsAfter(structure, alias.motion);
        aliases.push_back(std::move(alias));
      }
    }
  }
  std::stable_sort(
      aliases.begin(), aliases.end(),
      [](const StructureAlias& a, const StructureAlias& b) { return a.boxes > b.boxes; });
  return aliases;
}

SegmentationResult Relabelled(SegmentationResult segmentation, const StructureAlias& alias) {
  for (std::uint8_t& label : segmentation.labels) {
    label = label < alias.label_after.size() ? alias.label_after[label] : std::uint8_t{0};
  }
  return segmentation;
}

void ReconcileLabels(const SensorView& view, const Structure& structure,
                     const std::vector<StructureAlias>& aliases, const Pose& structure_from_sensor,
                     const std::vector<const SegmentationResult*>& others, double min_confidence,
                     SegmentationResult* segmentation) {
  std::vector<const SegmentationResult*> sources{segmentation};
  sources.insert(sources.end(), others.begin(), others.end());
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      if (!(view.depth(u, v) > 0)) continue;
      const Eigen::Vector3d p = structure_from_sensor * view.Point(u, v);
      const auto distance = [&](std::uint8_t name) {
        return name == 0 || name >= structure.num_classes()
                   ? kOnSide
                   : (structure.SideOfLabel(name).ClosestPoint(p) - p).norm();
      };
      if (distance(segmentation->labels(u, v)) < kOnSide) continue;
      double nearest = kOnSide;
      std::uint8_t name = 0;
      float confidence = 0;
      for (const SegmentationResult* source : sources) {
        const std::uint8_t label = source->labels(u, v);
        if (label == 0 || !(source->confidence(u, v) >= min_confidence)) continue;
        const auto consider = [&](std::uint8_t other) {
          if (distance(other) >= nearest) return;
          nearest = distance(other);
          name = other;
          confidence = source->confidence(u, v);
        };
        consider(label);
        for (const StructureAlias& alias : aliases) {
          if (label < alias.label_after.size()) consider(alias.label_after[label]);
        }
      }
      if (name == 0) continue;
      segmentation->labels(u, v) = name;
      segmentation->confidence(u, v) = confidence;
    }
  }
}

double FloorMargin(const SensorView& view, const Structure& structure,
                   const std::vector<StructureAlias>& aliases, const Pose& structure_from_sensor) {
  const double own = FloorShare(view, structure, structure_from_sensor);
  double margin = 1;
  for (const StructureAlias& alias : aliases) {
    margin =
        std::min(margin, own - FloorShare(view, structure, alias.motion * structure_from_sensor));
  }
  return margin;
}

PoseChoice ChoosePose(const SensorView& view, const Structure& structure,
                      const std::vector<StructureAlias>& aliases,
                      const std::vector<PoseTrial>& trials, bool known_up,
                      const InitialPoseOptions& options) {
  constexpr double kRivalScore = 0.5;     // of the best score: labels worth a hypothesis
  constexpr double kOverlapMargin = 0.1;  // shape decides from here on
  constexpr double kScoreMargin = 0.2;    // labels decide from here on, but not about up and down
  const double min_confidence = options.evidence.min_confidence;
  PoseChoice choice;
  double best_score = 0;
  for (const PoseTrial& trial : trials) {
    if (trial.initial->found) best_score = std::max(best_score, trial.initial->agreement.score());
  }

  const auto stride = [&](double pixels) {
    return std::max(1, static_cast<int>(
                           std::floor(std::sqrt(static_cast<double>(view.depth.size()) / pixels))));
  };
  const int coarse = stride(10000), fine = stride(14000);
  const SensorView coarse_view = Decimate(view, coarse), fine_view = Decimate(view, fine);
  std::vector<SegmentationResult> coarse_labels, fine_labels;
  for (const PoseTrial& trial : trials) {
    const SegmentationResult& full = *trial.segmentation;
    coarse_labels.push_back(
        {DecimateImage(full.labels, coarse), DecimateImage(full.confidence, coarse)});
    fine_labels.push_back({DecimateImage(full.labels, fine), DecimateImage(full.confidence, fine)});
  }
  const auto alias_of = [&](const PoseEvidence& pose) {
    return pose.alias < 0 ? nullptr : &aliases[static_cast<std::size_t>(pose.alias)];
  };
  const auto measure_overlap = [&](PoseEvidence* pose) {
    pose->overlap = MeasureOverlap(coarse_view, coarse_labels[pose->trial], structure,
                                   pose->structure_from_sensor, min_confidence)
                        .ratio();
  };
  const auto score = [&](const SegmentationResult& labels, const Pose& pose) {
    return CompareWithView(coarse_view, labels, structure, pose, min_confidence, kOnSide).score();
  };

  std::vector<PoseEvidence> poses;
  for (std::size_t t = 0; t < trials.size(); ++t) {
    const InitialPose& initial = *trials[t].initial;
    if (!initial.found || initial.agreement.score() < kRivalScore * best_score) continue;
    for (int a = -1; a < static_cast<int>(aliases.size()); ++a) {
      PoseEvidence pose;
      pose.trial = t;
      pose.alias = a;
      pose.structure_from_sensor = initial.structure_from_sensor;
      if (const StructureAlias* alias = alias_of(pose)) {
        if (known_up && !alias->keeps_up()) continue;
        pose.structure_from_sensor = alias->motion * initial.structure_from_sensor;
      }
      measure_overlap(&pose);
      poses.push_back(pose);
    }
  }
  if (poses.empty()) return choice;
  const auto drop_misfits = [&](double margin) {
    double best = 0;
    for (const PoseEvidence& pose : poses) best = std::max(best, pose.overlap);
    const auto misfit = [&](const PoseEvidence& pose) { return pose.overlap < best - margin; };
    poses.erase(std::remove_if(poses.begin(), poses.end(), misfit), poses.end());
  };
  drop_misfits(2 * kOverlapMargin);

  // A mixture of labels leaves few sides to a pose, and it may be tilted by degrees. With the
  // labels that it implies it is made anew before it is judged, once for all that are about alike.
  std::stable_sort(poses.begin(), poses.end(), [](const PoseEvidence& a, const PoseEvidence& b) {
    return a.overlap > b.overlap;
  });
  std::vector<std::pair<Pose, Pose>> made;
  for (PoseEvidence& pose : poses) {
    const Pose before = pose.structure_from_sensor;
    const auto alike = std::find_if(made.begin(), made.end(),
                                    [&](const auto& pair) { return SamePose(pair.first, before); });
    if (alike != made.end()) {
      pose.structure_from_sensor = alike->second;
    } else {
      SegmentationResult labels = fine_labels[pose.trial];
      if (const StructureAlias* alias = alias_of(pose))
        labels = Relabelled(std::move(labels), *alias);
      std::vector<const SegmentationResult*> others;
      for (std::size_t t = 0; t < trials.size(); ++t) {
        if (t != pose.trial) others.push_back(&fine_labels[t]);
      }
      ReconcileLabels(fine_view, structure, aliases, before, others, min_confidence, &labels);
      const InitialPose anew = EstimateInitialPose(fine_view, labels, structure, options, &before);
      if (anew.found) pose.structure_from_sensor = anew.structure_from_sensor;
      made.emplace_back(before, pose.structure_from_sensor);
    }
    measure_overlap(&pose);
  }
  drop_misfits(kOverlapMargin);
  for (PoseEvidence& pose : poses) {
    pose.floor = FloorShare(view, structure, pose.structure_from_sensor);
    for (const SegmentationResult& labels : coarse_labels) {
      pose.network_score = std::max(pose.network_score, score(labels, pose.structure_from_sensor));
    }
    const StructureAlias* alias = alias_of(pose);
    pose.label_score =
        score(alias ? Relabelled(coarse_labels[pose.trial], *alias) : coarse_labels[pose.trial],
              pose.structure_from_sensor);
  }

  double best_floor = -2;
  for (const PoseEvidence& pose : poses) best_floor = std::max(best_floor, pose.floor);
  const auto stands = [&](const PoseEvidence& pose) {
    return pose.floor > best_floor - kClearFloorMargin;
  };
  for (const PoseEvidence& pose : poses) {
    if (!stands(pose) || (choice.found && pose.network_score <= choice.best.network_score))
      continue;
    choice.best = pose;
    choice.found = true;
  }
  const Pose chosen = choice.best.structure_from_sensor;
  for (const PoseEvidence& pose : poses) {
    if (!SamePose(pose.structure_from_sensor, chosen)) {
      if (!stands(pose)) continue;
      const bool over = (pose.structure_from_sensor * chosen.inverse()).linear()(1, 1) < 0.5;
      const bool worse = !over && choice.best.network_score - pose.network_score >= kScoreMargin;
      if (worse || (choice.ambiguous && choice.rival.network_score >= pose.network_score)) continue;
      choice.ambiguous = true;
      choice.rival = pose;
    } else if (pose.label_score > choice.best.label_score) {
      const double network_score = choice.best.network_score;
      choice.best = pose;
      choice.best.network_score = std::max(network_score, pose.network_score);
    }
  }
  return choice;
}

std::string DescribeMotion(const Pose& from, const Pose& to) {
  const Pose motion = to * from.inverse();
  if (motion.linear()(1, 1) < -0.5) return "upside down";
  const double turn = std::atan2(motion.linear()(0, 2), motion.linear()(0, 0)) * 180 / M_PI;
  const double rise = motion.translation().y();
  return fmt::format("turned by {:.0f} deg and {:.2f} m {}", std::abs(turn), std::abs(rise),
                     rise > 0 ? "higher" : "lower");
}

}  // namespace volalign
