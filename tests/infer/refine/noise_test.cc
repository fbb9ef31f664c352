#include "infer/refine/noise.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>

#include "tests/infer/refine/points_and_evidence.h"

namespace volalign::refine_internal {
namespace {

using testing_infer::Observe;
using testing_infer::PaperStructure;
using testing_infer::ParameterPoint;
using testing_infer::RingPose;

TEST(FitNoise, FindsTheSizeOfWarps) {
  // Fields drawn from a Gaussian process of known size (Cholesky), pose and constants unknown.
  const Structure structure = PaperStructure();
  const BuildModel model(structure);
  const Pose pose = RingPose(35);
  SensorEvidence evidence = Observe(structure, pose, 14);
  for (FaceObservation& face : evidence.faces) face.multipath = 0;
  const auto n = static_cast<Eigen::Index>(evidence.faces.size());
  ASSERT_GT(n, 60);
  Priors priors;
  priors.offset = 0.007;
  priors.gain = 0.003;
  priors.edge_shift = 0.7;
  const SensorEvidence clean = evidence;
  for (const double sigma : {0.002, 0.008}) {
    evidence.noise = NoiseModel();
    evidence.noise.warp = sigma;
    evidence.noise.warp_length = 0.1;
    evidence.faces = clean.faces;
    SetCovariance(model, pose, &evidence);
    const Eigen::MatrixXd root = evidence.face_root;
    double logarithm = 0;
    constexpr int kDraws = 12;
    for (int draw = 0; draw < kDraws; ++draw) {
      RandomStream random(3, static_cast<std::uint64_t>(draw), "warp");
      Eigen::VectorXd white(n);
      for (Eigen::Index i = 0; i < n; ++i) white[i] = random.Normal();
      const Eigen::VectorXd distance = root * white;
      SensorEvidence seen = clean;
      for (Eigen::Index i = 0; i < n; ++i) {
        FaceObservation& face = seen.faces[static_cast<std::size_t>(i)];
        const Eigen::Vector3d ray = face.p / face.p.z();
        const double along = structure.SideOfLabel(face.label).normal.dot(pose.linear() * ray);
        face.p += ray * (distance[i] / along);
      }
      const ParameterPoint at(model, pose);
      FitNoise(model, at.Parameters(), priors, &seen);
      logarithm += std::log(seen.noise.warp / sigma) / kDraws;
      // The factor is that of the fitted covariance.
      EXPECT_EQ(seen.face_root.rows(), n);
    }
    EXPECT_LT(std::abs(logarithm), std::log(1.6)) << sigma << ": off by " << std::exp(logarithm);
  }
}

}  // namespace
}  // namespace volalign::refine_internal
