#include "train/soft_procrustes.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/from_blob.h>
#include <ATen/ops/isfinite.h>
#include <ATen/ops/log_softmax.h>
#include <ATen/ops/ones.h>
#include <ATen/ops/rand.h>
#include <ATen/ops/randn.h>
#include <ATen/ops/tensor.h>
#include <ATen/ops/zeros.h>
#include <gtest/gtest.h>
#include <torch/csrc/autograd/autograd.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/geometry/camera.h"
#include "core/geometry/pose.h"
#include "core/geometry/procrustes.h"

namespace volalign::soft_procrustes_test {
namespace {

const at::TensorOptions kF64 = at::TensorOptions(at::kDouble);

at::Tensor FromEigen(const Eigen::Matrix3d& m) {
  Eigen::Matrix<double, 3, 3, Eigen::RowMajor> rows = m;
  return at::from_blob(rows.data(), {1, 3, 3}, kF64).clone();
}

Eigen::Matrix3d ToEigen(const at::Tensor& m) {
  const at::Tensor plain = m.detach().reshape({3, 3}).to(at::kDouble).contiguous();
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(plain.data_ptr<double>());
}

Eigen::Matrix3d RandomRotation() {
  const at::Tensor w = at::randn({3}, kF64);
  return RotationExp(Eigen::Map<const Eigen::Vector3d>(w.data_ptr<double>()));
}

/// Gradient of f at x by autograd.
at::Tensor Gradient(const std::function<at::Tensor(const at::Tensor&)>& f, const at::Tensor& x) {
  const at::Tensor leaf = x.detach().clone().requires_grad_(true);
  return torch::autograd::grad({f(leaf)}, {leaf})[0];
}

/// Gradient of f at x by central differences.
at::Tensor Differences(const std::function<at::Tensor(const at::Tensor&)>& f, const at::Tensor& x,
                       double step = 1e-6) {
  at::Tensor gradient = at::zeros_like(x);
  for (std::int64_t i = 0; i < x.numel(); ++i) {
    const at::Tensor plus = x.clone(), minus = x.clone();
    plus.view(-1)[i] += step;
    minus.view(-1)[i] -= step;
    gradient.view(-1)[i] = (f(plus).item<double>() - f(minus).item<double>()) / (2 * step);
  }
  return gradient;
}

void ExpectSameGradient(const std::function<at::Tensor(const at::Tensor&)>& f, const at::Tensor& x,
                        const std::string& what, double tolerance = 1e-6) {
  const at::Tensor exact = Gradient(f, x), numeric = Differences(f, x);
  const double scale = std::max(1.0, numeric.abs().max().item<double>());
  EXPECT_TRUE((exact - numeric).abs().max().item<double>() <= tolerance * scale)
      << what << "\nautograd " << exact << "\ndifferences " << numeric;
}

TEST(FitRotation, GradientAgreesWithFiniteDifferences) {
  struct Case {
    const char* name;
    Eigen::Vector3d sigma;  // the last one negative: det M < 0, d = -1
  };
  const std::vector<Case> cases = {
      {"distinct", {3, 2, 1}},           {"all equal", {2, 2, 2}},
      {"first two equal", {2, 2, 1}},    {"last two equal", {3, 1, 1}},
      {"coplanar keypoints", {3, 1, 0}}, {"coplanar, equal", {2, 2, 0}},
      {"reflected", {3, 2, -1}},         {"reflected, first two equal", {2, 2, -0.5}}};
  for (const Case& c : cases) {
    for (int trial = 0; trial < 5; ++trial) {
      const Eigen::Matrix3d m =
          RandomRotation() * c.sigma.asDiagonal() * RandomRotation().transpose();
      const at::Tensor g = at::randn({1, 3, 3}, kF64);
      const auto f = [&g](const at::Tensor& x) { return (FitRotation(x).rotation * g).sum(); };
      ExpectSameGradient(f, FromEigen(m), c.name);
      EXPECT_TRUE(FitRotation(FromEigen(m)).determined.item<bool>()) << c.name;
    }
  }
}

TEST(FitRotation, IsFiniteWhereNothingIsDetermined) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<Eigen::Matrix3d> matrices = {
      Eigen::Matrix3d::Zero(), Eigen::Vector3d(1, 0, 0) * Eigen::RowVector3d(0.3, 0.4, 0.5),
      Eigen::Vector3d(3, 1, -1).asDiagonal().toDenseMatrix(), Eigen::Matrix3d::Constant(nan)};
  for (const Eigen::Matrix3d& m : matrices) {
    const at::Tensor x = FromEigen(m);
    EXPECT_FALSE(FitRotation(x).determined.item<bool>()) << m;
    EXPECT_NEAR(ToEigen(FitRotation(x).rotation).determinant(), 1, 1e-9) << m;
    const at::Tensor g =
        Gradient([](const at::Tensor& y) { return FitRotation(y).rotation.square().sum(); }, x);
    EXPECT_EQ(g.abs().max().item<double>(), 0) << m;
  }
}

TEST(Deproject, IsDepthTimesRay) {
  const at::Tensor depth = at::rand({2, 1, 5, 7}) + 1;
  depth[1][0][2][3] = 0;
  const at::Tensor rays = at::randn({2, 2, 5, 7});
  EXPECT_TRUE(Deproject(depth, rays).equal(at::cat({depth * rays, depth}, 1)));
}

TEST(SoftKeypoints, AreMeansOfPointsWithDepthByProbability) {
  const at::Tensor log_probs = at::log_softmax(at::randn({2, 4, 5, 6}, kF64), 1);
  const at::Tensor points = at::randn({2, 3, 5, 6}, kF64);
  points.select(1, 2).abs_();
  points.select(2, 1).zero_();  // a row without depth
  const at::Tensor p = log_probs.narrow(1, 1, 3).exp() * points.narrow(1, 2, 1).ne(0);
  const at::Tensor expected =
      at::einsum("bkhw,bihw->bki", {p, points}) / p.sum({2, 3}).unsqueeze(2);
  EXPECT_TRUE(SoftKeypoints(log_probs, points).allclose(expected, 1e-12, 1e-12));
  const at::Tensor g = at::randn({2, 3, 3}, kF64);
  ExpectSameGradient([&](const at::Tensor& x) { return (SoftKeypoints(x, points) * g).sum(); },
                     log_probs, "soft keypoints");
}

// Of a dozen, some keypoints are the targets' mirror image rather than they themselves.
TEST(SoftProcrustesLoss, AgreesWithAReferencePerSample) {
  const at::Tensor targets = at::randn({6, 3}, kF64);
  const at::Tensor keypoints = at::randn({12, 6, 3}, kF64);
  at::Tensor visible = at::ones({12, 6}, at::kBool);
  visible[1][2] = false;
  visible[1][4] = false;
  visible[2].narrow(0, 0, 3).fill_(false);  // three sides left: just enough
  double expected = 0;
  for (int b = 0; b < 12; ++b) {
    std::vector<Eigen::Vector3d> c, s;
    for (int k = 0; k < 6; ++k) {
      if (!visible[b][k].item<bool>()) continue;
      c.emplace_back(keypoints[b][k][0].item<double>(), keypoints[b][k][1].item<double>(),
                     keypoints[b][k][2].item<double>());
      s.emplace_back(targets[k][0].item<double>(), targets[k][1].item<double>(),
                     targets[k][2].item<double>());
    }
    expected += AlignPoints(c, s).rms * std::sqrt(static_cast<double>(c.size())) / 12;
  }
  const ProcrustesLoss loss = SoftProcrustesLoss(keypoints, targets, visible);
  EXPECT_NEAR(loss.loss.item<double>(), expected, 1e-12);
  EXPECT_EQ(loss.degenerate_samples.item<std::int64_t>(), 0);
  ExpectSameGradient(
      [&](const at::Tensor& x) { return SoftProcrustesLoss(x, targets, visible).loss; }, keypoints,
      "L_3D");
}

TEST(SoftProcrustesLoss, DegenerateSamplesAddNothingAndAreCounted) {
  const Structure structure = ReadStructure("configs/structure.yaml");
  const at::Tensor centres = StructureKeypoints(structure, KeypointKind::kCentre).to(at::kDouble);
  const auto label = [&](const std::string& name) {
    const std::vector<std::string> names = structure.SideNames();
    return static_cast<std::int64_t>(std::find(names.begin(), names.end(), name) - names.begin());
  };
  // These three centres are exactly collinear.
  at::Tensor visible = at::zeros({5, 20}, at::kBool);
  for (const char* name : {"mid_bottom/front", "mid_top/front", "top/front"}) {
    visible[0][label(name)] = true;
    visible[4][label(name)] = true;
  }
  visible[1][3] = true;  // one side; sample 2 has none
  visible[3].narrow(0, 0, 9).fill_(true);
  visible[4][label("top/right")] = true;  // off the line: fixed
  at::Tensor keypoints = at::randn({5, 20, 3}, kF64);
  keypoints[3] =
      keypoints[3][0].clone().unsqueeze(0).expand({20, 3});  // all keypoints in one place
  const auto f = [&](const at::Tensor& x) { return SoftProcrustesLoss(x, centres, visible).loss; };
  EXPECT_EQ(SoftProcrustesLoss(keypoints, centres, visible).degenerate_samples.item<std::int64_t>(),
            4);
  const at::Tensor gradient = Gradient(f, keypoints);
  EXPECT_TRUE(at::isfinite(gradient).all().item<bool>());
  EXPECT_EQ(gradient.narrow(0, 0, 4).abs().max().item<double>(), 0);
  EXPECT_GT(gradient[4].abs().max().item<double>(), 0);
  EXPECT_TRUE(
      gradient[4].masked_select(visible[4].logical_not().unsqueeze(1)).eq(0).all().item<bool>());
  ExpectSameGradient(f, keypoints, "with degenerate samples");
}

TEST(SoftProcrustesLoss, IsZeroWithFiniteGradientAtThePerfectAnswer) {
  const Structure structure = ReadStructure("configs/structure.yaml");
  for (const auto kind : {KeypointKind::kCentre, KeypointKind::kExposed}) {
    const at::Tensor targets = StructureKeypoints(structure, kind).to(at::kDouble);
    const at::Tensor rotation = FromEigen(RandomRotation())[0];
    const at::Tensor keypoints =
        (targets.matmul(rotation) + at::tensor({0.1, -0.2, 2.0}, kF64)).unsqueeze(0);
    const at::Tensor visible = at::ones({1, 20}, at::kBool);
    const auto f = [&](const at::Tensor& x) {
      return SoftProcrustesLoss(x, targets, visible).loss;
    };
    EXPECT_TRUE(f(keypoints).item<double>() < 1e-9);
    EXPECT_TRUE(at::isfinite(Gradient(f, keypoints)).all().item<bool>());
  }
}

}  // namespace
}  // namespace volalign::soft_procrustes_test
