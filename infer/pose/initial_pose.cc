#include "infer/pose/initial_pose.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <bitset>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "core/procrustes.h"
#include "core/visibility.h"
#include "infer/view/held_out.h"

namespace volalign {

namespace {

constexpr std::size_t kMaxPatches = 64;
using PatchSet = std::bitset<kMaxPatches>;
struct PatchSetLess {
  bool operator()(const PatchSet& a, const PatchSet& b) const {
    return a.to_ullong() < b.to_ullong();
  }
};

/// Errors that the weights assume: of keypoints (visibility, labels), m, and of normals beside
/// their own, rad.
constexpr double kKeypointSigma = 0.03, kNormalSigma = 0.01;

/// Of the verification: depths agree, points lie on their side, m.
constexpr double kTolerance = 0.05;

/// Weight of a patch: a large one outweighs a sliver, but two large ones are equals.
double Trust(const SideEvidence& patch) { return patch.area / (patch.area + 0.03); }

class PoseSearch {
 public:
  PoseSearch(const SensorView& view, const SegmentationResult& segmentation,
             const Structure& structure, const InitialPoseOptions& options)
      : options_(options), structure_(structure) {
    evidence_ = CollectEvidence(view, segmentation, structure, options.evidence);
    std::stable_sort(evidence_.begin(), evidence_.end(),
                     [](const SideEvidence& a, const SideEvidence& b) { return a.area > b.area; });
    if (evidence_.size() > kMaxPatches) evidence_.resize(kMaxPatches);
    // About 10 000 rays say enough about a hypothesis, and 30 of them are tested.
    const int stride = std::max(
        1, static_cast<int>(std::floor(std::sqrt(static_cast<double>(view.depth.size()) / 10000))));
    full_view_ = &view;
    view_ = Decimate(view, stride);
    segmentation_.labels = DecimateImage(segmentation.labels, stride);
    segmentation_.confidence = DecimateImage(segmentation.confidence, stride);
  }

  InitialPose Run(const Pose* near) {
    InitialPose best;
    PatchSet chosen;
    std::vector<Candidate> candidates = Candidates(near);
    if (near) {
      candidates.push_back({*near, Agreeing(*near, {}, options_.max_keypoint_error_m), 0});
    }
    for (const Candidate& candidate : candidates) {
      Pose pose = candidate.pose;
      PatchSet members = candidate.members;
      for (int i = 0; i < options_.visibility_iterations; ++i) {
        if (!CorrectForVisibility(view_, i, &pose, &members)) break;
      }
      if (near && !Near(pose, *near)) continue;
      const Agreement agreement = CompareWithView(view_, segmentation_, structure_, pose,
                                                  options_.evidence.min_confidence, kTolerance);
      if (best.found && !(agreement.score() > best.agreement.score())) continue;
      best.found = true;
      best.structure_from_sensor = pose;
      best.agreement = agreement;
      chosen = members;
    }
    // Centroids on the decimated grid are a few millimetres off: the last corrections take every
    // pixel.
    for (int i = 0; best.found && i < std::min(options_.visibility_iterations, 3); ++i) {
      if (!CorrectForVisibility(*full_view_, kLast, &best.structure_from_sensor, &chosen)) break;
    }
    if (best.found) {
      best.from_keypoints = best.structure_from_sensor;
      FitToSides(&best.structure_from_sensor, &chosen);
      best.agreement = CompareWithView(view_, segmentation_, structure_, best.structure_from_sensor,
                                       options_.evidence.min_confidence, kTolerance);
    }
    for (std::size_t i = 0; i < evidence_.size(); ++i) {
      if (chosen[i]) best.consistent.push_back(static_cast<int>(i));
    }
    best.evidence = evidence_;
    return best;
  }

 private:
  static constexpr int kLast = 3;  // corrections after which the gate on keypoints stays
  struct Candidate {
    Pose pose;
    PatchSet members;
    double area = 0;
  };

  const Eigen::Vector3d& Keypoint(int label) const {
    return structure_.Keypoint(
        label, options_.keypoints == "centre" ? KeypointKind::kCentre : KeypointKind::kExposed);
  }

