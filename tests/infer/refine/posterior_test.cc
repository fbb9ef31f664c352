#include "infer/refine/posterior.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/QR>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/sensor_kind.h"
#include "infer/refine/disagreement.h"
#include "infer/refine/prior_scales.h"
#include "infer/refine/residuals.h"
#include "infer/refine/terms.h"
#include "tests/infer/refine/points_and_observations.h"

namespace volalign::refine_internal::posterior_test {
namespace {

/// Of all parameters: 1.
Eigen::VectorXd PriorSigmas(const ParameterLayout& layout) {
  Priors priors;
  priors.gain = priors.offset = priors.size = priors.box = priors.yaw = priors.bulge =
      priors.edge_shift = 1;
  return layout.PriorSigmas(priors, std::vector<DepthErrorModel>(layout.sensors(), ErrorsOf("")));
}

/// Random measurements of everything.
NormalEquations RandomNormal(const ParameterLayout& layout) {
  RandomStream random(5, 0, "normal equations");
  const Eigen::Index n = layout.size();
  Eigen::MatrixXd j(3 * n, n);
  for (double& x : j.reshaped()) x = random.Normal();
  NormalEquations normal;
  normal.information = j.transpose() * j;
  normal.gradient.resize(n);
  for (double& x : normal.gradient) x = random.Normal(0, 20);
  return normal;
}

TEST(Posterior, IsTheInverseWidenedByWhatWasLeftOut) {
  const ParameterLayout layout = LayoutOf(2, 2);
  const NormalEquations normal = RandomNormal(layout);
  const Eigen::MatrixXd inverse = normal.information.fullPivLu().inverse();
  std::vector<char> constant(static_cast<std::size_t>(layout.size()), 0);
  const Posterior asked = ComputePosterior(normal, constant, PriorSigmas(layout));
  constant[static_cast<std::size_t>(layout.Size())] = 1;
  const Posterior not_asked = ComputePosterior(normal, constant, PriorSigmas(layout));
  const Eigen::VectorXd step = inverse * normal.gradient;
  EXPECT_TRUE(asked.covariance.isApprox(inverse, 1e-9));
  EXPECT_TRUE(not_asked.covariance.isApprox(inverse + step * step.transpose(), 1e-9));
}

TEST(Posterior, IsThePriorsWhereTheNormalEquationsTellNothing) {
  const ParameterLayout layout = LayoutOf(2, 1);
  const Eigen::VectorXd sigmas = PriorSigmas(layout);
  const std::vector<char> constant(static_cast<std::size_t>(layout.size()), 0);
  NormalEquations normal;
  normal.information = 100 * Eigen::MatrixXd::Identity(layout.size(), layout.size());
  normal.gradient = Eigen::VectorXd::Zero(layout.size());
  EXPECT_TRUE(ComputePosterior(normal, constant, sigmas).exact);
  // Neither measured nor even held by its prior; and not a number.
  for (const double nothing : {0.0, std::nan("")}) {
    NormalEquations singular = normal;
    singular.information(layout.Offset(0), layout.Offset(0)) = nothing;
    singular.information(layout.Pose(1) + 2, layout.Pose(1) + 2) = nothing;
    const Posterior posterior = ComputePosterior(singular, constant, sigmas);
    EXPECT_FALSE(posterior.exact);
    ASSERT_TRUE(posterior.covariance.allFinite());
    EXPECT_NEAR(posterior.Sigma(layout.Offset(0)), 1, 1e-9);
    EXPECT_NEAR(posterior.Sigma(layout.Pose(1) + 2), 1, 1e-9);
    EXPECT_NEAR(posterior.Sigma(layout.Pose(0)), 0.1, 1e-9) << "what is known stays known";
    EXPECT_TRUE(ConditionalPosterior(singular, constant, sigmas).covariance.allFinite());
  }
}

TEST(ConditionalPosterior, KnowsWhatIsConstant) {
  const ParameterLayout layout = LayoutOf(1, 1);
  const NormalEquations normal = RandomNormal(layout);
  std::vector<char> constant(static_cast<std::size_t>(layout.size()), 0);
  constant[2] = constant[9] = 1;
  const Posterior posterior = ConditionalPosterior(normal, constant, PriorSigmas(layout));
  // The inverse of what is left when the rows and columns of the constant ones are struck out.
  std::vector<Eigen::Index> rest;
  for (Eigen::Index k = 0; k < layout.size(); ++k) {
    if (!constant[static_cast<std::size_t>(k)]) rest.push_back(k);
  }
  const Eigen::MatrixXd struck = normal.information(rest, rest);
  const Eigen::MatrixXd inverse = struck.fullPivLu().inverse();
  for (Eigen::Index r = 0; r < inverse.rows(); ++r)
    EXPECT_NEAR(posterior.Sigma(rest[static_cast<std::size_t>(r)]), std::sqrt(inverse(r, r)),
                1e-12);
}

TEST(GaugeProjection, TakesOutWhatAllBoxesDoTogether) {
  const Structure structure = testing_infer::PaperStructure();
  Priors priors;
  priors.box = 0.004;
  priors.yaw = 0.009;
  const Eigen::MatrixXd projection = GaugeProjection(structure, priors);
  const auto boxes = static_cast<Eigen::Index>(structure.boxes().size());
  // A small turn of the whole stack about the structure's vertical, and a shift of it.
  Eigen::VectorXd together(3 * boxes);
  constexpr double kTurn = 1e-3;
  for (Eigen::Index b = 0; b < boxes; ++b) {
    const Eigen::Vector3d centre =
        structure.boxes()[static_cast<std::size_t>(b)].structure_from_box.translation();
    const Eigen::Vector3d moved = Eigen::AngleAxisd(kTurn, Eigen::Vector3d::UnitY()) * centre +
                                  Eigen::Vector3d(0.01, 0, -0.02);
    together.segment<3>(3 * b) << moved.x() - centre.x(), moved.z() - centre.z(), kTurn;
  }
  EXPECT_LT((projection * together).cwiseAbs().maxCoeff(), 1e-6) << "nothing is left of it";
  EXPECT_TRUE((projection * projection).isApprox(projection, 1e-9));
  // What is left has the least prior cost of all that differ by the gauge alone.
  Eigen::VectorXd apart = Eigen::VectorXd::Zero(3 * boxes);
  apart[0] = 0.01;
  const Eigen::Vector3d sigmas(priors.box, priors.box, priors.yaw);
  const auto cost = [&](const Eigen::VectorXd& x) {
    return x.cwiseQuotient(sigmas.replicate(boxes, 1)).squaredNorm();
  };
  const Eigen::VectorXd left = projection * apart;
  for (const double step : {-0.1, 0.1}) EXPECT_GT(cost(left + step * together), cost(left));
}

/// Measurements y = A x + e, e of standard deviation 1, of parameters x whose priors are normal.
struct Linear {
  Eigen::MatrixXd a;
  Eigen::VectorXd y, sigmas;

