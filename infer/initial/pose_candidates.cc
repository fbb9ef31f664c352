#include "infer/initial/pose_candidates.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "core/base/lists.h"
#include "core/geometry/procrustes.h"
#include "core/geometry/visibility.h"
#include "infer/initial/symmetries.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

/// rad: largest angle between a side's normal and its fitted one if they agree.
constexpr double kMostNormalError = 30 * kDegree;

/// Errors that the weights assume: of keypoints, m, from visibility and labels; of normals, rad,
/// beside their own.
constexpr double kKeypointSigma = kRoughPose, kNormalSigma = 0.01;
/// Area at which a patch has half of the weight that an infinite one has, m^2.
constexpr double kHalfTrustArea = 0.03;
/// Second largest extent of keypoints and normals, m, that fixes a rotation.
constexpr double kMinExtent = 0.01;
/// So many sigmas of a patch's own uncertainty, of at most so much, rad, widen the gate on its
/// normal.
constexpr double kNormalSigmas = 2, kMaxNormalSigma = 0.5;
/// Most patches that are combined: with more, pairs add nothing.
constexpr std::size_t kCombinedPatches = 2 * kBeam;

struct Candidate {
  Pose pose = Pose::Identity();
  PatchSet members;
  double area = 0;  // of the members, m^2
};

/// All patches, and every pair of the first ones.
std::vector<PatchSet> StartSets(std::size_t patches) {
  std::vector<PatchSet> sets;
  PatchSet all;
  for (std::size_t i = 0; i < patches; ++i) all.insert(i);
  sets.push_back(all);
  const std::size_t combined = std::min(patches, kCombinedPatches);
  for (std::size_t i = 0; i < combined; ++i) {
    for (std::size_t j = i + 1; j < combined; ++j) sets.push_back({i, j});
  }
  return sets;
}

/// Solves with the members, then with the patches that agree, until these are the members.
std::optional<Candidate> Grow(PatchSet members, const std::vector<SidePatch>& patches,
                              const std::vector<Eigen::Vector3d>& keypoints,
                              const Structure& structure) {
  std::optional<Pose> pose;
  bool stable = false;
  for (int round = 0; round <= kRounds && !stable; ++round) {
    if (members.size() < 2) return std::nullopt;
    pose = SolvePose(patches, members, keypoints, structure);
    if (!pose) return std::nullopt;
    if (round == kRounds) break;
    const PatchSet agreeing =
        AgreeingPatches(patches, keypoints, structure, kMostKeypointError, *pose);
    stable = agreeing == members;
    members = agreeing;
  }
  Candidate candidate{*pose, members, 0};
  for (const std::size_t i : members) candidate.area += patches[i].area;
  return candidate;
}

/// Weight of a patch. A large one outweighs a sliver, but two large ones are equals.
double Trust(const SidePatch& patch) { return patch.area / (patch.area + kHalfTrustArea); }

struct ShownPart {
  double area = 0;                                   // m^2
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();  // area times centroid, sensor frame
};

/// By label.
std::vector<ShownPart> ShownParts(const SensorView& view, const Structure& structure,
                                  const Pose& structure_from_sensor) {
  const ExpectedView model = CastView(structure, view.rays, structure_from_sensor);
  std::vector<ShownPart> shown(static_cast<std::size_t>(structure.num_classes()));
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      const int label = model.labels(u, v);
      // Where something stands in front, or nothing was measured, the patch lacks the pixel too.
      if (label == 0 || !(view.depth(u, v) > model.depth(u, v) - kFarthestOff)) continue;
      const double z = model.depth(u, v);
      const Eigen::Vector3d normal =
          structure_from_sensor.linear().transpose() * structure.SideOfLabel(label).normal;
      const double area = view.PixelArea(u, v, z, normal);
      ShownPart& part = shown[static_cast<std::size_t>(label)];
      part.area += area;
      part.moment += area * (z * view.Ray(u, v));
    }
  }
  return shown;
}

}  // namespace

std::vector<Eigen::Vector3d> SideKeypoints(const std::vector<SidePatch>& patches,
                                           const Structure& structure) {
  std::vector<Eigen::Vector3d> keypoints;
  keypoints.reserve(patches.size());
  for (const SidePatch& patch : patches)
    keypoints.push_back(structure.Keypoint(patch.label, KeypointKind::kExposed));
  return keypoints;
}