  /// Procrustes over the members' keypoints and normals; false if they fix no pose.
  bool Solve(const PatchSet& members, const std::map<int, Eigen::Vector3d>& keypoints,
             Pose* pose) const {
    std::vector<Eigen::Vector3d> source, target;
    std::vector<double> weights;
    std::vector<std::size_t> chosen;
    Eigen::Vector3d source_mean = Eigen::Vector3d::Zero(), target_mean = Eigen::Vector3d::Zero();
    double total = 0;
    for (std::size_t i = 0; i < evidence_.size(); ++i) {
      if (!members[i]) continue;
      const SideEvidence& patch = evidence_[i];
      const auto own = keypoints.find(static_cast<int>(i));
      chosen.push_back(i);
      source.push_back(patch.centroid);
      target.push_back(own != keypoints.end() ? own->second : Keypoint(patch.label));
      weights.push_back(Trust(patch) / (kKeypointSigma * kKeypointSigma));
      total += weights.back();
      source_mean += weights.back() * source.back();
      target_mean += weights.back() * target.back();
    }
    source_mean /= total;
    target_mean /= total;
    // A pair of points on both sides of the mean leaves the translation alone and turns the pose
    // towards the normal.
    for (const std::size_t i : chosen) {
      const SideEvidence& patch = evidence_[i];
      const double sigma = std::hypot(patch.normal_sigma, kNormalSigma);
      for (const double arm : {-1.0, 1.0}) {
        source.push_back(source_mean + arm * patch.normal);
        target.push_back(target_mean + arm * structure_.SideOfLabel(patch.label).normal);
        weights.push_back(Trust(patch) / (2 * sigma * sigma));
      }
    }
    const ProcrustesResult result = AlignPoints(source, target, weights);
    // Parallel normals, and keypoints in line with them, leave the turn about them free.
    if (!(result.extents[1] > 0.01)) return false;
    *pose = result.target_from_source;
    return true;
  }

  PatchSet Agreeing(const Pose& pose, const std::map<int, Eigen::Vector3d>& keypoints,
                    double max_distance) const {
    PatchSet set;
    std::map<int, std::pair<double, std::size_t>> nearest;  // one patch a label: the nearest
    for (std::size_t i = 0; i < evidence_.size(); ++i) {
      const SideEvidence& patch = evidence_[i];
      const auto own = keypoints.find(static_cast<int>(i));
      const Eigen::Vector3d& keypoint =
          own != keypoints.end() ? own->second : Keypoint(patch.label);
      const double distance = (pose * patch.centroid - keypoint).norm();
      const double cosine =
          (pose.linear() * patch.normal).dot(structure_.SideOfLabel(patch.label).normal);
      const double angle = std::acos(std::clamp(cosine, -1.0, 1.0));
      if (distance > max_distance) continue;
      if (angle >
          options_.max_normal_error_deg * M_PI / 180 + 2 * std::min(patch.normal_sigma, 0.5))
        continue;
      const auto found = nearest.find(patch.label);
      if (found == nearest.end() || distance < found->second.first)
        nearest[patch.label] = {distance, i};
    }
    for (const auto& [label, patch] : nearest) set.set(patch.second);
    return set;
  }

  void AddCandidate(PatchSet members,
                    std::map<PatchSet, Candidate, PatchSetLess>* candidates) const {
    Pose pose;
    for (int round = 0; round < 3; ++round) {
      if (members.count() < 2 || !Solve(members, {}, &pose)) return;
      const PatchSet agreeing = Agreeing(pose, {}, options_.max_keypoint_error_m);
      if (agreeing == members) break;
      members = agreeing;
    }
    if (members.count() < 2 || candidates->count(members) || !Solve(members, {}, &pose)) return;
    Candidate candidate{pose, members, 0};
    for (std::size_t i = 0; i < evidence_.size(); ++i) {
      if (members[i]) candidate.area += evidence_[i].area;
    }
    (*candidates)[members] = candidate;
  }

  static bool Near(const Pose& a, const Pose& b) {
    constexpr double kDistance = 0.2, kAngleDeg = 15;
    const PoseError gap = ComparePoses(a, b);
    return gap.translation_m < kDistance && gap.rotation_deg < kAngleDeg;
  }