  Linear(Eigen::Index measurements, Eigen::VectorXd prior_sigmas, std::uint64_t seed)
      : a(measurements, prior_sigmas.size()), y(measurements), sigmas(std::move(prior_sigmas)) {
    RandomStream random(seed, 0, "linear");
    for (Eigen::Index k = 0; k < a.size(); ++k) a.data()[k] = random.Normal();
    for (double& of : y) of = random.Normal();
  }

  /// Of the squares of residuals and priors, at `values`.
  QuadraticCost CostAt(const Eigen::VectorXd& values) const {
    const Eigen::VectorXd precisions = sigmas.cwiseAbs2().cwiseInverse();
    QuadraticCost cost;
    cost.normal.information = a.transpose() * a;
    cost.normal.information.diagonal() += precisions;
    cost.normal.gradient = a.transpose() * (a * values - y) + precisions.cwiseProduct(values);
    cost.prior_sigmas = sigmas;
    cost.values = values;
    return cost;
  }

  /// Density of y with x integrated out: normal, with covariance A P A^T + 1.
  double LogDensity(const Eigen::VectorXd& scales) const {
    const Eigen::VectorXd variances = sigmas.cwiseProduct(scales).cwiseAbs2();
    const Eigen::MatrixXd covariance =
        a * variances.asDiagonal() * a.transpose() + Eigen::MatrixXd::Identity(a.rows(), a.rows());
    return -0.5 * y.dot(covariance.inverse() * y) - 0.5 * std::log(covariance.determinant());
  }
};

TEST(FitModel, EvidenceIsTheDensityOfTheMeasurements) {
  const Linear linear(6, Eigen::Vector4d(2, 0.5, 3, 1), 1);
  const QuadraticCost cost = linear.CostAt(Eigen::Vector4d(0.3, -0.2, 1.5, 0.7));
  const auto difference = [&](const Eigen::Vector4d& scales) {
    return FitModel(cost, scales, false).value().log_evidence -
           FitModel(cost, Eigen::Vector4d::Ones(), false).value().log_evidence;
  };
  for (const Eigen::Vector4d& scales :
       {Eigen::Vector4d(0.3, 1, 1, 1), Eigen::Vector4d(1, 0, 0.1, 1), Eigen::Vector4d(0, 0, 0, 0.5),
        Eigen::Vector4d(0, 0, 0, 0)}) {
    EXPECT_NEAR(difference(scales),
                linear.LogDensity(scales) - linear.LogDensity(Eigen::Vector4d::Ones()), 1e-9)
        << scales.transpose();
  }
}

TEST(FitModel, StepAndCovarianceAreThoseOfTheNarrowerPriors) {
  const Linear linear(6, Eigen::Vector3d(2, 0.5, 3), 2);
  const Eigen::Vector3d values(0.3, -0.2, 1.5);
  const ModelFit fit = FitModel(linear.CostAt(values), Eigen::Vector3d(0.3, 0, 1), true).value();
  Eigen::MatrixXd open(6, 2);
  open << linear.a.col(0), linear.a.col(2);
  const Eigen::Matrix2d covariance =
      (open.transpose() * open + Eigen::Matrix2d(Eigen::Vector2d(1 / 0.36, 1 / 9.0).asDiagonal()))
          .inverse();
  const Eigen::Vector2d best = covariance * open.transpose() * linear.y;
  EXPECT_TRUE((values + fit.step).isApprox(Eigen::Vector3d(best[0], 0, best[1]), 1e-9));
  EXPECT_NEAR(fit.covariance(0, 0), covariance(0, 0), 1e-12);
  EXPECT_NEAR(fit.covariance(0, 2), covariance(0, 1), 1e-12);
  EXPECT_EQ(fit.covariance.col(1).norm(), 0);
}

/// Two sensors and the paper's boxes, of which each parameter beside the poses is measured to a
/// tenth of its prior's standard deviation.
struct Measured {
  ParameterLayout layout = LayoutOf(2, 4);
  FreeSet free;
  QuadraticCost cost;

