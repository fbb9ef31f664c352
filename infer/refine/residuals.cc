#include "infer/refine/residuals.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

namespace volalign::refine_internal {

namespace {

/// d (turn about the vertical by a) v / da, at a = 0.
Eigen::Vector3d VerticalCross(const Eigen::Vector3d& v) { return {v.z(), 0, -v.x()}; }

/// A plane of a box: of a side, or through an edge and perpendicular to the side. It moves with the
/// box: normal . (p - centre) = (1 + growth) * half.
struct MovedPlane {
  Eigen::Vector3d normal, nominal_centre, centre;
  double half, height;
  int box;
};

/// One sensor at its parameters, and the structure as built by them.
class Scene {
 public:
  /// `observed_lens`: the lens of the observations.
  Scene(const BuildModel& model, const FrameParameters& parameters, const LensChange& observed_lens)
      : model_(model),
        parameters_(parameters),
        lens_(Eigen::Map<const LensChange>(parameters.lens) - observed_lens +
              parameters.errors[kFocal] * LensChange::UnitX()),
        rotation_(Eigen::Quaterniond(parameters.pose).normalized().toRotationMatrix()),
        translation_(Eigen::Map<const Eigen::Vector3d>(parameters.pose + 4)),
        growth_(*parameters.build.size) {}

  const Eigen::Matrix3d& rotation() const { return rotation_; }
  const double* pose() const { return parameters_.pose; }
  double error(int which) const { return parameters_.errors[which]; }
  double gain() const { return 1 + error(kGain); }
  /// Change of ln(focal length) from the lens of the observations.
  double FocalChange() const { return lens_[0]; }
  Eigen::Index columns() const { return FrameColumns::kBoxes + model_.size().parameters(); }
  Eigen::Index ColumnOfBulge(int label) const {
    return FrameColumns::kBoxes + Eigen::Index{3} * model_.size().boxes + BuildModel::Bulge(label);
  }
  double Bulge(const FaceObservation& face) const {
    return face.bulge * parameters_.build.bulges[BuildModel::Bulge(face.label)];
  }
  const Side& SideOf(int label) const { return model_.structure().SideOfLabel(label); }
  Eigen::Vector3d InStructure(const Eigen::Vector3d& p) const {
    return rotation_ * p + translation_;
  }

  /// The ray of unit depth to an observation at p.
  Eigen::Vector3d Ray(const Eigen::Vector3d& p, const RayByLensMatrix& by_lens) const {
    Eigen::Vector3d ray = p / p.z();
    ray.head<2>() += by_lens * lens_;
    return ray;
  }
  /// Derivative of direction . R ray by the lens.
  Eigen::RowVector3d ByLens(const Eigen::Vector3d& direction,
                            const RayByLensMatrix& by_lens) const {
    return direction.transpose() * rotation_.leftCols<2>() * by_lens;
  }

  /// The point along `ray`, of unit depth, at the true depth.
  Eigen::Vector3d TruePoint(const FaceObservation& face, const Eigen::Vector3d& ray) const {
    const Eigen::Map<const SensorErrorVector> errors(parameters_.errors);
    return (face.p.z() + *parameters_.offset + face.by_errors.dot(errors)) * ray;
  }

  MovedPlane PlaneOf(const Side& side) const { return Moved(side, side.normal, 0); }
  MovedPlane PlaneOfEdge(const Side& side, int edge) const {
    const Border border = side.BorderAt(edge);
    return Moved(side, border.outward, border.extent);
  }

  double Distance(const MovedPlane& plane, const Eigen::Vector3d& at) const {
    return plane.normal.dot(at - plane.centre) - (1 + growth_) * plane.half;
  }
  /// Derivative of Distance(plane, R p + t), p fixed. at = R p + t.
  Eigen::RowVectorXd Derivative(const MovedPlane& plane, const Eigen::Vector3d& p,
                                const Eigen::Vector3d& at) const {
    constexpr Eigen::Index kBoxes = FrameColumns::kBoxes;
    Eigen::RowVectorXd row = Eigen::RowVectorXd::Zero(columns());
    row.head<4>() = plane.normal.transpose() * RotatedPointJacobian(parameters_.pose, p);
    row.segment<3>(4) = plane.normal.transpose();
    row[FrameColumns::kSize] = -plane.normal.y() * plane.height - plane.half;
    row[kBoxes + BuildModel::X(plane.box)] = -plane.normal.x();
    row[kBoxes + BuildModel::Z(plane.box)] = -plane.normal.z();
    row[kBoxes + BuildModel::Yaw(plane.box)] = VerticalCross(plane.normal).dot(at - plane.centre);
    return row;
  }

 private:
  /// The plane with this normal that lies `extent` outside of the side's centre.
  MovedPlane Moved(const Side& side, const Eigen::Vector3d& direction, double extent) const {
    const Box& box = model_.structure().boxes()[static_cast<std::size_t>(side.box)];
    const double* boxes = parameters_.build.boxes;
    MovedPlane plane;
    plane.box = side.box;
    plane.nominal_centre = box.structure_from_box.translation();
    plane.height = plane.nominal_centre.y() - model_.floor();
    plane.half = direction.dot(side.centre - plane.nominal_centre) + extent;
    plane.normal =
        Eigen::AngleAxisd(boxes[BuildModel::Yaw(side.box)], Eigen::Vector3d::UnitY()) * direction;
    plane.centre = plane.nominal_centre + Eigen::Vector3d(boxes[BuildModel::X(side.box)],
                                                          growth_ * plane.height,
                                                          boxes[BuildModel::Z(side.box)]);
    return plane;
  }