  std::vector<Candidate> Candidates(const Pose* near) const {
    std::map<PatchSet, Candidate, PatchSetLess> unique;
    const std::size_t n = evidence_.size();
    PatchSet all;
    for (std::size_t i = 0; i < n; ++i) all.set(i);
    AddCandidate(all, &unique);
    for (std::size_t i = 0; i < n; ++i) {
      PatchSet others = all;
      others.reset(i);
      AddCandidate(others, &unique);
    }
    // Patches are sorted by area: beyond the twelve largest, triples add nothing.
    const std::size_t most = std::min<std::size_t>(n, 12);
    for (std::size_t i = 0; i < most; ++i) {
      for (std::size_t j = i + 1; j < most; ++j) {
        AddCandidate(PatchSet().set(i).set(j), &unique);
        for (std::size_t k = j + 1; k < most; ++k)
          AddCandidate(PatchSet().set(i).set(j).set(k), &unique);
      }
    }
    std::vector<Candidate> candidates;
    for (const auto& [members, candidate] : unique) {
      if (!near || Near(candidate.pose, *near)) candidates.push_back(candidate);
    }
    std::stable_sort(candidates.begin(), candidates.end(),
                     [](const Candidate& a, const Candidate& b) { return a.area > b.area; });
    constexpr std::size_t kTested = 8;
    if (candidates.size() > kTested) candidates.resize(kTested);
    return candidates;
  }

  /// Centroids, structure frame, of what each patch's side shows from `pose`.
  std::map<int, Eigen::Vector3d> VisibleKeypoints(const SensorView& view, const Pose& pose) const {
    const StructureView model = CastView(structure_, view.rays, pose);
    struct Sum {
      double area = 0;
      Eigen::Vector3d moment = Eigen::Vector3d::Zero();
    };
    std::map<int, Sum> shown;
    for (int v = 0; v < view.height(); ++v) {
      for (int u = 0; u < view.width(); ++u) {
        const int label = model.labels(u, v);
        // Where something stands in front, or nothing was measured, the side's centroid misses the
        // pixel too.
        if (label == 0 || !(view.depth(u, v) > model.depth(u, v) - 0.1)) continue;
        const Eigen::Vector2f& ray = view.rays.at(u, v);
        const double z = model.depth(u, v);
        const Eigen::Vector3d p(z * ray.x(), z * ray.y(), z);
        const Eigen::Vector3d normal =
            pose.linear().transpose() * structure_.SideOfLabel(label).normal;
        const double area = view.PixelArea(p, normal);
        shown[label].area += area;
        shown[label].moment += area * p;
      }
    }
    std::map<int, Eigen::Vector3d> keypoints;
    for (std::size_t i = 0; i < evidence_.size(); ++i) {
      const auto sum = shown.find(evidence_[i].label);
      if (sum == shown.end() || sum->second.area < 0.2 * evidence_[i].area) continue;
      keypoints[static_cast<int>(i)] =
          pose * Eigen::Vector3d(sum->second.moment / sum->second.area);
    }
    return keypoints;
  }

  /// Replaces keypoints by centroids of what the structure shows from `pose`, and solves again.
  bool CorrectForVisibility(const SensorView& view, int iteration, Pose* pose,
                            PatchSet* members) const {
    const std::map<int, Eigen::Vector3d> keypoints = VisibleKeypoints(view, *pose);
    PatchSet agreeing =
        Agreeing(*pose, keypoints, options_.max_keypoint_error_m / std::min(iteration + 1, kLast));
    if (agreeing.count() < 2) return false;
    Pose next;
    if (!Solve(agreeing, keypoints, &next)) return false;
    *pose = next;
    *members = agreeing;
    return true;
  }

