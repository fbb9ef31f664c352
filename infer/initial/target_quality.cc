#include "infer/initial/target_quality.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

#include "core/geometry/lens.h"
#include "core/geometry/visibility.h"
#include "infer/initial/side_patch.h"
#include "infer/initial/sides_fix_pose.h"
#include "infer/initial/symmetries.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

constexpr int kPatch = 10;                                      // px
constexpr double kPatchSigma = 0.005;                           // m
constexpr double kEdgeStep = 2 * kRoughPose;                    // m
constexpr double kFocal = 252;                                  // px
constexpr double kLookAlike = 1 - kNotable;                     // of the pixels
constexpr int kCoarse = kPatch / 2, kEnough = kPatch * kPatch;  // px: see LookAlike
constexpr double kOpen = 1.0;  // m: standard deviation beyond which a direction is open

Intrinsics PlainIntrinsics() {
  Intrinsics intrinsics;
  intrinsics.width = 320;
  intrinsics.height = 288;
  intrinsics.fx = intrinsics.fy = kFocal;
  intrinsics.cx = (intrinsics.width - 1) / 2.0;
  intrinsics.cy = (intrinsics.height - 1) / 2.0;
  return intrinsics;
}

Eigen::Vector3d Middle(const Structure& structure) {
  Eigen::AlignedBox3d all;
  for (const Side& side : structure.sides()) all.extend(side.centre);
  return all.center();
}

/// Information of the picture's patches: each measures the distance of its middle to its side's
/// plane.
Matrix6d PatchInformation(const ExpectedView& view, const RayTable& rays,
                          const Structure& structure, const Pose& pose) {
  Matrix6d information = Matrix6d::Zero();
  for (int v = kPatch / 2; v < view.depth.height(); v += kPatch) {
    for (int u = kPatch / 2; u < view.depth.width(); u += kPatch) {
      if (view.labels(u, v) == 0) continue;
      const Eigen::Vector2f& ray = rays.at(u, v);
      const double z = view.depth(u, v);
      const Eigen::Vector3d point = pose * Eigen::Vector3d(ray.x() * z, ray.y() * z, z);
      const Eigen::Vector3d& normal = structure.SideOfLabel(view.labels(u, v)).normal;
      Vector6d row;
      row << normal, (point - pose.translation()).cross(normal);
      information += row * row.transpose() / (kPatchSigma * kPatchSigma);
    }
  }
  return information;
}

/// Information of silhouettes. Where a side ends before something far behind it, the picture tells
/// the place across its edge. Each kPatch pixels of the edge tell it to a pixel.
Matrix6d EdgeInformation(const ExpectedView& view, const RayTable& rays, const Pose& pose) {
  constexpr int kWindow = 2;  // px
  Matrix6d information = Matrix6d::Zero();
  const int width = view.depth.width(), height = view.depth.height();
  for (int v = kWindow; v < height - kWindow; ++v) {
    for (int u = kWindow; u < width - kWindow; ++u) {
      const float z = view.depth(u, v);
      if (view.labels(u, v) == 0) continue;
      const auto is_beyond = [&](int p, int q) {
        return view.depth(p, q) == 0 || view.depth(p, q) > z + kEdgeStep;
      };
      if (!is_beyond(u - 1, v) && !is_beyond(u + 1, v) && !is_beyond(u, v - 1) &&
          !is_beyond(u, v + 1))
        continue;
      Eigen::Vector2d outwards = Eigen::Vector2d::Zero();
      for (int dv = -kWindow; dv <= kWindow; ++dv) {
        for (int du = -kWindow; du <= kWindow; ++du) {
          if (is_beyond(u + du, v + dv)) outwards += Eigen::Vector2d(du, dv);
        }
      }
      if (outwards.norm() == 0) continue;
      outwards.normalize();
      const Eigen::Vector2f& ray = rays.at(u, v);
      const Eigen::Vector3d from_eye = pose.linear() * Eigen::Vector3d(ray.x() * z, ray.y() * z, z);
      const Eigen::Vector3d across = pose.linear() * Eigen::Vector3d(outwards.x(), outwards.y(), 0);
      Vector6d row;
      row << across, from_eye.cross(across);
      const double sigma = z / kFocal;
      information += row * row.transpose() / (kPatch * sigma * sigma);
    }
  }
  return information;
}

/// Standard deviation of the sensor's position in its worst direction.
double WeakestSigma(const Matrix6d& information) {
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(information);
  const double least = 1 / (kOpen * kOpen);
  if (solver.eigenvalues()[0] < least) return std::numeric_limits<double>::infinity();
  const Matrix6d covariance = solver.eigenvectors() *
                              solver.eigenvalues().cwiseInverse().asDiagonal() *
                              solver.eigenvectors().transpose();
  return std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance.topLeftCorner<3, 3>(),
                                                                  Eigen::EigenvaluesOnly)
                       .eigenvalues()[2]);
}

