#include "infer/refine/terms.h"

#include <ceres/cost_function.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/base/random.h"
#include "infer/refine/costs.h"
#include "infer/refine/noise.h"
#include "infer/refine/posterior.h"
#include "infer/refine/residuals.h"
#include "infer/refine/solution.h"
#include "tests/infer/refine/points_and_observations.h"
#include "tests/infer/refine/two_sensors.h"

namespace volalign::refine_internal::terms_test {
namespace {

using namespace testing_infer;

/// The problem at `state`, with the overlap that there is at it.
ceres::Problem Build(const JointProblem& problem, const std::vector<FrameObservations>& observed,
                     const FreeSet& free, State* state, const std::vector<char>& fixed = {0, 0}) {
  return BuildCeresProblem(problem, observed, FindOverlaps(problem, observed, fixed, *state), fixed,
                           problem.layout.Constant(free, fixed), state);
}

/// Residual blocks of overlap: those that two poses have in common.
std::vector<ceres::ResidualBlockId> OverlapBlocks(ceres::Problem* ceres, const State& state) {
  std::vector<ceres::ResidualBlockId> blocks, common;
  ceres->GetResidualBlocksForParameterBlock(state.poses[0].values, &blocks);
  for (const ceres::ResidualBlockId& block : blocks) {
    std::vector<double*> parameters;
    ceres->GetParameterBlocksForResidualBlock(block, &parameters);
    for (const double* parameter : parameters) {
      if (parameter == state.poses[1].values) common.push_back(block);
    }
  }
  return common;
}

double OverlapCost(ceres::Problem* ceres, const State& state) {
  double all = 0, cost = 0;
  for (const ceres::ResidualBlockId& block : OverlapBlocks(ceres, state)) {
    EXPECT_TRUE(ceres->EvaluateResidualBlock(block, false, &cost, nullptr, nullptr));
    all += cost;
  }
  return all;
}

int OverlapTerms(ceres::Problem* ceres, const State& state) {
  int terms = 0;
  for (const ceres::ResidualBlockId& block : OverlapBlocks(ceres, state))
    terms += ceres->GetCostFunctionForResidualBlock(block)->num_residuals();
  return terms;
}

TEST(BuildCeresProblem, ErrorsWithinACorrelationLengthAreOneError) {
  constexpr double kApart = 0.0005;  // m
  for (const auto& [along_x, count] : {std::pair(true, 15), {false, 15}, {true, 150}}) {
    TwoSensors two(Strip(along_x, 2, count), Strip(along_x, 2 + kApart, count));
    const JointProblem problem = two.Problem();
    ceres::Problem ceres = Build(problem, TwoFrames(), AskedFor({}, problem.priors, 2), &two.state);
    // Both ways together, all matches count as four.
    double expected = 0;
    for (const CloudPoint& point : two.a.cloud.points()) {
      const double sigma = SigmaOfPair(point.p);
      expected += 2 * kApart * kApart / (sigma * sigma) / (2.0 * count);
    }
    EXPECT_NEAR(OverlapCost(&ceres, two.state), expected, 0.01 * expected) << along_x;
  }
}

TEST(BuildCeresProblem, APairCountsBothWaysOrNot) {
  // a sees nothing but what b sees, too; that is a fourteenth of what b sees.
  std::vector<CloudPoint> wide = Strip(true, 2);
  for (int i = 0; i < 400; ++i) {
    CloudPoint point;
    point.p = {-2 + 0.01 * i, 1.5, 4};
    point.normal = {0, 0, -1};
    wide.push_back(point);
  }
  TwoSensors two(Strip(true, 2), wide);
  const auto terms = [&](double min_overlap) {
    two.options.min_overlap = min_overlap;
    const JointProblem problem = two.Problem();
    ceres::Problem ceres = Build(problem, std::vector<FrameObservations>(2),
                                 AskedFor({}, problem.priors, 2), &two.state);
    return OverlapTerms(&ceres, two.state);
  };
  EXPECT_EQ(terms(0.1), 60) << "60 of 460";
  EXPECT_EQ(terms(0.2), 0);
}

TEST(BuildCeresProblem, OverlapIsOfCorrectedDepths) {
  // Both see one plane at 2 m, each with a depth error that is known.
  TwoSensors two(Strip(true, 2 / 1.003), Strip(true, 2 - 0.004));
  const JointProblem problem = two.Problem();
  two.state.errors[0][kGain] = 0.003;
  two.state.offsets[1] = 0.004;
  const FreeSet free = AskedFor(ParseEstimate("depth_gain,depth_offset"), problem.priors, 2);
  ceres::Problem ceres = Build(problem, TwoFrames(), free, &two.state);
  ASSERT_EQ(OverlapTerms(&ceres, two.state), 60);
  EXPECT_NEAR(OverlapCost(&ceres, two.state), 0, 1e-9);
  two.state.errors[0][kGain] = 0;
  double expected = 0;  // 6 mm at each point, of four cells
  for (const CloudPoint& point : two.a.cloud.points()) {
    const double r = 0.006 / SigmaOfPair(point.p);
    expected += 4 * 2 * std::log1p(r * r / 4) / static_cast<double>(two.a.cloud.points().size());
  }
  EXPECT_NEAR(OverlapCost(&ceres, two.state), expected, 0.02 * expected);
}

TEST(ComputeNormalEquations, CountWhatTheCostCounts) {
  // Four cells of errors tell a depth offset as four measurements do, from however many matches.
  for (const int count : {15, 150}) {
    const TwoSensors two(Strip(true, 2, count), Strip(true, 2, count));
    const JointProblem problem = two.Problem();
    Solution solution{AskedFor({}, problem.priors, 2), two.state, TwoFrames(), {0, 0}};
    solution.overlaps = FindOverlaps(problem, solution.observed, solution.fixed, solution.state);
    double expected = 1 / (problem.priors.offset * problem.priors.offset);
    for (const CloudPoint& point : two.a.cloud.points()) {
      const double sigma = SigmaOfPair(point.p);
      expected += 4 / (sigma * sigma) / static_cast<double>(two.a.cloud.points().size());
    }
    const Eigen::Index column = problem.layout.Offset(0);
    EXPECT_NEAR(ComputeNormalEquations(problem, solution).information(column, column), expected,
                0.01 * expected);
  }
}

// Where the depth of a point has bounced light, what two frames share says something of it.
TEST(ComputeNormalEquations, OverlapTellsMultipath) {
  const TwoSensors two(Strip(true, 2), Strip(true, 2));
  const JointProblem problem = two.Problem();
  Solution solution{AskedFor({}, problem.priors, 2), two.state, {}, {0, 0}};
  solution.observed = TwoFrames();
  solution.overlaps = FindOverlaps(problem, solution.observed, solution.fixed, solution.state);
  const auto told = [&](double share) {
    for (PairMatch& match : solution.overlaps.at(0).of_a) match.multipath_point = share;
    const Eigen::Index column = problem.layout.ErrorsOfSensor(0) + kDiffuseMultipath;
    return ComputeNormalEquations(problem, solution).information(column, column);
  };
  const double nothing = told(0), all = told(1) - nothing;
  EXPECT_GT(all, 0);
  EXPECT_NEAR(told(0.5) - nothing, 0.25 * all, 1e-6 * all);
}

/// A point in front of a sensor.
Eigen::Vector3d RandomPoint(RandomStream& random) {
  return {random.Normal(0, 0.5), random.Normal(0, 0.5), random.Uniform(1, 4)};
}

TEST(RefineCosts, APosePriorCostsNothingAtItsPose) {
  RandomStream random(4, 0, "prior");
  const Pose prior = RandomPose(random);
  const PoseBlock block(prior);
  const double* parameters[] = {block.values};
  Vector6d residual;
  const std::unique_ptr<ceres::CostFunction> cost(PosePriorCost(prior, 0.5, 0.3));
  cost->Evaluate(parameters, residual.data(), nullptr);
  EXPECT_LT(residual.norm(), 1e-12);
}

TEST(RefineCosts, AKnownPoseIsWhereItsWorldHasIt) {
  RandomStream random(5, 0, "known pose");
  const Pose prior = RandomPose(random), placement = RandomPose(random);
  const Pose nowhere = Pose::Identity(), somewhere = RandomPose(random);
  constexpr double kScale = 1.7;
  for (const PriorWorld kind :
       {PriorWorld::kStructure, PriorWorld::kMetric, PriorWorld::kScaleFree}) {
    const bool scaled = kind == PriorWorld::kScaleFree;
    const Pose world = kind == PriorWorld::kStructure ? nowhere : somewhere;
    Pose expected = prior;
    if (scaled) expected.translation() *= kScale;
    Pose first = world * expected;
    const std::unique_ptr<ceres::CostFunction> cost(KnownPoseCost({prior, kind, 0.5, 3}));
    for (const double moved : {0.0, 0.25}) {
      first.translation().y() += moved;
      const PoseBlock of_world(world), of_placement(placement), pose(placement.inverse() * first);
      const double log_scale = std::log(kScale);
      std::vector<const double*> blocks;
      if (kind != PriorWorld::kStructure) blocks.push_back(of_world.values);
      if (scaled) blocks.push_back(&log_scale);
      blocks.insert(blocks.end(), {of_placement.values, pose.values});
      Vector6d residual;
      ASSERT_TRUE(cost->Evaluate(blocks.data(), residual.data(), nullptr));
      residual[1] -= moved / 0.5;
      EXPECT_LT(residual.norm(), 1e-9);
    }
  }
}

TEST(RefineCosts, ARobustResidualIsTheRootOfCauchysLossAndItsDerivative) {
  const auto root = [](double r) { return MakeRobust(r, 0.3); };
  for (const double r : {-30.0, -2.0, -0.1, 0.0, 1e-9, 0.5, 7.0}) {
    EXPECT_NEAR(root(r).value * root(r).value, 0.3 * 4 * std::log1p(r * r / 4), 1e-12);
    EXPECT_EQ(std::signbit(root(r).value), std::signbit(r));
    constexpr double kStep = 1e-5;
    EXPECT_NEAR(root(r).slope, (root(r + kStep).value - root(r - kStep).value) / (2 * kStep), 1e-7);
  }
}

/// Where a point is when its sensor's lens has changed and its depth is off: the pixel's ray, at
/// the true depth.
Eigen::Vector3d TruePoint(const LensPoint& point, double offset, const LensChange& lens) {
  const Eigen::Vector2d ray = point.p.head<2>() / point.p.z() + point.by_lens * (lens - point.lens);
  return (point.p.z() + offset) * ray.homogeneous();
}

TEST(RefineCosts, MeasuredOverlapIsThatOfThePointsWhereTheyReallyAre) {
  RandomStream random(6, 0, "lens_overlap");
  for (int trial = 0; trial < 20; ++trial) {
    const bool shared = trial % 2 == 0;
    const auto point = [&] {
      LensPoint of{RandomPoint(random), RayByLensMatrix::Zero(), RandomVector(random, 0.01),
                   SensorErrorVector::Zero()};
      for (int k = 0; k < kFrameErrors; ++k) of.by_errors[k] = random.Normal();
      of.by_errors[kGain] = of.p.z();
      for (double& entry : of.by_lens.reshaped()) entry = random.Normal();
      return of;
    };
    const LensPoint a = point(), b = point();
    const Eigen::Vector3d normal = RandomVector(random, 1).normalized();
    const std::vector<Pose> poses = {RandomPose(random), RandomPose(random)};
    // Offsets, errors of the sensors, lenses. Last of the errors: gain, own focal length, edges.
    SensorErrorVector of_a, of_b;
    of_a << 0.002, -0.004, 0.002, 0.003, 0.001, 0.006, 0.003, 0.2, 0.1;
    of_b << -0.001, 0.003, -0.004, -0.002, 0.001, -0.002, -0.005, 0.2, 0.1;
    std::vector<std::vector<double>> others = {{0.004}, {-0.003}};
    for (const SensorErrorVector* of : {&of_a, &of_b})
      others.emplace_back(of->data(), of->data() + kSensorErrors);
    const Eigen::Vector3d lens_a = RandomVector(random, 0.01);
    const Eigen::Vector3d lens_b = shared ? lens_a : RandomVector(random, 0.01);
    others.emplace_back(lens_a.data(), lens_a.data() + 3);
    if (!shared) others.emplace_back(lens_b.data(), lens_b.data() + 3);
    const LensPoint other = point();
    const MeasuredOverlapCost cost({{a, b, normal, 1.7}, {other, b, normal, 1.7}}, 0.3, shared);

    const PoseBlock block_a(poses[0]), block_b(poses[1]);
    std::vector<const double*> parameters = {block_a.values, block_b.values};
    for (const std::vector<double>& block : others) parameters.push_back(block.data());
    std::array<double, 2> residuals{};
    ASSERT_TRUE(cost.Evaluate(parameters.data(), residuals.data(), nullptr));
    const Eigen::Vector3d q = poses[1] * TruePoint(b, -0.003 + b.by_errors.dot(of_b),
                                                   lens_b - 0.005 * LensChange::UnitX());
    const auto expected = [&](const LensPoint& of) {
      const Eigen::Vector3d p = poses[0] * TruePoint(of, 0.004 + of.by_errors.dot(of_a),
                                                     lens_a + 0.003 * LensChange::UnitX());
      // The mean of the gains is 1.002.
      return MakeRobust(1.7 * (poses[1].linear() * normal).dot(p - q) / 1.002, 0.3).value;
    };
    EXPECT_NEAR(residuals[0], expected(a), 1e-12);
    EXPECT_NEAR(residuals[1], expected(other), 1e-12);
  }
}

TEST(RefineCosts, LensEvidenceIsItsQuadraticForm) {
  LensEvidence evidence;
  Eigen::Matrix3d root;
  root << 0, 0, 0, 0, 30, 5, 0, 0, 12;  // nothing about the focal length
  evidence.information = root.transpose() * root;
  const LensChange mean(0, -0.3, 0.1);
  evidence.moment = evidence.information * mean;
  const std::unique_ptr<ceres::CostFunction> cost(LensEvidenceCost(evidence));
  for (const LensChange& at :
       {LensChange(0, 0, 0), LensChange(0.02, -0.3, 0.1), LensChange(-0.01, 0.2, 0.3)}) {
    Eigen::Vector3d residuals;
    Eigen::Matrix<double, 3, 3, Eigen::RowMajor> jacobian;
    const double* block = at.data();
    double* jacobians = jacobian.data();
    ASSERT_TRUE(cost->Evaluate(&block, residuals.data(), &jacobians));
    EXPECT_NEAR(residuals.squaredNorm(), (root * (at - mean)).squaredNorm(), 1e-9);
    EXPECT_LT((jacobian.transpose() * residuals - evidence.information * (at - mean)).norm(), 1e-9);
  }
}

/// Faces and edges, seen through another lens than the one assumed.
FrameObservations ObserveAll(const Structure& structure, const Pose& pose) {
  FrameObservations observed = Observe(structure, pose, 40);
  for (FaceObservation& face : observed.faces) {
    face.by_lens = RayByLens(KinectWithLens(), face.p.head<2>() / face.p.z());
    EdgeObservation edge = EdgeOf(face);
    edge.edge = static_cast<int>(observed.edges.size() % 4);
    edge.p += Eigen::Vector3d(0.01, -0.02, 0.03);
    edge.by_lens = face.by_lens;
    observed.edges.push_back(edge);
  }
  observed.lens = LensChange(0.001, -0.002, 0.003);
  return observed;
}

/// What a sensor beside the paper's structure observes.
class FrameTerms : public testing::Test {
 protected:
  const Structure structure_ = PaperStructure();
  const BuildModel model_{structure_};
  const Pose pose_ = RingPose(35);
};

TEST_F(FrameTerms, ResidualsDoNotShrinkWithTheWorld) {
  // Where the stack, its distance and all depths are smaller by one factor, nothing that a sensor
  // measures is different, and so no residual: only priors tell how large the world is.
  const FrameObservations observed = ObserveAll(structure_, pose_);
  ParameterPoint at(model_, pose_);
  RandomStream random(3, 0, "scale");
  for (Eigen::Index i = 7; i < at.x.size(); ++i) at.x[i] = random.Normal(0, 0.01);
  ASSERT_GT(observed.faces.size(), 8u);
  constexpr double kFactor = 0.97;
  ParameterPoint smaller = at;
  smaller.x.segment<3>(4) *= kFactor;
  smaller.x[5] += (1 - kFactor) * model_.floor();  // it shrinks about a point of the floor
  smaller.x[FrameColumns::kOffset] *= kFactor;
  smaller.x.segment<kMultipath + 1>(FrameColumns::kErrors) *= kFactor;
  for (const Eigen::Index gain : {FrameColumns::kErrors + kGain, FrameColumns::kSize})
    smaller.x[gain] = (1 + at.x[gain]) * kFactor - 1;
  smaller.x.tail(model_.size().sides) *= kFactor;
  for (int b = 0; b < static_cast<int>(structure_.boxes().size()); ++b) {
    const Eigen::Vector3d centre =
        structure_.boxes()[static_cast<std::size_t>(b)].structure_from_box.translation();
    double& x = smaller.x[FrameColumns::kBoxes + BuildModel::X(b)];
    double& z = smaller.x[FrameColumns::kBoxes + BuildModel::Z(b)];
    x = (centre.x() + x) * kFactor - centre.x();
    z = (centre.z() + z) * kFactor - centre.z();
  }
  Eigen::VectorXd residuals, of_smaller;
  Residuals(model_, observed, at.Parameters(), &residuals, nullptr);
  Residuals(model_, observed, smaller.Parameters(), &of_smaller, nullptr);
  ASSERT_GT(residuals.norm(), 0.01);
  EXPECT_LT((of_smaller - residuals).norm(), 1e-9 * residuals.norm());
}

TEST_F(FrameTerms, ResidualsVanishOnTheStructureAsBuilt) {
  // Rendered from displaced, turned and enlarged boxes whose sides bulge: zero at these parameters,
  // by ray casting.
  ParameterPoint at(model_, pose_);
  double* boxes = at.x.data() + FrameColumns::kBoxes;
  at.x[FrameColumns::kSize] = 0.012;
  RandomStream random(2, 0, "built");
  for (int b = 0; b < static_cast<int>(structure_.boxes().size()); ++b) {
    boxes[BuildModel::X(b)] = random.Normal(0, 0.004);
    boxes[BuildModel::Z(b)] = random.Normal(0, 0.004);
    boxes[BuildModel::Yaw(b)] = random.Normal(0, 0.01);
  }
  const Structure built = model_.Built(at.Parameters().build);
  EXPECT_NEAR(built.FloorHeight(), structure_.FloorHeight(), 1e-9) << "it stands on the same floor";
  FrameObservations observed = Observe(built, pose_, 16);
  for (FaceObservation& face : observed.faces) {
    face.by_errors[kMultipath] = 0;
    const double bulge = 1e-3 * face.label;
    at.x.tail(model_.size().sides)[BuildModel::Bulge(face.label)] = bulge;
    face.p +=
        bulge * face.bulge * pose_.linear().transpose() * built.SideOfLabel(face.label).normal;
  }
  Eigen::VectorXd residuals;
  Residuals(model_, observed, at.Parameters(), &residuals, nullptr);
  ASSERT_GT(residuals.size(), 40);
  EXPECT_LT(residuals.cwiseAbs().maxCoeff(), 2e-6);
}

TEST_F(FrameTerms, TheCostIsWhitenedByTheCovariance) {
  FrameObservations observed = Observe(structure_, pose_, 50);
  const EdgeObservation edge = EdgeOf(observed.faces.front());
  observed.edges = {edge, edge, edge};  // the first two are of one edge, and correlated
  observed.edges[2].edge = 2;
  SetCovariance(model_, pose_, &observed);
  ParameterPoint at(model_, pose_);
  at.x[7] = 0.005;
  const SensorCost cost(model_, observed);
  const FrameParameters p = at.Parameters();
  const std::array<const double*, 7> blocks = {p.pose,       p.offset,      p.errors,      p.lens,
                                               p.build.size, p.build.boxes, p.build.bulges};
  Eigen::VectorXd whitened(cost.num_residuals()), residuals;
  EXPECT_TRUE(cost.Evaluate(blocks.data(), whitened.data(), nullptr));
  Residuals(model_, observed, p, &residuals, nullptr);
  const auto faces = static_cast<Eigen::Index>(observed.faces.size());
  const Eigen::MatrixXd face = observed.face_root * observed.face_root.transpose(),
                        lines = observed.edge_root * observed.edge_root.transpose();
  const double squares = residuals.head(faces).dot(face.inverse() * residuals.head(faces)) +
                         residuals.tail(3).dot(lines.inverse() * residuals.tail(3));
  EXPECT_NEAR(whitened.squaredNorm(), squares, 1e-6 * squares);
}

/// Correlation of two bearings, rad apart, of a Matern field of smoothness 3/2 (Rasmussen and
/// Williams, "Gaussian Processes for Machine Learning", equation 4.17).
double Matern(const Eigen::Vector3d& a, const Eigen::Vector3d& b, double length) {
  const double d = (a / a.z() - b / b.z()).norm();
  return (1 + std::sqrt(3.0) * d / length) * std::exp(-std::sqrt(3.0) * d / length);
}

TEST_F(FrameTerms, FitNoiseFindsTheSizeOfWarps) {
  // Depths that are off by a Gaussian field over the image, of known size at 2 m and growing with
  // the depth, pose and constants unknown.
  FrameObservations clean = Observe(structure_, pose_, 14);
  for (FaceObservation& face : clean.faces) face.by_errors[kMultipath] = 0;
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
  const Eigen::MatrixXd root = RootOf(correlation);
  for (const double sigma : {0.002, 0.008}) {
    double size = 0, length = 0;
    constexpr int kDraws = 12;
    for (int draw = 0; draw < kDraws; ++draw) {
      RandomStream random(3, static_cast<std::uint64_t>(draw), "warp");
      const Eigen::VectorXd field = root * WhiteNoise(n, random);
      FrameObservations seen = clean;
      for (Eigen::Index i = 0; i < n; ++i) {
        FaceObservation& face = seen.faces[static_cast<std::size_t>(i)];
        face.p *= 1 + sigma / 2 * field[i];
      }
      const ParameterPoint at(model_, pose_);
      FitNoise(model_, ErrorsOf(""), at.Parameters(), priors, &seen);
      size += std::log(seen.noise.depth.smooth_m / sigma) / kDraws;
      length += std::log(seen.noise.depth.smooth_rad / kLength) / kDraws;
      EXPECT_EQ(seen.face_root.rows(), n) << "the factor is that of the fitted covariance";
    }
    EXPECT_LT(std::abs(size), std::log(1.3)) << sigma << ": off by " << std::exp(size);
    // Only three lengths are looked at.
    EXPECT_LT(std::abs(length), std::log(1.6)) << kLength << ": off by " << std::exp(length);
  }
}

TEST_F(FrameTerms, FitNoiseKeepsWhatIsUsualWhereFacesAreTooFew) {
  for (const char* kind : {"realsense_d415", "kinect_v1", "azure_kinect_nfov_binned", ""}) {
    FrameObservations seen = Observe(structure_, pose_, 14);
    seen.faces.resize(12);
    seen.noise = UsualNoise(kind);
    const ParameterPoint at(model_, pose_);
    FitNoise(model_, UsualNoise(kind).depth, at.Parameters(), SomePriors(), &seen);
    EXPECT_EQ(seen.noise.depth.smooth_m, ErrorsOf("").smooth_m) << kind;
    EXPECT_EQ(seen.noise.depth.seam_m, ErrorsOf(kind).seam_m) << kind;
  }
}

TEST_F(FrameTerms, FitNoiseFindsTheScaleOfEdges) {
  FrameObservations clean;  // points of the sides' borders, as they are
  for (const FaceObservation& face : Observe(structure_, pose_, 14).faces) {
    EdgeObservation point = EdgeOf(face);
    point.edge = static_cast<int>(clean.edges.size() % 4);
    const Border border = structure_.SideOfLabel(face.label).BorderAt(point.edge);
    const Eigen::Vector3d at = pose_ * face.p;
    point.p = pose_.inverse() * (at + border.outward * border.outward.dot(border.middle - at));
    clean.edges.push_back(point);
  }
  clean.noise.edge = 1;
  SetCovariance(model_, pose_, &clean);
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
      const Eigen::VectorXd moved = scale * (clean.edge_root * WhiteNoise(n, random));
      FrameObservations seen = clean;
      for (Eigen::Index i = 0; i < n; ++i) {
        EdgeObservation& edge = seen.edges[static_cast<std::size_t>(i)];
        const Border border = structure_.SideOfLabel(edge.label).BorderAt(edge.edge);
        edge.p += pose_.linear().transpose() * border.outward * moved[i];
      }
      const ParameterPoint at(model_, pose_);
      FitNoise(model_, ErrorsOf(""), at.Parameters(), priors, &seen);
      fitted += std::log(seen.noise.edge / scale) / kDraws;
    }
    EXPECT_LT(std::abs(fitted), std::log(1.25)) << scale << ": off by " << std::exp(fitted);
  }
}