  /// Gauss-Newton steps that bring each patch's points onto its finite side, Cauchy-weighted with a
  /// scale that shrinks, while the centroids of what is visible hold the directions along the sides
  /// (a rectangle alone would let points that lie within it slide). Points that are held out to
  /// judge the refinement stay out of it.
  void FitToSides(Pose* pose, PatchSet* members) const {
    // Errors of neighbouring pixels are alike: so many make one observation, with this spread, m.
    constexpr double kPixelsPerObservation = 200, kPointSigma = 0.005, kCentroidSigma = 0.01;
    // Boxes stand some millimetres off their places, which shifts all points of a side alike, m.
    constexpr double kPlacementSigma = 0.003;
    constexpr std::size_t kMostPoints = 400;  // of a patch
    for (int step = 0; step < options_.side_fit_steps; ++step) {
      const std::map<int, Eigen::Vector3d> keypoints = VisibleKeypoints(*full_view_, *pose);
      const PatchSet agreeing = Agreeing(*pose, keypoints, options_.max_keypoint_error_m / kLast);
      if (agreeing.count() < 2) return;
      const double scale = std::max(0.01, 0.04 / (1 << std::min(step, 8)));
      const Eigen::Vector3d pivot = *pose * evidence_.front().centroid;
      Matrix6d hessian = Matrix6d::Zero();
      Vector6d gradient = Vector6d::Zero();
      const auto add = [&](const Eigen::Vector3d& p, const Eigen::Vector3d& direction,
                           double residual, double weight) {
        Vector6d jacobian;
        jacobian << direction, (p - pivot).cross(direction);
        hessian += weight * jacobian * jacobian.transpose();
        gradient += weight * residual * jacobian;
      };
      for (std::size_t i = 0; i < evidence_.size(); ++i) {
        if (!agreeing[i]) continue;
        const SideEvidence& patch = evidence_[i];
        const Side& side = structure_.SideOfLabel(patch.label);
        const std::size_t stride = patch.pixels.size() / kMostPoints + 1;
        const double observations =
            std::max(1.0, static_cast<double>(patch.pixels.size()) / kPixelsPerObservation);
        const double share = observations * static_cast<double>(stride) /
                             static_cast<double>(patch.pixels.size()) / (kPointSigma * kPointSigma);
        Matrix6d squares = Matrix6d::Zero();
        Vector6d moment = Vector6d::Zero(), mean = Vector6d::Zero();
        double total = 0, offset = 0;
        for (std::size_t k = stride / 2; k < patch.pixels.size(); k += stride) {
          const int u = patch.pixels[k] % full_view_->width();
          const int v = patch.pixels[k] / full_view_->width();
          if (HeldOut(u, v)) continue;
          const Eigen::Vector3d p = *pose * full_view_->Point(u, v);
          const Eigen::Vector3d gap = side.ClosestPoint(p) - p;
          const double residual = gap.dot(side.normal);
          const double weight = share / (1 + gap.squaredNorm() / (scale * scale));
          Vector6d jacobian;
          jacobian << side.normal, (p - pivot).cross(side.normal);
          squares += weight * jacobian * jacobian.transpose();
          moment += weight * residual * jacobian;
          mean += weight * jacobian;
          offset += weight * residual;
          total += weight;
        }
        if (!(total > 0)) continue;
        mean /= total;
        offset /= total;
        // Marginal over the common offset: the patch's own tilt and bend keep their weight.
        const double centre_weight = 1 / (1 / total + kPlacementSigma * kPlacementSigma);
        hessian += squares + (centre_weight - total) * mean * mean.transpose();
        gradient += moment + (centre_weight - total) * offset * mean;
        const auto own = keypoints.find(static_cast<int>(i));
        if (own == keypoints.end()) continue;
        const Eigen::Vector3d p = *pose * patch.centroid;
        const Eigen::Vector3d gap = own->second - p;
        const double u = gap.dot(side.axis_u), v = gap.dot(side.axis_v);
        const double variance = kCentroidSigma * kCentroidSigma;
        const double weight = Trust(patch) / variance / (1 + (u * u + v * v) / (4 * variance));
        add(p, side.axis_u, u, weight);
        add(p, side.axis_v, v, weight);
      }
      // A prior of 1 m and 1 rad for directions that nothing holds.
      hessian.diagonal().array() += 1;
      const Vector6d delta = hessian.ldlt().solve(gradient);
      const Eigen::Matrix3d turn = RotationExp(delta.tail<3>());
      pose->translation() = pivot + turn * (pose->translation() - pivot) + delta.head<3>();
      pose->linear() = turn * pose->linear();
      *members = agreeing;
      if (delta.head<3>().norm() < 1e-4 && delta.tail<3>().norm() < 1e-4) return;
    }
  }

