#include "infer/refine/residuals.h"

#include <ceres/jet.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "core/geometry/structure.h"

namespace volalign::refine_internal {

namespace {

/// The parameters that move one observation: those of FrameColumns up to the size, its box's, and
/// its side's bulge.
constexpr int kOfBox = FrameColumns::kBoxes, kOfBulge = kOfBox + Eigen::Vector3d::RowsAtCompileTime,
              kOfOne = kOfBulge + 1;

template <class T>
using Vector3 = Eigen::Matrix<T, 3, 1>;

/// A plane of a side's box: of the side, or through an edge and perpendicular to the side. It has
/// this normal, lies `extent` outside of the side's centre, and moves with the box.
template <class T>
struct MovedPlane {
  MovedPlane(const BuildModel& model, const Side& side, const Eigen::Vector3d& direction,
             double extent, const T* x) {
    const Eigen::Vector3d centre = model.structure()
                                       .boxes()[static_cast<std::size_t>(side.box)]
                                       .structure_from_box.translation();
    const T& growth = x[FrameColumns::kSize];
    const T* const box = x + kOfBox;
    const Vector3<T> moved(centre.x() + box[BuildModel::X(0)],
                           centre.y() + growth * (centre.y() - model.floor()),
                           centre.z() + box[BuildModel::Z(0)]);
    normal = Eigen::AngleAxis<T>(box[BuildModel::Yaw(0)], Vector3<T>::UnitY()) *
             Vector3<T>(direction.cast<T>());
    offset = normal.dot(moved) + (1.0 + growth) * (direction.dot(side.centre - centre) + extent);
  }
  T Distance(const Vector3<T>& at) const { return normal.dot(at) - offset; }

  Vector3<T> normal;
  T offset;
};

/// A sensor, and the ray of unit depth to an observation at p. `lens`: that of the observations.
template <class T>
struct Sight {
  Sight(const Eigen::Vector3d& p, const RayByLensMatrix& by_lens, const LensChange& lens,
        const T* x)
      : rotation(Eigen::Quaternion<T>(x).normalized().toRotationMatrix()),
        translation(x[4], x[5], x[6]) {
    Vector3<T> change = Eigen::Map<const Vector3<T>>(x + FrameColumns::kLens) - lens.cast<T>();
    change[0] += x[FrameColumns::kErrors + kFocal];
    focal_change = change[0];
    Vector3<T> ray = (p / p.z()).cast<T>();
    ray.template head<2>() += by_lens.cast<T>() * change;
    turned = rotation * ray;
  }
  /// The point along the ray at this depth, structure frame.
  Vector3<T> At(const T& depth) const { return depth * turned + translation; }