  const BuildModel& model_;
  const FrameParameters& parameters_;
  const LensChange lens_;  // from the lens of the observations
  const Eigen::Matrix3d rotation_;
  const Eigen::Vector3d translation_;
  const double growth_;
};

/// Distance of a block of points to its side's plane, divided by the gain. `jacobian` may be null.
double FaceResidual(const Scene& scene, const FaceObservation& face, Eigen::Index row,
                    Eigen::MatrixXd* jacobian) {
  const MovedPlane plane = scene.PlaneOf(scene.SideOf(face.label));
  const Eigen::Vector3d ray = scene.Ray(face.p, face.by_lens);
  const Eigen::Vector3d p = scene.TruePoint(face, ray), at = scene.InStructure(p);
  const double distance = (scene.Distance(plane, at) - scene.Bulge(face)) / scene.gain();
  if (jacobian) {
    jacobian->row(row) = scene.Derivative(plane, p, at);
    const double along = plane.normal.dot(scene.rotation() * ray);
    (*jacobian)(row, FrameColumns::kOffset) = along;
    jacobian->row(row).segment<kSensorErrors>(FrameColumns::kErrors) =
        along * face.by_errors.transpose();
    jacobian->row(row).segment<kLensParameters>(FrameColumns::kLens) =
        p.z() * scene.ByLens(plane.normal, face.by_lens);
    (*jacobian)(row, scene.ColumnOfBulge(face.label)) = -face.bulge;
    jacobian->row(row) /= scene.gain();
    (*jacobian)(row, FrameColumns::kErrors + kGain) -= distance / scene.gain();
  }
  return distance;
}

/// Distance of a silhouette from its edge. The silhouette's ray is extended to the side's plane, so
/// its depth does not count. The length is scaled to the silhouette's measured depth and the lens
/// of the observations. `jacobian` may be null.
double EdgeResidual(const Scene& scene, const EdgeObservation& edge, Eigen::Index row,
                    Eigen::MatrixXd* jacobian) {
  const Side& side = scene.SideOf(edge.label);
  const MovedPlane plane = scene.PlaneOf(side), line = scene.PlaneOfEdge(side, edge.edge);
  const Eigen::Vector3d ray = scene.Ray(edge.p, edge.by_lens), p = edge.p.z() * ray;
  const Eigen::Vector3d v = scene.rotation() * ray, at = scene.InStructure(p);
  const double behind = scene.Distance(plane, at);
  const double nv = plane.normal.dot(v), dv = line.normal.dot(v);
  const double beyond = behind / nv;
  const double distance = scene.Distance(line, at) - beyond * dv;
  const double nearer = edge.p.z() / (edge.p.z() - beyond);
  const double scale = nearer * std::exp(scene.FocalChange());
  if (jacobian) {
    constexpr Eigen::Index kLens = FrameColumns::kLens;
    const auto of_distance = [&](const MovedPlane& of) {
      Eigen::RowVectorXd by = scene.Derivative(of, p, at);
      by.segment<kLensParameters>(kLens) = edge.p.z() * scene.ByLens(of.normal, edge.by_lens);
      return by;
    };
    const auto of_slant = [&](const MovedPlane& of) {  // of.normal . v
      Eigen::RowVectorXd by = Eigen::RowVectorXd::Zero(scene.columns());
      by.head<4>() = of.normal.transpose() * RotatedPointJacobian(scene.pose(), ray);
      by.segment<kLensParameters>(kLens) = scene.ByLens(of.normal, edge.by_lens);
      by[FrameColumns::kBoxes + BuildModel::Yaw(of.box)] = VerticalCross(of.normal).dot(v);
      return by;
    };
    const Eigen::RowVectorXd by_beyond = (of_distance(plane) - beyond * of_slant(plane)) / nv;
    jacobian->row(row) = scale * (of_distance(line) - beyond * of_slant(line) +
                                  (distance * nearer / edge.p.z() - dv) * by_beyond);
    (*jacobian)(row, kLens) += scale * distance;
    (*jacobian)(row, FrameColumns::kErrors + kEdgeShift + edge.axis) = -edge.pixel;
  }
  return scale * distance - scene.error(kEdgeShift + edge.axis) * edge.pixel;
}

}  // namespace

void Residuals(const BuildModel& model, const FrameObservations& observed,
               const FrameParameters& parameters, Eigen::VectorXd* residuals,
               Eigen::MatrixXd* jacobian) {
  const Scene scene(model, parameters, observed.lens);
  const auto rows = static_cast<Eigen::Index>(observed.faces.size() + observed.edges.size());
  residuals->resize(rows);
  if (jacobian) jacobian->setZero(rows, scene.columns());
  Eigen::Index row = 0;
  for (const FaceObservation& face : observed.faces) {
    (*residuals)[row] = FaceResidual(scene, face, row, jacobian);
    ++row;
  }
  for (const EdgeObservation& edge : observed.edges) {
    (*residuals)[row] = EdgeResidual(scene, edge, row, jacobian);
    ++row;
  }
  if (jacobian) jacobian->col(FrameColumns::kErrors + kFocal) = jacobian->col(FrameColumns::kLens);
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