  const InitialPoseOptions& options_;
  const Structure& structure_;
  const SensorView* full_view_ = nullptr;
  SensorView view_;  // decimated
  SegmentationResult segmentation_;
  std::vector<SideEvidence> evidence_;
};

InitialPose EstimatePaperPose(const SensorView& view, const SegmentationResult& segmentation,
                              const Structure& structure, const InitialPoseOptions& options) {
  const auto classes = static_cast<std::size_t>(structure.num_classes());
  std::vector<Eigen::Vector3d> sums(classes, Eigen::Vector3d::Zero());
  std::vector<int> counts(classes, 0);
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      const std::size_t label = segmentation.labels(u, v);
      if (label == 0 || label >= classes || !(view.depth(u, v) > 0)) continue;
      if (segmentation.confidence(u, v) < options.evidence.min_confidence) continue;
      sums[label] += view.Point(u, v);
      ++counts[label];
    }
  }
  std::vector<Eigen::Vector3d> source, target;
  for (std::size_t label = 1; label < classes; ++label) {
    if (counts[label] < options.evidence.min_pixels) continue;
    source.push_back(sums[label] / counts[label]);
    target.push_back(structure.SideOfLabel(static_cast<int>(label)).centre);
  }
  InitialPose result;
  result.evidence = CollectEvidence(view, segmentation, structure, options.evidence);
  if (source.size() < 3 || !(SecondSingularValue(target) > kMinSecondSingularValue)) return result;
  result.found = true;
  result.structure_from_sensor = AlignPoints(source, target).target_from_source;
  result.from_keypoints = result.structure_from_sensor;
  result.agreement = CompareWithView(view, segmentation, structure, result.structure_from_sensor,
                                     options.evidence.min_confidence, kTolerance);
  for (std::size_t i = 0; i < result.evidence.size(); ++i)
    result.consistent.push_back(static_cast<int>(i));
  return result;
}

}  // namespace

InitialPose EstimateInitialPose(const SensorView& view, const SegmentationResult& segmentation,
                                const Structure& structure, const InitialPoseOptions& options,
                                const Pose* near) {
  if (options.method == "paper") return EstimatePaperPose(view, segmentation, structure, options);
  return PoseSearch(view, segmentation, structure, options).Run(near);
}

bool SidesFixPose(const Structure& structure, const std::vector<int>& labels, KeypointKind kind) {
  const std::set<int> unique(labels.begin(), labels.end());
  std::vector<Eigen::Vector3d> keypoints;
  for (const int label : unique) keypoints.push_back(structure.Keypoint(label, kind));
  if (keypoints.size() >= 3 && SecondSingularValue(keypoints) > kMinSecondSingularValue)
    return true;

  // Four points carry a rectangle's second moments.
  struct PlanePoint {
    Eigen::Vector3d p, normal;
  };
  std::vector<PlanePoint> points;
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const int label : unique) {
    const Side& side = structure.SideOfLabel(label);
    const double scale = 1 / std::sqrt(3.0);
    for (const double u : {-scale, scale}) {
      for (const double v : {-scale, scale}) {
        points.push_back(
            {side.centre + u * side.half_u * side.axis_u + v * side.half_v * side.axis_v,
             side.normal});
        middle += points.back().p;
      }
    }
  }
  if (points.empty()) return false;
  middle /= static_cast<double>(points.size());
  double arm = 0;
  for (const PlanePoint& point : points) arm += (point.p - middle).squaredNorm();
  arm = std::sqrt(arm / static_cast<double>(points.size()));
  Matrix6d normal_matrix = Matrix6d::Zero();
  for (const PlanePoint& point : points) {
    Vector6d row;
    row << point.normal, (point.p - middle).cross(point.normal) / arm;
    normal_matrix += row * row.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(normal_matrix);
  return solver.eigenvalues()[0] > 0.003 * normal_matrix.trace();
}

}  // namespace volalign