  Measured() {
    const Priors priors = testing_infer::SomePriors();
    free = AskedFor(ParseEstimate("auto"), priors, 2);
    cost.prior_sigmas = layout.PriorSigmas(priors, {ErrorsOf(""), ErrorsOf("")});
    cost.normal.information = 101 * cost.prior_sigmas.cwiseAbs2().cwiseInverse().asDiagonal();
    cost.normal.gradient = Eigen::VectorXd::Zero(layout.size());
    cost.values = Eigen::VectorXd::Zero(layout.size());
  }
};

TEST(EstimatePriorScales, AreTheLeastWhereNothingStrays) {
  const Measured measured;
  const PriorScales scales =
      EstimatePriorScales(measured.cost, measured.layout, measured.free).value();
  for (const double scale : scales) EXPECT_LT(scale, 0.06);
}

TEST(EstimatePriorScales, FollowWhatStrays) {
  Measured measured;
  const auto stray = [&](Eigen::Index column, double sigmas) {
    measured.cost.values[column] = sigmas * measured.cost.prior_sigmas[column];
  };
  stray(measured.layout.Offset(0), 1.4);
  stray(measured.layout.Offset(1), -0.9);
  stray(measured.layout.ErrorsOfSensor(0) + kDiffuseMultipath, -0.6);
  const Eigen::Index known = measured.layout.ErrorsOfSensor(1) + kDiffuseMultipath;
  measured.cost.prior_sigmas[known] = Positive(0);
  measured.cost.normal.information(known, known) = 1 / Square(Positive(0));
  for (int box = 0; box < 4; ++box) {
    stray(measured.layout.Boxes() + BuildModel::X(box), 0.3);
    stray(measured.layout.Boxes() + BuildModel::Z(box), -0.35);
  }
  const PriorScales scales =
      EstimatePriorScales(measured.cost, measured.layout, measured.free).value();
  EXPECT_EQ(scales[kOffsets], 1) << "no wider than the prior";
  // Of one sensor alone: the other one has no multipath, so that its prior says nothing.
  EXPECT_NEAR(scales[kDiffuseMultipaths], std::sqrt(0.6 * 0.6 * 1.0201 - 0.01), 0.01);
  // The mean square of the values, less the measurements' own variance of a hundredth.
  EXPECT_NEAR(scales[kPlaces], std::sqrt((0.3 * 0.3 + 0.35 * 0.35) / 2 * 1.0201 - 0.01), 0.01);
  EXPECT_LT(scales[kTurns], 0.06) << "boxes out of their places are not turned";
  EXPECT_LT(scales[kSizes], 0.06);
  EXPECT_LT(scales[kGains], 0.06);
  measured.free.offset = false;
  const PriorScales without =
      EstimatePriorScales(measured.cost, measured.layout, measured.free).value();
  EXPECT_NEAR(without[kPlaces], scales[kPlaces], 1e-6) << "whatever is held";
}

TEST(WidenedScales, CountOneMoreParameterThatStrays) {
  const Measured measured;
  PriorScales scales;
  scales << 0.5, 0, 0.2, 1, 0, 0.5;
  Eigen::VectorXd sigmas = measured.cost.prior_sigmas;
  sigmas[measured.layout.ErrorsOfSensor(1) + kDiffuseMultipath] = Positive(0);
  const PriorScales widened = WidenedScales(sigmas, measured.layout, measured.free, scales);
  EXPECT_NEAR(widened[kPlaces], std::sqrt((8 * 0.25 + 1) / 9), 1e-12) << "x and z of four boxes";
  EXPECT_NEAR(widened[kTurns], std::sqrt(1 / 5.0), 1e-12);
  EXPECT_NEAR(widened[kSizes], std::sqrt((0.04 + 1) / 2), 1e-12);
  EXPECT_EQ(widened[kGains], 1);
  EXPECT_NEAR(widened[kOffsets], std::sqrt(1 / 3.0), 1e-12) << "of two sensors";
  EXPECT_NEAR(widened[kDiffuseMultipaths], std::sqrt((0.25 + 1) / 2), 1e-12) << "one is known";
}

TEST(EstimatePriorScales, SaysWhereThereAreNone) {
  // Along a pose, the cost has no minimum.
  Measured measured;
  const Eigen::Index pose = measured.layout.Pose(1);
  measured.cost.normal.information(pose, pose) = -1;
  EXPECT_FALSE(EstimatePriorScales(measured.cost, measured.layout, measured.free));
}

using namespace testing_infer;

constexpr double kSigma = 0.002;  // m, of each observation
constexpr int kBox = 2;           // the one that stands elsewhere

constexpr char kWithoutLens[] = "boxes,size,depth_gain,depth_offset";

TEST(Innovation, IsUnlikelyByChance) {
  // Of an F distribution with 13 and 15 degrees of freedom, 0.135 % lie above 5.40.
  EXPECT_TRUE((Innovation{1.03 * 5.40 * 13 / 2, 13}.IsUnlikely()));
  EXPECT_FALSE((Innovation{0.98 * 5.40 * 13 / 2, 13}.IsUnlikely())) << "by chance";
  EXPECT_FALSE((Innovation{1.03 * 5.40 * 13 / 2, 61}.IsUnlikely()))
      << "of so many numbers, as much is to be expected";
  EXPECT_FALSE((Innovation{450, 0}.IsUnlikely())) << "nothing is predicted";
}

/// Sensors that see the stack as it is described, and before them one that saw a box elsewhere.
struct OddOne {
  Structure structure = PaperStructure();
  SensorPoints points;
  std::vector<Pose> poses;
  std::vector<FrameInput> frames;
  RefineOptions options;
  std::unique_ptr<JointProblem> problem;
  Solution solution;
  FreeSet asked_for;