std::optional<Pose> SolvePose(const std::vector<SidePatch>& patches, const PatchSet& members,
                              const std::vector<Eigen::Vector3d>& keypoints,
                              const Structure& structure) {
  std::vector<Eigen::Vector3d> source, target;
  std::vector<double> weights;
  Eigen::Vector3d source_mean = Eigen::Vector3d::Zero(), target_mean = Eigen::Vector3d::Zero();
  double total = 0;
  for (const std::size_t i : members) {
    source.push_back(patches[i].centroid);
    target.push_back(keypoints[i]);
    weights.push_back(Trust(patches[i]) / (kKeypointSigma * kKeypointSigma));
    total += weights.back();
    source_mean += weights.back() * source.back();
    target_mean += weights.back() * target.back();
  }
  source_mean /= total;
  target_mean /= total;
  // Two points on either side of the mean leave the translation alone and turn the pose towards the
  // normal.
  for (const std::size_t i : members) {
    const SidePatch& patch = patches[i];
    const double sigma = std::hypot(patch.normal_sigma, kNormalSigma);
    for (const double arm : {-1.0, 1.0}) {
      source.push_back(source_mean + arm * patch.normal);
      target.push_back(target_mean + arm * structure.SideOfLabel(patch.label).normal);
      weights.push_back(Trust(patch) / (2 * sigma * sigma));
    }
  }
  const ProcrustesResult result = AlignPoints(source, target, weights);
  // Where the normals are parallel and the keypoints lie along them, the turn about them is free.
  if (!(result.extents[1] > kMinExtent)) return std::nullopt;
  return result.target_from_source;
}

PatchSet AgreeingPatches(const std::vector<SidePatch>& patches,
                         const std::vector<Eigen::Vector3d>& keypoints, const Structure& structure,
                         double max_distance_m, const Pose& structure_from_sensor) {
  std::map<int, std::pair<double, std::size_t>> nearest;  // of each label: distance and patch
  for (std::size_t i = 0; i < patches.size(); ++i) {
    const SidePatch& patch = patches[i];
    const double distance = (structure_from_sensor * patch.centroid - keypoints[i]).norm();
    const double cosine = (structure_from_sensor.linear() * patch.normal)
                              .dot(structure.SideOfLabel(patch.label).normal);
    const double angle = std::acos(std::clamp(cosine, -1.0, 1.0));
    const double max_angle =
        kMostNormalError + kNormalSigmas * std::min(patch.normal_sigma, kMaxNormalSigma);
    if (distance > max_distance_m || angle > max_angle) continue;
    const auto known = nearest.find(patch.label);
    if (known == nearest.end() || distance < known->second.first)
      nearest[patch.label] = {distance, i};
  }
  PatchSet agreeing;
  for (const auto& [label, patch] : nearest) agreeing.insert(patch.second);
  return agreeing;
}

std::vector<Pose> FindCandidates(const std::vector<SidePatch>& patches,
                                 const Structure& structure) {
  const std::vector<Eigen::Vector3d> keypoints = SideKeypoints(patches, structure);
  std::map<PatchSet, Candidate> unique;
  for (const PatchSet& start : StartSets(patches.size())) {
    if (const auto candidate = Grow(start, patches, keypoints, structure))
      unique.emplace(candidate->members, *candidate);
  }
  std::vector<Candidate> candidates;
  for (const auto& [members, candidate] : unique) candidates.push_back(candidate);
  KeepLargest(kBeam, &candidates, [](const Candidate& each) { return each.area; });
  std::vector<Pose> poses;
  poses.reserve(candidates.size());
  for (const Candidate& candidate : candidates) poses.push_back(candidate.pose);
  return poses;
}

std::vector<Eigen::Vector3d> VisibleKeypoints(const SensorView& view,
                                              const std::vector<SidePatch>& patches,
                                              const Structure& structure,
                                              const Pose& structure_from_sensor) {
  const std::vector<ShownPart> shown = ShownParts(view, structure, structure_from_sensor);
  std::vector<Eigen::Vector3d> keypoints = SideKeypoints(patches, structure);
  for (std::size_t i = 0; i < patches.size(); ++i) {
    const ShownPart& part = shown[static_cast<std::size_t>(patches[i].label)];
    if (!(part.area > 0) || part.area < kLeastShown * patches[i].area) continue;
    keypoints[i] = structure_from_sensor * Eigen::Vector3d(part.moment / part.area);
  }
  return keypoints;
}

std::optional<Pose> CorrectForVisibility(const SensorView& view,
                                         const std::vector<SidePatch>& patches,
                                         const Structure& structure, double max_distance_m,
                                         const Pose& structure_from_sensor) {
  const std::vector<Eigen::Vector3d> keypoints =
      VisibleKeypoints(view, patches, structure, structure_from_sensor);
  const PatchSet agreeing =
      AgreeingPatches(patches, keypoints, structure, max_distance_m, structure_from_sensor);
  if (agreeing.size() < 2) return std::nullopt;
  return SolvePose(patches, agreeing, keypoints, structure);
}

}  // namespace volalign
