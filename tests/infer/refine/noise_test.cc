#include "infer/refine/noise.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <cstdint>

#include "tests/infer/refine/points_and_observations.h"

namespace volalign::refine_internal::noise_test {
namespace {

using testing_infer::Observe;
using testing_infer::PaperStructure;
using testing_infer::ParameterPoint;
using testing_infer::RingPose;

/// Correlation of two bearings, rad apart, of a Matern field of smoothness 3/2 (Rasmussen and
/// Williams, "Gaussian Processes for Machine Learning", equation 4.17).
double Matern(const Eigen::Vector3d& a, const Eigen::Vector3d& b, double length) {
  const double d = (a / a.z() - b / b.z()).norm();
  return (1 + std::sqrt(3.0) * d / length) * std::exp(-std::sqrt(3.0) * d / length);
}

TEST(FitNoise, FindsTheSizeOfWarps) {
  // Depths that are off by a Gaussian field over the image, of known size at 2 m and growing with
  // the depth, pose and constants unknown.
  const Structure structure = PaperStructure();
  const BuildModel model(structure);
  const Pose pose = RingPose(35);
  FrameObservations clean = Observe(structure, pose, 14);
  for (FaceObservation& face : clean.faces) face.multipath = 0;
  const auto n = static_cast<Eigen::Index>(clean.faces.size());
  ASSERT_GT(n, 60);
  Priors priors;
  priors.offset = 0.007;
  priors.gain = 0.003;
  priors.edge_shift = 0.7;
  constexpr double kLength = 0.1;
  Eigen::MatrixXd correlation(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < n; ++j)
      correlation(i, j) = Matern(clean.faces[static_cast<std::size_t>(i)].p,
                                 clean.faces[static_cast<std::size_t>(j)].p, kLength);
  }
  const Eigen::MatrixXd root = correlation.ldlt().transpositionsP().transpose() *
                               (Eigen::MatrixXd(correlation.ldlt().matrixL()) *
                                correlation.ldlt().vectorD().cwiseMax(0).cwiseSqrt().asDiagonal());
  ASSERT_TRUE((root * root.transpose()).isApprox(correlation, 1e-9));
  for (const double sigma : {0.002, 0.008}) {
    double size = 0, length = 0;
    constexpr int kDraws = 12;
    for (int draw = 0; draw < kDraws; ++draw) {
      RandomStream random(3, static_cast<std::uint64_t>(draw), "warp");
      Eigen::VectorXd white(n);
      for (Eigen::Index i = 0; i < n; ++i) white[i] = random.Normal();
      const Eigen::VectorXd field = root * white;
      FrameObservations seen = clean;
      for (Eigen::Index i = 0; i < n; ++i) {
        FaceObservation& face = seen.faces[static_cast<std::size_t>(i)];
        face.p *= 1 + sigma / 2 * field[i];
      }
      const ParameterPoint at(model, pose);
      FitNoise(model, ErrorsOf(""), at.Parameters(), priors, &seen);
      size += std::log(seen.noise.depth.smooth_m / sigma) / kDraws;
      length += std::log(seen.noise.depth.smooth_rad / kLength) / kDraws;
      EXPECT_EQ(seen.face_root.rows(), n) << "the factor is that of the fitted covariance";
    }
    EXPECT_LT(std::abs(size), std::log(1.3)) << sigma << ": off by " << std::exp(size);
    // Only three lengths are looked at.
    EXPECT_LT(std::abs(length), std::log(1.6)) << kLength << ": off by " << std::exp(length);
  }
}

TEST(FitNoise, KeepsWhatIsUsualWhereFacesAreTooFew) {
  const Structure structure = PaperStructure();
  const BuildModel model(structure);
  const Pose pose = RingPose(35);
  for (const char* kind : {"realsense_d415", "kinect_v1", "azure_kinect_nfov_binned", ""}) {
    FrameObservations seen = Observe(structure, pose, 14);
    seen.faces.resize(12);
    seen.noise = UsualNoise(kind);
    const ParameterPoint at(model, pose);
    FitNoise(model, UsualNoise(kind).depth, at.Parameters(), testing_infer::SomePriors(), &seen);
    EXPECT_EQ(seen.noise.depth.smooth_m, ErrorsOf("").smooth_m) << kind;
    EXPECT_EQ(seen.noise.depth.seam_m, ErrorsOf(kind).seam_m) << kind;
  }
}

/// Points along the borders of the sides that the sensor faces, as they are.
FrameObservations BordersOf(const Structure& structure, const Pose& pose) {
  FrameObservations seen;
  const Pose sensor_from_structure = pose.inverse();
  for (int label = 1; label < structure.num_classes(); ++label) {
    const Side& side = structure.SideOfLabel(label);
    if (side.normal.dot(side.centre - pose.translation()) > -0.5) continue;
    for (int edge = 0; edge < 4; ++edge) {
      const Eigen::Vector3d across =
                                (edge < 2 ? side.half_u * side.axis_u : side.half_v * side.axis_v),
                            along =
                                (edge < 2 ? side.half_v * side.axis_v : side.half_u * side.axis_u);
      for (const double t : {-0.6, 0.0, 0.6}) {
        EdgeObservation point;
        point.p =
            sensor_from_structure * (side.centre + (edge % 2 == 0 ? across : -across) + t * along);
        point.label = label;
        point.edge = edge;
        point.pixel = point.p.z() / 252.2;
        point.variance = 0.1;
        seen.edges.push_back(point);
      }
    }
  }
  return seen;
}

TEST(FitNoise, FindsTheScaleOfEdges) {
  const Structure structure = PaperStructure();
  const BuildModel model(structure);
  const Pose pose = RingPose(35);
  FrameObservations clean = BordersOf(structure, pose);
  clean.noise.edge = 1;
  SetCovariance(model, pose, &clean);
  const auto n = static_cast<Eigen::Index>(clean.edges.size());
  ASSERT_GT(n, 60);
  ASSERT_LE(n, 110);  // of more, some would be taken
  Priors priors;
  priors.edge_shift = 0.7;
  for (const double scale : {0.5, 2.0, 4.0}) {
    double fitted = 0;
    constexpr int kDraws = 8;
    for (int draw = 0; draw < kDraws; ++draw) {
      RandomStream random(4, static_cast<std::uint64_t>(draw), "edges");
      Eigen::VectorXd white(n);
      for (Eigen::Index i = 0; i < n; ++i) white[i] = random.Normal();
      const Eigen::VectorXd moved = scale * (clean.edge_root * white);
      FrameObservations seen = clean;
      for (Eigen::Index i = 0; i < n; ++i) {
        EdgeObservation& edge = seen.edges[static_cast<std::size_t>(i)];
        const Side& side = structure.SideOfLabel(edge.label);
        const Eigen::Vector3d outwards =
            (edge.edge < 2 ? side.axis_u : side.axis_v) * (edge.edge % 2 == 0 ? 1 : -1);
        edge.p += pose.linear().transpose() * outwards * moved[i];
      }
      const ParameterPoint at(model, pose);
      FitNoise(model, ErrorsOf(""), at.Parameters(), priors, &seen);
      fitted += std::log(seen.noise.edge / scale) / kDraws;
    }
    EXPECT_LT(std::abs(fitted), std::log(1.25)) << scale << ": off by " << std::exp(fitted);
  }
}

TEST(SetCovariance, IsThatOfItsParts) {
  const Structure structure = PaperStructure();
  const BuildModel model(structure);
  const Pose pose = RingPose(20);
  FrameObservations observed = Observe(structure, pose, 40);
  EdgeObservation edge;
  edge.p = observed.faces.front().p;
  edge.label = observed.faces.front().label;
  edge.pixel = 0.008;
  edge.variance = 0.1;
  observed.edges = {edge, edge, edge};
  observed.edges[1].p += Eigen::Vector3d(0.02, 0.01, 0);
  observed.edges[2].edge = 2;  // another line: nothing in common
  observed.noise.depth.smooth_m = 0.004;
  observed.noise.depth.smooth_rad = 0.1;
  observed.noise.edge = 1.5;
  observed.noise.line = 0.003;
  observed.faces[3].aside_rad = 0.0027;
  SetCovariance(model, pose, &observed);
  const Eigen::MatrixXd faces = observed.face_root * observed.face_root.transpose();
  for (std::size_t i = 0; i < observed.faces.size(); ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      // A depth error of 4 mm at 2 m moves a point by its cosine; but at grazing incidence by a
      // fifth.
      const auto moved = [&](const FaceObservation& face) {
        const Eigen::Vector3d ray = pose.linear() * face.p / face.p.z();
        const double along = structure.SideOfLabel(face.label).normal.dot(ray);
        return 0.004 * face.p.z() / 2 * std::sqrt(along * along + 0.2 * 0.2);
      };
      const FaceObservation &a = observed.faces[i], &b = observed.faces[j];
      double expected = moved(a) * moved(b) * Matern(a.p, b.p, 0.1);
      if (i == j) {
        const Eigen::Vector3d normal =
            pose.linear().transpose() * structure.SideOfLabel(a.label).normal;
        const double sine = normal.cross(a.p.normalized()).norm();
        const double aside = std::hypot(0.0003, i == 3 ? 0.0027 : 0);
        expected += a.variance + std::pow(sine * aside * a.p.z(), 2) + 1e-6 / 12;
      }
      EXPECT_NEAR(faces(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)), expected,
                  1e-11);
    }
  }
  const Eigen::MatrixXd edges = observed.edge_root * observed.edge_root.transpose();
  const double line = 0.004 * 0.004 + 0.003 * 0.003, smooth = std::pow(0.6 * 0.008, 2);
  const double apart = Matern(observed.edges[0].p, observed.edges[1].p, 0.15);
  EXPECT_NEAR(edges(0, 0), 2.25 * (smooth + line + 0.1 * 0.008 * 0.008), 1e-12);
  EXPECT_NEAR(edges(0, 1), 2.25 * (smooth * apart + line), 1e-12);
  EXPECT_NEAR(edges(0, 2), 0, 1e-15);
}

TEST(SetCovariance, SaysWhereThereIsNone) {
  const Structure structure = PaperStructure();
  const BuildModel model(structure);
  FrameObservations observed = Observe(structure, RingPose(20), 40);
  observed.faces[1].variance = -1;
  SetCovariance(model, RingPose(20), &observed);
  EXPECT_FALSE(observed.face_root.allFinite());
}

}  // namespace
}  // namespace volalign::refine_internal::noise_test