  Eigen::Matrix<T, 3, 3> rotation;
  Vector3<T> translation, turned;  // turned: the ray, structure frame
  T focal_change;                  // of ln(focal length), from the lens of the observations
};

/// Distance of a block of points to its side's plane, divided by the gain.
template <class T>
T Residual(const BuildModel& model, const FaceObservation& face, const LensChange& lens,
           const T* x) {
  const T* const errors = x + FrameColumns::kErrors;
  T depth = face.p.z() + x[FrameColumns::kOffset];
  for (int k = 0; k < kSensorErrors; ++k) depth += face.by_errors[k] * errors[k];
  const Side& side = model.structure().SideOfLabel(face.label);
  const T distance = MovedPlane<T>(model, side, side.normal, 0, x)
                         .Distance(Sight<T>(face.p, face.by_lens, lens, x).At(depth));
  return (distance - face.bulge * x[kOfBulge]) / (1.0 + errors[kGain]);
}

/// Distance of a silhouette from its edge. The silhouette's ray is extended to the side's plane, so
/// its depth does not count. The length is scaled to the silhouette's measured depth and the lens
/// of the observations.
template <class T>
T Residual(const BuildModel& model, const EdgeObservation& edge, const LensChange& lens,
           const T* x) {
  using std::exp;
  const Side& side = model.structure().SideOfLabel(edge.label);
  const Border border = side.BorderAt(edge.edge);
  const MovedPlane<T> plane(model, side, side.normal, 0, x),
      line(model, side, border.outward, border.extent, x);
  const Sight<T> sight(edge.p, edge.by_lens, lens, x);
  const Vector3<T> at = sight.At(T(edge.p.z()));
  const T beyond = plane.Distance(at) / plane.normal.dot(sight.turned);
  const T distance = line.Distance(at) - beyond * line.normal.dot(sight.turned);
  const T scale = edge.p.z() / (edge.p.z() - beyond) * exp(sight.focal_change);
  return scale * distance - edge.pixel * x[FrameColumns::kErrors + kEdgeShift + edge.axis];
}

/// Fills the rows of these observations from `row` on. `jacobian` may be null.
template <class Observation>
void FillRows(const BuildModel& model, const std::vector<Observation>& observations,
              const LensChange& lens, const FrameParameters& parameters, Eigen::Index row,
              Eigen::VectorXd* residuals, Eigen::MatrixXd* jacobian) {
  using Jet = ceres::Jet<double, kOfOne>;
  Eigen::Matrix<double, kOfOne, 1> x;
  x << Eigen::Map<const Eigen::Matrix<double, 7, 1>>(parameters.pose), *parameters.offset,
      Eigen::Map<const SensorErrorVector>(parameters.errors),
      Eigen::Map<const LensChange>(parameters.lens), *parameters.build.size,
      Eigen::Vector4d::Zero();
  for (const Observation& observation : observations) {
    const Eigen::Index box = BuildModel::X(model.structure().SideOfLabel(observation.label).box),
                       bulge = BuildModel::Bulge(observation.label);
    x.segment<3>(kOfBox) = Eigen::Map<const Eigen::Vector3d>(parameters.build.boxes + box);
    x[kOfBulge] = parameters.build.bulges[bulge];
    if (jacobian) {
      std::array<Jet, kOfOne> jets;
      for (int k = 0; k < kOfOne; ++k) jets[static_cast<std::size_t>(k)] = Jet(x[k], k);
      const Jet residual = Residual(model, observation, lens, jets.data());
      (*residuals)[row] = residual.a;
      jacobian->row(row).head<kOfBox>() = residual.v.head<kOfBox>();
      jacobian->row(row).segment<3>(kOfBox + box) = residual.v.segment<3>(kOfBox);
      (*jacobian)(row, kOfBox + Eigen::Index{3} * model.size().boxes + bulge) =
          residual.v[kOfBulge];
    } else {
      (*residuals)[row] = Residual(model, observation, lens, x.data());
    }
    ++row;
  }
}

}  // namespace

void Residuals(const BuildModel& model, const FrameObservations& observed,
               const FrameParameters& parameters, Eigen::VectorXd* residuals,
               Eigen::MatrixXd* jacobian) {
  const auto faces = static_cast<Eigen::Index>(observed.faces.size());
  const Eigen::Index rows = faces + static_cast<Eigen::Index>(observed.edges.size());
  residuals->resize(rows);
  if (jacobian) jacobian->setZero(rows, kOfBox + model.size().parameters());
  FillRows(model, observed.faces, observed.lens, parameters, 0, residuals, jacobian);
  FillRows(model, observed.edges, observed.lens, parameters, faces, residuals, jacobian);
}

void WhitenedResiduals(const BuildModel& model, const FrameObservations& observed,
                       const FrameParameters& parameters, const std::vector<Eigen::Index>& wanted,
                       Eigen::VectorXd* residuals, Eigen::MatrixXd* jacobian) {
  Residuals(model, observed, parameters, residuals, jacobian);
  const auto faces = static_cast<Eigen::Index>(observed.faces.size());
  const auto whiten = [&](auto* rows) {
    const Eigen::Index edges = rows->rows() - faces;
    observed.face_root.triangularView<Eigen::Lower>().solveInPlace(rows->topRows(faces));
    observed.edge_root.triangularView<Eigen::Lower>().solveInPlace(rows->bottomRows(edges));
  };
  whiten(residuals);
  if (!jacobian) return;
  *jacobian = (*jacobian)(Eigen::all, wanted).eval();
  whiten(jacobian);
}

SensorCost::SensorCost(const BuildModel& model, const FrameObservations& observed)
    : model_(model), observed_(observed) {
  set_num_residuals(static_cast<int>(observed.faces.size() + observed.edges.size()));
  *mutable_parameter_block_sizes() = {
      7, 1, kSensorErrors, kLensParameters, 1, 3 * model.size().boxes, model.size().sides};
}

bool SensorCost::Evaluate(double const* const* parameters, double* residuals,
                          double** jacobians) const {
  // Whitening costs most: constant parameters need no derivatives.
  std::vector<Eigen::Index> wanted;
  Eigen::Index column = 0;
  for (std::size_t b = 0; b < parameter_block_sizes().size(); ++b) {
    for (int k = 0; k < parameter_block_sizes()[b]; ++k, ++column) {
      if (jacobians && jacobians[b]) wanted.push_back(column);
    }
  }
  Eigen::VectorXd r;
  Eigen::MatrixXd white;
  WhitenedResiduals(model_, observed_,
                    {parameters[0],
                     parameters[1],
                     parameters[2],
                     parameters[3],
                     {parameters[4], parameters[5], parameters[6]}},
                    wanted, &r, jacobians ? &white : nullptr);
  std::copy_n(r.data(), r.size(), residuals);
  column = 0;
  for (std::size_t b = 0; jacobians && b < parameter_block_sizes().size(); ++b) {
    if (!jacobians[b]) continue;
    const Eigen::Index width = parameter_block_sizes()[b];
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Eigen::Map<RowMajor>(jacobians[b], r.size(), width) = white.middleCols(column, width);
    column += width;
  }
  return true;
}

}  // namespace volalign::refine_internal