/// Share of the pixels on the stack in either picture that have the same depth in both.
struct Alike {
  int same = 0, either = 0;
  double share() const { return either > 0 ? static_cast<double>(same) / either : 0; }
};

Alike Compare(const DepthImage& a, const DepthImage& b) {
  Alike alike;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (a[i] == 0 && b[i] == 0) continue;
    ++alike.either;
    alike.same += a[i] > 0 && b[i] > 0 && std::abs(a[i] - b[i]) < kSamePlace;
  }
  return alike;
}

/// The rays of every kCoarse-th pixel of every kCoarse-th row.
RayTable Coarse(const RayTable& rays) {
  RayTable coarse;
  coarse.width = rays.width / kCoarse;
  coarse.height = rays.height / kCoarse;
  for (int v = 0; v < coarse.height; ++v) {
    for (int u = 0; u < coarse.width; ++u)
      coarse.rays.push_back(rays.at(kCoarse * u + kCoarse / 2, kCoarse * v + kCoarse / 2));
  }
  return coarse;
}

/// A sensor's rays, and a few of them, which tell most symmetries apart.
struct Rays {
  RayTable all, coarse;
};

/// A few rays decide where enough of them meet the stack and far more, or far fewer, differ than
/// may. A tower of many boxes has hundreds of symmetries.
bool LookAlike(const Structure& structure, const Rays& rays, const Pose& pose,
               const DepthImage& depth, const DepthImage& coarse) {
  const Alike few = Compare(coarse, CastView(structure, rays.coarse, pose).depth);
  const double differ = 1 - few.share();
  if (few.either >= kEnough && (differ > 3 * kNotable || differ < kNotable / 4))
    return differ < kNotable;
  const Alike all = Compare(depth, CastView(structure, rays.all, pose).depth);
  return all.either > 0 && all.share() >= kLookAlike;
}

TargetView MeasureView(const Structure& structure, const std::vector<StructureSymmetry>& symmetries,
                       const Pose& pose, const Rays& all_rays) {
  TargetView out;
  const RayTable& rays = all_rays.all;
  const ExpectedView view = CastView(structure, rays, pose);
  std::vector<int> pixels(static_cast<std::size_t>(structure.num_classes()), 0);
  for (const std::uint8_t label : view.labels) ++pixels[label];
  std::vector<int> usable;
  for (int label = 1; label < structure.num_classes(); ++label) {
    if (pixels[static_cast<std::size_t>(label)] >= kFewestSidePixels) usable.push_back(label);
  }
  out.sides = static_cast<int>(usable.size());
  out.sides_fix_pose = SidesFixPose(structure, usable);
  out.weakest_m = WeakestSigma(PatchInformation(view, rays, structure, pose) +
                               EdgeInformation(view, rays, pose));
  const DepthImage coarse = CastView(structure, all_rays.coarse, pose).depth;
  for (std::size_t k = 0; k < symmetries.size(); ++k) {
    if (LookAlike(structure, all_rays, symmetries[k].motion * pose, view.depth, coarse))
      out.look_alike.push_back(static_cast<int>(k));
  }
  return out;
}

}  // namespace

TargetQuality MeasureTarget(const Structure& structure, const TargetViewOptions& options,
                            const CountDone& count) {
  TargetQuality quality;
  quality.options = options;
  const std::vector<StructureSymmetry> symmetries = FindSymmetries(structure);
  const auto boxes = static_cast<int>(structure.boxes().size());
  for (const StructureSymmetry& symmetry : symmetries) {
    quality.symmetries.push_back({DescribeMotion(Pose::Identity(), symmetry.motion), symmetry.boxes,
                                  symmetry.boxes == boxes,
                                  LeavesFloor(Pose::Identity(), symmetry.motion)});
  }
  const RayTable rays = ComputeRays(PlainIntrinsics());
  const Rays all_rays{rays, Coarse(rays)};
  const Eigen::Vector3d middle = Middle(structure);
  const std::int64_t views =
      options.directions * static_cast<std::int64_t>(options.heights_m.size());
  for (const double height : options.heights_m) {
    for (int i = 0; i < options.directions; ++i) {
      if (count) count(static_cast<std::int64_t>(quality.views.size()), views);
      const double phi = 2 * M_PI * i / options.directions;
      const Eigen::Vector3d eye(middle.x() + options.distance_m * std::cos(phi),
                                structure.FloorHeight() + height,
                                middle.z() + options.distance_m * std::sin(phi));
      TargetView view = MeasureView(structure, symmetries, LookAt(eye, middle, 0), all_rays);
      view.phi_deg = phi / kDegree;
      view.height_m = height;
      quality.views.push_back(std::move(view));
    }
  }
  return quality;
}

}  // namespace volalign