  /// `elsewhere`: m, the box's way along x, as the first sensor saw it.
  explicit OddOne(double elsewhere, const RefineOptions& with = {},
                  const std::vector<double>& azimuths_deg = {35, 70, 180})
      : options(with) {
    options.bulge_sigma_m = 0;
    for (const double azimuth : azimuths_deg) {
      poses.push_back(RingPose(azimuth));
      frames.push_back({Borrowed(points), poses.back()});
    }
    problem = std::make_unique<JointProblem>(structure, frames, options);
    asked_for = AskedFor(ParseEstimate(kWithoutLens), problem->priors, poses.size());
    solution.state = NominalState(structure, poses);
    solution.fixed.assign(poses.size(), 0);
    solution.free = asked_for;
    for (std::size_t i = 0; i < poses.size(); ++i)
      solution.observed.push_back(Saw(i, i == 0 ? elsewhere : 0));
  }
  FrameObservations Saw(std::size_t i, double elsewhere) const {
    std::vector<double> boxes = solution.state.boxes[0];
    boxes[static_cast<std::size_t>(BuildModel::X(kBox))] = elsewhere;
    FrameObservations observed =
        Observe(problem->model.Built({&solution.state.size, boxes.data()}), poses[i], 12);
    const auto n = static_cast<Eigen::Index>(observed.faces.size());
    observed.face_root = kSigma * Eigen::MatrixXd::Identity(n, n);
    observed.edge_root = Eigen::MatrixXd(0, 0);
    return observed;
  }
  Agreed Exclude() { return ExcludeDisagreeing(*problem, asked_for, std::move(solution)); }
  /// Of each sensor, whether it is.
  std::vector<bool> Excluded() {
    std::vector<bool> excluded;
    for (const auto& of : Exclude().of) excluded.push_back(of.has_value());
    return excluded;
  }
  /// Of the first sensor, as `by` predict it.
  Disagreement InnovationBy(const std::vector<std::size_t>& by) const {
    return InnovationFrom(PredictedBy(by));
  }
  NormalEquations PredictedBy(const std::vector<std::size_t>& by) const {
    const QuadraticCost all = CostAround(*problem, solution);
    const Eigen::VectorXd precisions = all.prior_sigmas.cwiseAbs2().cwiseInverse();
    NormalEquations predicted{precisions.asDiagonal(), precisions.cwiseProduct(all.values)};
    for (const std::size_t i : by) {
      const OwnMeasurements own = MeasurementsOf(*problem, solution, i);
      predicted.information(own.columns, own.columns) += own.normal.information;
      predicted.gradient(own.columns) += own.normal.gradient;
    }
    return predicted;
  }
  Disagreement InnovationFrom(const NormalEquations& predicted) const {
    return DisagreementOf(MeasurementsOf(*problem, solution, 0), predicted,
                          CostAround(*problem, solution), problem->layout.Constant(asked_for));
  }

