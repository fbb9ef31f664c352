#include "infer/evaluate/suite/graph_icp.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "core/geometry/kd_tree.h"
#include "core/geometry/visibility.h"
#include "infer/refine/sensor_points.h"

namespace volalign {

namespace {

constexpr int kIterations = 25;  // rounds of correspondences and one Gauss-Newton step each
// m: points correspond within it, in the first round and in the last one. At the initial pose,
// points of a view within the first belong to the structure.
constexpr double kFirstDistance = 0.15, kLastDistance = 0.03;
constexpr double kMaxNormalAngle = 45 * kDegree;  // between normals of points that correspond
constexpr std::size_t kMaxPoints = 1500;          // per view, approximately
// m above the floor, below which points belong to it, at the initial pose.
constexpr double kFloorMargin = 0.02;
constexpr double kModelSpacing = 0.01;  // m, of the model's points
constexpr int kNormalRadius = 2;        // px, of the plane that gives a point's normal
constexpr double kDamping = 1e-6;       // of the mean diagonal, for directions that nothing fixes

struct Cloud {
  std::vector<Eigen::Vector3d> points, normals;
};

/// The exposed surface.
Cloud ModelCloud(const Structure& structure) {
  Cloud cloud;
  cloud.points = SampleExposedSurface(structure, kModelSpacing);
  for (const Eigen::Vector3d& p : cloud.points) {
    const int side = DistanceToSurface(structure, p).side;
    cloud.normals.push_back(structure.sides()[static_cast<std::size_t>(side)].normal);
  }
  return cloud;
}

/// Points of a view, sensor frame, that lie near the structure at the initial pose.
Cloud ViewCloud(const GraphFrame& of, const Structure& structure) {
  const SensorView& view = *of.view;
  const double lowest = structure.FloorHeight() + kFloorMargin;
  std::vector<std::pair<int, int>> pixels;
  for (int v = 0; v < view.height(); ++v) {
    for (int u = 0; u < view.width(); ++u) {
      if (!(view.depth(u, v) > 0)) continue;
      const Eigen::Vector3d p = of.structure_from_sensor * view.Point(u, v);
      if (p.y() > lowest && DistanceToSurface(structure, p).distance < kFirstDistance)
        pixels.emplace_back(u, v);
    }
  }
  const std::size_t step = pixels.size() / kMaxPoints + 1;
  Cloud cloud;
  for (std::size_t i = step / 2; i < pixels.size(); i += step) {
    const auto [u, v] = pixels[i];
    Eigen::Vector3d normal;
    if (!PixelNormal(view, u, v, &normal)) continue;
    cloud.points.push_back(view.Point(u, v));
    cloud.normals.push_back(normal);
  }
  return cloud;
}

Cloud Moved(const Cloud& cloud, const Pose& pose) {
  Cloud moved;
  for (const Eigen::Vector3d& p : cloud.points) moved.points.push_back(pose * p);
  for (const Eigen::Vector3d& n : cloud.normals) moved.normals.push_back(pose.linear() * n);
  return moved;
}

/// A point and the plane on which it should lie.
struct Match {
  Eigen::Vector3d from, to, normal;
};

struct Gate {
  double distance = 0;
  double cosine = 0;
};

std::vector<Match> FindMatches(const Cloud& from, const Cloud& to, const KdTree& tree, Gate gate) {
  std::vector<Match> matches;
  for (std::size_t i = 0; i < from.points.size(); ++i) {
    const KdTree::Neighbour found = tree.Nearest(from.points[i], gate.distance);
    if (found.index < 0) continue;
    const auto j = static_cast<std::size_t>(found.index);
    if (from.normals[i].dot(to.normals[j]) < gate.cosine) continue;
    matches.push_back({from.points[i], to.points[j], to.normals[j]});
  }
  return matches;
}

/// Gauss-Newton's equations for small motions of all views, delta as in PerturbLeft.
struct Equations {
  Eigen::MatrixXd matrix;
  Eigen::VectorXd vector;

  explicit Equations(std::size_t views)
      : matrix(Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(6 * views),
                                     static_cast<Eigen::Index>(6 * views))),
        vector(Eigen::VectorXd::Zero(static_cast<Eigen::Index>(6 * views))) {}

  /// `to` < 0: the model.
  void Add(const std::vector<Match>& matches, Eigen::Index from, Eigen::Index to) {
    for (const Match& match : matches) {
      const double residual = match.normal.dot(match.from - match.to);
      Vector6d by_from, by_to;
      by_from << match.normal, match.from.cross(match.normal);
      by_to << -match.normal, -match.to.cross(match.normal);
      AddBlock(by_from, by_from, from, from);
      vector.segment<6>(6 * from) += residual * by_from;
      if (to < 0) continue;
      AddBlock(by_to, by_to, to, to);
      AddBlock(by_from, by_to, from, to);
      AddBlock(by_to, by_from, to, from);
      vector.segment<6>(6 * to) += residual * by_to;
    }
  }
  Eigen::VectorXd Solve() {
    const double damping =
        kDamping * std::max(matrix.trace(), 1.0) / static_cast<double>(matrix.rows());
    matrix.diagonal().array() += damping;
    return -matrix.ldlt().solve(vector);
  }

 private:
  void AddBlock(const Vector6d& a, const Vector6d& b, Eigen::Index row, Eigen::Index column) {
    matrix.block<6, 6>(6 * row, 6 * column) += a * b.transpose();
  }
};

}  // namespace

std::vector<Pose> RefineGraph(const Structure& structure, const std::vector<GraphFrame>& views,
                              double min_overlap) {
  const Cloud model = ModelCloud(structure);
  const KdTree model_tree(model.points);
  std::vector<Pose> poses;
  std::vector<Cloud> clouds;
  for (const GraphFrame& view : views) {
    poses.push_back(view.structure_from_sensor);
    clouds.push_back(ViewCloud(view, structure));
  }
  const double cosine = std::cos(kMaxNormalAngle);
  std::vector<std::pair<std::size_t, std::size_t>> edges;
  for (int round = 0; round < kIterations && !views.empty(); ++round) {
    const double at = round / (kIterations - 1.0);
    const Gate gate{kFirstDistance * std::pow(kLastDistance / kFirstDistance, at), cosine};
    std::vector<Cloud> moved;
    std::vector<KdTree> trees;
    for (std::size_t i = 0; i < views.size(); ++i) {
      moved.push_back(Moved(clouds[i], poses[i]));
      trees.emplace_back(moved.back().points);
    }
    const auto matches = [&](std::size_t i, std::size_t j) {
      return FindMatches(moved[i], moved[j], trees[j], gate);
    };
    for (std::size_t i = 0; round == 0 && i < views.size(); ++i) {
      const double least = min_overlap * static_cast<double>(clouds[i].points.size());
      for (std::size_t j = 0; j < views.size(); ++j) {
        if (i != j && static_cast<double>(matches(i, j).size()) > least) edges.emplace_back(i, j);
      }
    }
    Equations equations(views.size());
    for (std::size_t i = 0; i < views.size(); ++i)
      equations.Add(FindMatches(moved[i], model, model_tree, gate), static_cast<Eigen::Index>(i),
                    -1);
    for (const auto& [i, j] : edges)
      equations.Add(matches(i, j), static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
    const Eigen::VectorXd step = equations.Solve();
    for (std::size_t i = 0; i < views.size(); ++i)
      poses[i] = PerturbLeft(step.segment<6>(static_cast<Eigen::Index>(6 * i)), poses[i]);
  }
  return poses;
}

}  // namespace volalign
