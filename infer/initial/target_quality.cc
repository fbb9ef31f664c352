#include "infer/initial/target_quality.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

#include "core/geometry/lens.h"
#include "core/geometry/visibility.h"
#include "infer/initial/aliases.h"
#include "infer/initial/side_patch.h"
#include "infer/initial/sides_fix_pose.h"
#include "infer/view/alike.h"

namespace volalign {

namespace {

constexpr int kPatch = 10;                    // px
constexpr double kPatchSigma = 0.005;         // m
constexpr double kEdgeStep = 2 * kRoughPose;  // m
constexpr double kFocal = 252;                // px
constexpr double kLookAlike = 1 - kNotable;   // of the pixels
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

/// Of patches of the picture, each with the distance of its middle to its side's plane.
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

/// Of silhouettes: where a side ends before something far behind it, the picture tells the place
/// across its edge, to a pixel for each kPatch pixels of the edge.
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

/// Of the sensor's position, the standard deviation in its worst direction.
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

bool LookAlike(const DepthImage& a, const DepthImage& b) {
  int same = 0, either = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (a[i] == 0 && b[i] == 0) continue;
    ++either;
    same += a[i] > 0 && b[i] > 0 && std::abs(a[i] - b[i]) < kSamePlace;
  }
  return either > 0 && same >= kLookAlike * either;
}

TargetView MeasureView(const Structure& structure, const std::vector<StructureAlias>& aliases,
                       const Pose& pose, const RayTable& rays) {
  TargetView out;
  const ExpectedView view = CastView(structure, rays, pose);
  std::vector<int> pixels(static_cast<std::size_t>(structure.num_classes()), 0);
  for (const std::uint8_t label : view.labels) ++pixels[label];
  std::vector<int> usable;
  for (int label = 1; label < structure.num_classes(); ++label) {
    if (pixels[static_cast<std::size_t>(label)] >= SidePatchOptions().min_pixels)
      usable.push_back(label);
  }
  out.sides = static_cast<int>(usable.size());
  out.sides_fix_pose = SidesFixPose(structure, usable, KeypointKind::kExposed);
  out.weakest_m = WeakestSigma(PatchInformation(view, rays, structure, pose) +
                               EdgeInformation(view, rays, pose));
  for (std::size_t k = 0; k < aliases.size(); ++k) {
    if (LookAlike(view.depth, CastView(structure, rays, aliases[k].motion * pose).depth))
      out.look_alike.push_back(static_cast<int>(k));
  }
  return out;
}

}  // namespace

TargetQuality MeasureTarget(const Structure& structure, const TargetViewOptions& options) {
  TargetQuality quality;
  quality.options = options;
  const std::vector<StructureAlias> aliases = FindAliases(structure);
  const auto boxes = static_cast<int>(structure.boxes().size());
  for (const StructureAlias& alias : aliases) {
    quality.aliases.push_back({DescribeMotion(Pose::Identity(), alias.motion), alias.boxes,
                               alias.boxes == boxes, LeavesFloor(Pose::Identity(), alias.motion)});
  }
  const RayTable rays = ComputeRays(PlainIntrinsics());
  const Eigen::Vector3d middle = Middle(structure);
  for (const double height : options.heights_m) {
    for (int i = 0; i < options.directions; ++i) {
      const double phi = 2 * M_PI * i / options.directions;
      const Eigen::Vector3d eye(middle.x() + options.distance_m * std::cos(phi),
                                structure.FloorHeight() + height,
                                middle.z() + options.distance_m * std::sin(phi));
      TargetView view = MeasureView(structure, aliases, LookAt(eye, middle, 0), rays);
      view.phi_deg = phi / kDegree;
      view.height_m = height;
      quality.views.push_back(std::move(view));
    }
  }
  return quality;
}

}  // namespace volalign