  /// Half the least sum of squares, in standard deviations, of what some sensors measured and of
  /// the priors, by derivatives taken numerically.
  double LeastCost(const std::vector<std::size_t>& sensors) const {
    const ParameterLayout& layout = problem->layout;
    const Eigen::VectorXd sigmas = PriorSigmas(*problem, solution.observed);
    const auto errors = [&](const Eigen::VectorXd& step) {
      State state = solution.state;
      for (const ParameterLayout::Block& block : layout.Blocks(&state)) {
        if (block.size != block.tangent_size) continue;
        for (int k = 0; k < block.size; ++k) block.values[k] += step[block.column + k];
      }
      Eigen::VectorXd all = layout.Values(state).cwiseQuotient(sigmas);
      for (const std::size_t i : sensors) {
        const Vector6d turn = step.segment<6>(layout.Pose(i));
        state.poses[i] = PoseBlock(PerturbLeft(turn, poses[i]));
        Eigen::VectorXd r;
        Residuals(problem->model, solution.observed[i], state.Parameters(i), &r, nullptr);
        all.conservativeResize(all.size() + r.size());
        all.tail(r.size()) = r / kSigma;
      }
      return all;
    };
    constexpr double kStep = 1e-5;
    const Eigen::VectorXd at = errors(Eigen::VectorXd::Zero(layout.size()));
    Eigen::MatrixXd jacobian = Eigen::MatrixXd::Zero(at.size(), layout.size());
    for (Eigen::Index k = 0; k < layout.size(); ++k) {
      if (k >= layout.Lens(0) && k < layout.Size()) continue;
      const Eigen::VectorXd step = kStep * Eigen::VectorXd::Unit(layout.size(), k);
      jacobian.col(k) = (errors(step) - errors(-step)) / (2 * kStep);
    }
    const Eigen::VectorXd best = -jacobian.completeOrthogonalDecomposition().solve(at);
    return 0.5 * (at + jacobian * best).squaredNorm();
  }
};

// The least sum of squares of all, less that of those that predict, is that of the sensor's numbers
// from their prediction, and what of its own residuals no parameter explains.
TEST(Disagreement, IsWhatTheSensorAddsToTheOthersLeastSquares) {
  const OddOne scene(0.012);
  for (const std::vector<std::size_t>& by : std::vector<std::vector<std::size_t>>{{1}, {1, 2}}) {
    std::vector<std::size_t> all = by;
    all.push_back(0);
    const double expected = scene.LeastCost(all) - scene.LeastCost(by);
    ASSERT_GT(expected, 10);
    const Disagreement disagreement = scene.InnovationBy(by);
    EXPECT_NEAR(disagreement.cost, expected, 0.05 * expected) << by.size();
    EXPECT_GT(disagreement.predicted, 3u);
    EXPECT_TRUE(disagreement.Disagrees());
  }
  EXPECT_LT(OddOne(0).InnovationBy({1, 2}).cost, 0.1);
}

TEST(Disagreement, OfABoxThatIsHeldIsNone) {
  OddOne scene(0.012);
  const double free = scene.InnovationBy({1, 2}).cost;
  scene.asked_for.boxes = scene.asked_for.size = false;
  const Disagreement fixed = scene.InnovationBy({1, 2});
  EXPECT_LT(fixed.cost, 0.5 * free) << "the pose is open, and nothing else is predicted";
}

TEST(Disagreement, ShowsAMovementInThePartOfThePose) {
  const OddOne scene(0);
  NormalEquations predicted = scene.PredictedBy({1, 2});
  EXPECT_EQ(scene.InnovationFrom(predicted).of_pose.predicted, 0u);
  constexpr double kPredicted = 0.001;  // m and rad
  for (const bool moved : {false, true}) {
    NormalEquations of_all = predicted;
    of_all.information.topLeftCorner<6, 6>() += Matrix6d::Identity() / (kPredicted * kPredicted);
    if (moved) of_all.gradient[0] -= 0.027 / (kPredicted * kPredicted);
    const Disagreement disagreement = scene.InnovationFrom(of_all);
    EXPECT_EQ(disagreement.of_pose.predicted, 6u);
    EXPECT_EQ(disagreement.of_pose.IsUnlikely(), moved) << disagreement.of_pose.cost;
    EXPECT_FALSE(disagreement.IsUnlikely()) << "of all numbers: " << disagreement.cost;
    EXPECT_EQ(disagreement.Disagrees(), moved);
  }
}

TEST(ExcludeDisagreeing, NamesThoseThatShowIt) {
  OddOne scene(0.04);
  scene.solution.observed[0].noise.depth.smooth_m = 0.004;
  const Agreed agreed = scene.Exclude();
  ASSERT_TRUE(agreed.of[0].has_value());
  EXPECT_EQ(agreed.solution.observed[0].noise.depth.smooth_m, 0.004)
      << "what is known of its noise stands";
  EXPECT_FALSE(agreed.of[1] || agreed.of[2]);
  ASSERT_FALSE(agreed.of[0]->contradicts.empty());
  EXPECT_EQ(agreed.of[0]->contradicts.front(), 1) << "the other side of the stack tells less";
  EXPECT_TRUE(agreed.measured[0].Disagrees());
  EXPECT_LT(agreed.measured[1].cost, 1) << "in the solution without the odd one";
}

TEST(ExcludeDisagreeing, NoneWhereAllAreFartherOffThanTheirNoiseModel) {
  OddOne scene(0, {}, {35, 70, 180, 250, 310});
  RandomStream random(3, 0, "noise");
  for (FrameObservations& observed : scene.solution.observed) {
    for (FaceObservation& face : observed.faces)
      face.p *= 1 + random.Normal(0, 2.2 * kSigma) / face.p.norm();
  }
  EXPECT_EQ(scene.Excluded(), std::vector<bool>(5, false));
}

// An unusual frame does not disagree. If its sensor has another frame, which places the sensor
// better, it is left out in silence.
TEST(ExcludeDisagreeing, AFrameFartherOffThanItsNoiseModelOnlyIfItsSensorHasAnother) {
  for (const bool has_another : {false, true}) {
    OddOne scene(0, {}, {35, 70, 180, 250, 310});
    for (std::size_t i = 0; i < 5; ++i) scene.frames[i].sensor = static_cast<int>(i);
    if (has_another) {
      scene.frames[4].sensor = 1;
      scene.frames[4].capture = 1;
    }
    scene.problem = std::make_unique<JointProblem>(scene.structure, scene.frames, scene.options,
                                                   std::vector<SensorLens>(1), 2);
    const Pose elsewhere = scene.poses[1] * scene.poses[4].inverse();
    scene.solution.state = NominalState(scene.structure, scene.poses, scene.problem->lenses,
                                        scene.problem->frame_of, {Pose::Identity(), elsewhere});
    RandomStream random(3, 0, "noise");
    for (std::size_t i = 0; i < 5; ++i) {
      for (FaceObservation& face : scene.solution.observed[i].faces)
        face.p *= 1 + random.Normal(0, (i == 1 ? 3 : 1) * kSigma) / face.p.norm();
    }
    const Agreed agreed = scene.Exclude();
    const Innovation& of_all = agreed.measured[1];
    EXPECT_TRUE(of_all.IsUnlikely(std::numeric_limits<double>::infinity()))
        << of_all.cost << ", " << of_all.predicted;
    EXPECT_FALSE(agreed.measured[1].Disagrees()) << of_all.cost << ", " << of_all.predicted;
    EXPECT_EQ(agreed.of[1].has_value(), has_another);
    if (agreed.of[1]) {
      EXPECT_FALSE(agreed.of[1]->disagrees);
    }
  }
}

TEST(ExcludeDisagreeing, AsksWhetherItWasOneStackAlsoWhereBoxesAreHeld) {
  for (const char* estimate : {"none", "boxes,depth_offset", "size"}) {
    OddOne scene(0.04);
    const EstimateSet asked = ParseEstimate(estimate);
    scene.asked_for = scene.solution.free = AskedFor(asked, scene.problem->priors, 3);
    const Agreed agreed = scene.Exclude();
    EXPECT_TRUE(agreed.of[0].has_value()) << estimate;
    EXPECT_FALSE(agreed.of[1] || agreed.of[2]) << estimate;
    // What is not to be estimated is where the structure has it.
    if (!asked.size) {
      EXPECT_EQ(agreed.solution.state.size, 0) << estimate;
    }
    if (asked.boxes) continue;
    EXPECT_EQ(agreed.solution.state.boxes[0], std::vector<double>(12, 0)) << estimate;
  }
}

TEST(ExcludeDisagreeing, AsksAboutTheBoxesUnlessTheyAreKnownExactly) {
  RefineOptions exact, known_size;
  known_size.size_sigma_percent = exact.size_sigma_percent = exact.box_sigma_m = 0;
  EXPECT_EQ(OddOne(0.04, exact).Excluded(), std::vector<bool>(3, false));
  EXPECT_EQ(OddOne(0.04, known_size).Excluded(), (std::vector<bool>{true, false, false}));
}

TEST(ExcludeDisagreeing, OfTwoSensorsNeitherIsWrongHoweverManyFramesTheyHave) {
  OddOne scene(0.04);
  for (std::size_t i = 0; i < 3; ++i) scene.frames[i].sensor = i == 0 ? 0 : 1;
  scene.frames[2].capture = 1;
  scene.problem = std::make_unique<JointProblem>(scene.structure, scene.frames, scene.options,
                                                 std::vector<SensorLens>(1), 2);
  scene.solution.state =
      NominalState(scene.structure, scene.poses, scene.problem->lenses, scene.problem->frame_of,
                   std::vector<Pose>(2, Pose::Identity()));
  EXPECT_EQ(scene.Excluded(), std::vector<bool>(3, false));
}

TEST(ExcludeDisagreeing, OneThatCannotBeSolvedAloneDoesNotHideAnother) {
  OddOne scene(0.08, {}, {35, 70, 180, 250, 310});
  scene.solution.observed[1] = scene.Saw(1, -0.04);
  // Points through a lens that is no number.
  SensorPoints spoilt;
  spoilt.lens.fill(std::nan(""));
  const Side& side = scene.structure.SideOfLabel(1);
  for (const double along : {-0.01, 0.0, 0.01}) {
    SidePoint point;
    point.p = scene.poses[0].inverse() * Eigen::Vector3d(side.centre + along * side.axis_u);
    point.label = 1;
    spoilt.side_points.push_back(point);
  }
  scene.frames[0].points = Borrowed(spoilt);
  const std::vector<bool> excluded = scene.Excluded();
  EXPECT_FALSE(excluded[0]);
  EXPECT_TRUE(excluded[1]);
}

TEST(Disagreement, IsNoneWhereNumbersFail) {
  OddOne scene(0.012);
  FrameObservations& observed = scene.solution.observed[0];
  const auto n = static_cast<Eigen::Index>(observed.faces.size());
  for (const double sigma : {std::nan(""), 1e-160}) {
    observed.face_root = sigma * Eigen::MatrixXd::Identity(n, n);
    EXPECT_EQ(scene.InnovationBy({1, 2}).cost, 0) << sigma;
  }
}

}  // namespace
}  // namespace volalign::refine_internal::posterior_test