TEST_F(FrameTerms, TheCovarianceIsThatOfItsParts) {
  FrameObservations observed = Observe(structure_, pose_, 40);
  const EdgeObservation edge = EdgeOf(observed.faces.front());
  observed.edges = {edge, edge, edge};
  observed.edges[1].p += Eigen::Vector3d(0.02, 0.01, 0);
  observed.edges[2].edge = 2;  // another line: nothing in common
  observed.noise.depth.smooth_m = 0.004;
  observed.noise.depth.smooth_rad = 0.1;
  observed.noise.edge = 1.5;
  observed.noise.line = 0.003;
  observed.faces[3].lateral_sigma_rad = 0.0027;
  SetCovariance(model_, pose_, &observed);
  const Eigen::MatrixXd faces = observed.face_root * observed.face_root.transpose();
  for (std::size_t i = 0; i < observed.faces.size(); ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      // A depth error of 4 mm at 2 m moves a point by its cosine; but at grazing incidence by a
      // fifth.
      const auto moved = [&](const FaceObservation& face) {
        const Eigen::Vector3d ray = pose_.linear() * face.p / face.p.z();
        const double along = structure_.SideOfLabel(face.label).normal.dot(ray);
        return 0.004 * face.p.z() / 2 * std::sqrt(along * along + 0.2 * 0.2);
      };
      const FaceObservation &a = observed.faces[i], &b = observed.faces[j];
      double expected = moved(a) * moved(b) * Matern(a.p, b.p, 0.1);
      if (i == j) {
        const Eigen::Vector3d normal =
            pose_.linear().transpose() * structure_.SideOfLabel(a.label).normal;
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
  // However small the scale: what an edge's points have in common is no less than the rounding.
  observed.noise.edge = 0.25;
  SetCovariance(model_, pose_, &observed);
  const double rounding = 0.008 * 0.008 / 12;
  EXPECT_NEAR((observed.edge_root * observed.edge_root.transpose())(0, 1),
              rounding * apart + line / 16, 1e-12);
}

TEST_F(FrameTerms, TheCovarianceSaysWhereThereIsNone) {
  FrameObservations observed = Observe(structure_, pose_, 40);
  observed.faces[1].variance = -1;
  SetCovariance(model_, pose_, &observed);
  EXPECT_FALSE(observed.face_root.allFinite());
}

}  // namespace
}  // namespace volalign::refine_internal::terms_test
