#include "infer/refine/parameters.h"

#include <gtest/gtest.h>

#include <ceres/crs_matrix.h>
#include <ceres/problem.h>
#include <ceres/sized_cost_function.h>
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/frame_errors.h"
#include "core/geometry/sensor_kind.h"
#include "infer/refine/build_model.h"
#include "infer/refine/noise.h"
#include "infer/refine/options.h"
#include "infer/refine/pair_overlap.h"
#include "infer/refine/pose_manifold.h"
#include "infer/refine/problem.h"
#include "infer/refine/solution.h"
#include "infer/refine/solver.h"
#include "infer/refine/terms.h"
#include "tests/core/base/expect_error.h"
#include "tests/infer/refine/points_and_observations.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::refine_internal::parameters_test {
namespace {

using namespace testing_infer;

/// A parameter by its own name, and where the layout says its column is.
struct Named {
  std::string name;
  Eigen::Index column;
  std::function<void(State*, double)> move;
};

/// Moves a pose by a step of its tangent space.
void MovePose(int k, double step, PoseBlock* pose) {
  PoseBlock moved(PerturbLeft(step * Vector6d::Unit(k), pose->ToPose()));
  // Of the two quaternions of a rotation, the nearer.
  Eigen::Map<Eigen::Vector4d> q(moved.values);
  if (q.dot(Eigen::Map<Eigen::Vector4d>(pose->values)) < 0) q = -q;
  *pose = moved;
}

std::vector<Named> AllParameters(const ParameterLayout& layout) {
  std::vector<Named> all;
  const auto add = [&](const std::string& name, Eigen::Index column,
                       const std::function<double&(State*)>& of) {
    all.push_back({name, column, [of](State* s, double h) { of(s) += h; }});
  };
  const auto add_pose = [&](const std::string& name, Eigen::Index column,
                            const std::function<PoseBlock&(State*)>& of) {
    for (int k = 0; k < 6; ++k)
      all.push_back({name + " " + std::to_string(k), column + k,
                     [of, k](State* s, double h) { MovePose(k, h, &of(s)); }});
  };
  for (std::size_t i = 0; i < layout.frames(); ++i) {
    const std::string frame = " of frame " + std::to_string(i);
    add_pose("pose" + frame, layout.Pose(i), [i](State* s) -> PoseBlock& { return s->poses[i]; });
    add("offset" + frame, layout.Offset(i), [i](State* s) -> double& { return s->offsets[i]; });
  }
  for (std::size_t capture = 1; capture < layout.captures(); ++capture)
    add_pose("placement", layout.Placement(capture),
             [capture](State* s) -> PoseBlock& { return s->placements[capture]; });
  for (std::size_t i = 0; i < layout.sensors(); ++i) {
    for (int k = 0; k < kSensorErrors; ++k)
      add("error" + std::to_string(k) + " of sensor " + std::to_string(i),
          layout.ErrorsOfSensor(i) + k, [i, k](State* s) -> double& { return s->errors[i][k]; });
  }
  for (std::size_t lens = 0; lens < layout.lenses(); ++lens) {
    for (int k = 0; k < kLensParameters; ++k)
      add("lens" + std::to_string(lens) + "," + std::to_string(k), layout.Lens(lens) + k,
          [lens, k](State* s) -> double& { return s->lenses[lens][k]; });
  }
  add("size", layout.Size(), [](State* s) -> double& { return s->size; });
  for (std::size_t capture = 0; capture < layout.captures(); ++capture) {
    for (int b = 0; b < static_cast<int>(layout.boxes()); ++b) {
      int k = 0;
      for (const int at : {BuildModel::X(b), BuildModel::Z(b), BuildModel::Yaw(b)})
        add("box " + std::to_string(b), layout.Boxes(capture) + Eigen::Index{3} * b + k++,
            [capture, at](State* s) -> double& {
              return s->boxes[capture][static_cast<std::size_t>(at)];
            });
    }
    for (int label = 1; label <= 5 * static_cast<int>(layout.boxes()); ++label) {
      const int at = BuildModel::Bulge(label);
      add("side " + std::to_string(label), layout.Bulges(capture) + at,
          [capture, at](State* s) -> double& {
            return s->bulges[capture][static_cast<std::size_t>(at)];
          });
    }
  }
  add_pose("world", layout.World(), [](State* s) -> PoseBlock& { return s->world; });
  add("scale of the world", layout.WorldScale(),
      [](State* s) -> double& { return s->world_scale; });
  return all;
}

/// Compares derivatives of all terms with differences, for sensors with so many lenses.
void ExpectColumnsOfTheJacobian(int lens_count) {
  // The stack stands elsewhere in the second capture, which has a frame of the first sensor.
  Rig rig{PaperStructure(), {}, {}};
  const Pose placement = MakePose({0, 0.7, 0}, {0.4, 0, -0.2});
  rig.Add("A", RingPose(40));
  rig.Add("B", RingPose(100));
  rig.Add("A", placement.inverse() * RingPose(40));
  std::vector<SensorPoints> points = PointsOf(rig);
  std::vector<FrameInput> frames;
  std::vector<SensorLens> lenses(static_cast<std::size_t>(lens_count));
  for (std::size_t i = 0; i < 3; ++i) {
    const Pose start = Displaced(*rig.frames[i].ground_truth, 0.01, 0.5, i);
    const std::size_t sensor = i == 1 ? 1 : 0;
    points[i].intrinsics = rig.frames[i].intrinsics;
    frames.push_back({Borrowed(points[i]), start, sensor % lenses.size(), static_cast<int>(sensor),
                      i == 2 ? 1u : 0u});
  }
  for (std::size_t i = 0; i < 2; ++i)
    frames[i].prior =
        PosePrior{Displaced(frames[i].start, 0.1, 3, 7), PriorWorld::kScaleFree, 0.05, 3};
  for (SensorLens& lens : lenses) lens.prior_sigmas = Eigen::Vector3d(0.01, 0.1, 0.2);
  const RefineOptions options;
  const JointProblem problem(rig.structure, frames, options, lenses, 2);
  State state = NominalState(rig.structure, {frames[0].start, frames[1].start, frames[2].start},
                             lenses, problem.frame_of, {Pose::Identity(), placement});
  const FreeSet everything = AskedFor(ParseEstimate("auto"), problem.priors, 3, lenses);
  const std::vector<FrameObservations> observed =
      GatherObservations(problem, state, everything, {});
  const ParameterLayout& layout = problem.layout;
  const std::vector<char> none(static_cast<std::size_t>(layout.size()), 0);
  const std::vector<PairOverlap> overlaps = FindOverlaps(problem, observed, {0, 0, 0}, state);
  ASSERT_GT(overlaps.at(0).of_a.size(), 100u);
  for (const Named& parameter : AllParameters(layout))
    parameter.move(&state, 0.001 * static_cast<double>(parameter.column % 5 - 2));
  ceres::Problem ceres = BuildCeresProblem(problem, observed, overlaps, {0, 0, 0}, none, &state);

  ceres::Problem::EvaluateOptions evaluation;
  for (const ParameterLayout::Block& block : layout.Blocks(&state))
    evaluation.parameter_blocks.push_back(block.values);
  ceres::CRSMatrix sparse;
  std::vector<double> ignored;
  ASSERT_TRUE(ceres.Evaluate(evaluation, nullptr, &ignored, nullptr, &sparse));
  ASSERT_EQ(sparse.num_cols, layout.size());
  Eigen::MatrixXd jacobian = Eigen::MatrixXd::Zero(sparse.num_rows, sparse.num_cols);
  for (int row = 0; row < sparse.num_rows; ++row) {
    for (int k = sparse.rows[static_cast<std::size_t>(row)];
         k < sparse.rows[static_cast<std::size_t>(row) + 1]; ++k) {
      const auto at = static_cast<std::size_t>(k);
      jacobian(row, sparse.cols[at]) = sparse.values[at];
    }
  }
  const auto residuals_after = [&](const Named& parameter, double step) {
    parameter.move(&state, step);  // in the memory that Ceres refers to
    std::vector<double> residuals;
    EXPECT_TRUE(ceres.Evaluate(evaluation, nullptr, &residuals, nullptr, nullptr));
    parameter.move(&state, -step);
    return Eigen::VectorXd(
        Eigen::Map<Eigen::VectorXd>(residuals.data(), static_cast<Eigen::Index>(residuals.size())));
  };
  std::vector<int> named(static_cast<std::size_t>(layout.size()), 0);
  constexpr double kStep = 1e-6;
  for (const Named& parameter : AllParameters(layout)) {
    ++named[static_cast<std::size_t>(parameter.column)];
    const Eigen::VectorXd numeric =
        (residuals_after(parameter, kStep) - residuals_after(parameter, -kStep)) / (2 * kStep);
    const double scale = numeric.cwiseAbs().maxCoeff();
    ASSERT_GT(scale, 0) << parameter.name;
    EXPECT_LT((jacobian.col(parameter.column) - numeric).cwiseAbs().maxCoeff(), 1e-4 * scale)
        << parameter.name;
  }
  for (const int times : named) EXPECT_EQ(times, 1) << "every column has one name";
}

TEST(ParameterLayout, ColumnsAreThoseOfTheJacobianThatCeresEvaluates) {
  for (const int lens_count : {1, 2}) ExpectColumnsOfTheJacobian(lens_count);
}

TEST(ParameterLayout, PriorsStandAtTheirParameters) {
  const ParameterLayout layout = LayoutOf(2, 3);
  SensorLens lens;
  lens.prior_sigmas = Eigen::Vector3d(0.01, 0.2, 0.1);
  lens.own_focal_sigma = 0.0015;
  DepthErrorModel seam, none;
  seam.seam_m = 0.001;
  seam.tilt_m = 0.003;
  seam.bounce_m = 0.004;
  const Eigen::VectorXd sigmas = layout.PriorSigmas(SomePriors(), {seam, none}, {lens});
  ASSERT_EQ(sigmas.size(), 2 * (6 + 1 + kSensorErrors) + 3 + 1 + (3 + 5) * 3 + 7);
  EXPECT_EQ(sigmas.segment<kLensParameters>(layout.Lens(0)), lens.prior_sigmas);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(sigmas[layout.Pose(i) + 5], 1);
    EXPECT_EQ(sigmas[layout.Offset(i)], 0.007);
    EXPECT_EQ(sigmas[layout.Error(i, kGain)], 0.003);
    EXPECT_EQ(sigmas[layout.Error(i, kFocal)], 0.0015);
    EXPECT_EQ(sigmas[layout.Error(i, kMultipath)], i == 0 ? 0.001 : 1e-6) << "none is not 0";
    EXPECT_EQ(sigmas[layout.Error(i, kEdgeShift) + 1], 0.7);
    EXPECT_EQ(sigmas[layout.ErrorsOfSensor(i) + kTiltColumns], i == 0 ? 0.003 : 1e-6);
    EXPECT_NEAR(sigmas[layout.ErrorsOfSensor(i) + kDiffuseMultipath], i == 0 ? 0.00462 : 1e-6, 1e-5)
        << "root mean square of what lies evenly within twice the mean";
  }
  EXPECT_EQ(sigmas[layout.Size()], 0.01);
  for (Eigen::Index b = 0; b < 3; ++b) {
    EXPECT_EQ(sigmas[layout.Boxes() + 3 * b], 0.004);
    EXPECT_EQ(sigmas[layout.Boxes() + 3 * b + 1], 0.004);
    EXPECT_EQ(sigmas[layout.Boxes() + 3 * b + 2], 0.009);
  }
  EXPECT_TRUE((sigmas.segment(layout.Bulges(0), 5 * 3).array() == 0.002).all());
  EXPECT_TRUE((sigmas.tail(7).array() == 1).all()) << "the world of pose priors";
}

TEST(ParameterLayout, WhatIsNotFreeIsConstant) {
  const ParameterLayout layout = LayoutOf(2, 4);
  FreeSet free = AskedFor(ParseEstimate("auto"), SomePriors(), 2);
  EXPECT_TRUE(free.boxes);
  free.boxes = free.gain = false;
  const auto fixed = [&](const std::vector<char>& constant) {
    return std::accumulate(constant.begin(), constant.end(), 0);
  };
  constexpr int kKnownLens = kLensParameters + 2;  // and the sensors' own focal lengths
  EXPECT_EQ(fixed(layout.Constant(free)), 12 + 2 + kKnownLens);
  const std::vector<char> without_0 = layout.Constant(free, {1, 0});
  EXPECT_EQ(fixed(without_0), 12 + 2 + kKnownLens + 6 + 1 + kSensorErrors - 2)
      << "gain and focal length are fixed already";
  EXPECT_TRUE(without_0[static_cast<std::size_t>(layout.Pose(0))]);
  EXPECT_FALSE(without_0[static_cast<std::size_t>(layout.Pose(1))]);
  FreeSet with_lens = free;
  with_lens.lens = {1};
  const std::vector<char> lens_without_0 = layout.Constant(with_lens, {1, 0});
  EXPECT_TRUE(lens_without_0[static_cast<std::size_t>(layout.Error(0, kFocal))]);
  EXPECT_FALSE(lens_without_0[static_cast<std::size_t>(layout.Error(1, kFocal))]);
}

TEST(AskedFor, LeavesOutWhatAPriorOfZeroFixes) {
  Priors priors = SomePriors();
  priors.gain = 0;
  priors.size = 0;
  const FreeSet free = AskedFor(ParseEstimate("auto"), priors, 2);
  EXPECT_FALSE(free.size);
  EXPECT_FALSE(free.gain);
  EXPECT_TRUE(free.offset);
  EXPECT_FALSE(AskedFor(ParseEstimate("size"), SomePriors(), 1).boxes);
}

TEST(FrameState, CorrectsAlongTheRay) {
  const FrameState sensor{Pose::Identity(), 0.01, 0.02};
  const Eigen::Vector3d p(0.3, -0.2, 2);
  const Eigen::Vector3d corrected = sensor.Corrected(p);
  EXPECT_NEAR(corrected.z(), 2 * 1.01 + 0.02, 1e-12);
  EXPECT_NEAR(corrected.x() / corrected.z(), 0.15, 1e-12);
}

/// Two sensors in two captures, the second in the second only, and boxes that stand anywhere. The
/// third frame is fixed.
struct Handmade {
  Structure structure = PaperStructure();
  SensorPoints nothing;
  RefineOptions options;
  std::vector<FrameInput> frames;
  Pose placement = MakePose({0, 0.7, 0}, {0.4, 0.01, -0.3});
  Solution solution;

  Handmade() {
    const std::vector<Pose> poses = {RingPose(20), RingPose(70), RingPose(140)};
    for (int i = 0; i < 3; ++i) {
      const Pose& pose = poses[static_cast<std::size_t>(i)];
      frames.push_back({Borrowed(nothing), pose, 0, i / 2, i == 0 ? 0u : 1u});
    }
    const JointProblem problem = Problem();
    solution.state = NominalState(structure, poses, problem.lenses, problem.frame_of,
                                  {Pose::Identity(), placement});
    for (std::vector<double>& capture : solution.state.boxes) {
      for (double& value : capture) value = 0.001 * next_++;
    }
    solution.state.UpdateBuilt(problem.model);
    solution.free.boxes = true;
    solution.fixed = {0, 0, 1};
    solution.observed.resize(3);
  }
  JointProblem Problem() const { return {structure, frames, options, {SensorLens()}, 2}; }

 private:
  int next_ = 1;
};

Pose SensorFromBox(const State& state, std::size_t frame, std::size_t box) {
  return state.poses[frame].ToPose().inverse() * state.Built(frame).boxes()[box].structure_from_box;
}

Pose FirstFromSensor(const State& state, std::size_t frame) {
  return state.placements[state.frame_of[frame].capture].ToPose() * state.poses[frame].ToPose();
}

TEST(CentreBoxes, MovesNothingAgainstAnythingElse) {
  Handmade made;
  const State before = made.solution.state;
  CentreBoxes(made.Problem(), &made.solution);
  const State& after = made.solution.state;
  for (std::size_t capture = 0; capture < 2; ++capture) {
    double x = 0, z = 0;
    for (int b = 0; b < 4; ++b) {
      const auto k = static_cast<std::size_t>(b);
      const auto at = [&](const State& state, int parameter) {
        return state.boxes[capture][static_cast<std::size_t>(parameter)];
      };
      EXPECT_EQ(at(after, BuildModel::Yaw(b)), at(before, BuildModel::Yaw(b)));
      x += at(after, BuildModel::X(b));
      z += at(after, BuildModel::Z(b));
      EXPECT_TRUE(
          SensorFromBox(after, capture, k).isApprox(SensorFromBox(before, capture, k), 1e-12))
          << capture << " " << b;
    }
    EXPECT_NEAR(x, 0, 1e-15);
    EXPECT_NEAR(z, 0, 1e-15);
  }
  const auto second_from_first = [](const State& state) -> Pose {
    return FirstFromSensor(state, 1).inverse() * FirstFromSensor(state, 0);
  };
  EXPECT_TRUE(second_from_first(after).isApprox(second_from_first(before), 1e-12));
  EXPECT_TRUE(after.placements[0].ToPose().isApprox(Pose::Identity(), 1e-15));
  EXPECT_TRUE(after.poses[2].ToPose().isApprox(made.frames[2].start, 1e-12));
}

TEST(CentreBoxes, LeavesBoxesThatAreNotEstimated) {
  Handmade made;
  made.solution.free.boxes = false;
  const State before = made.solution.state;
  CentreBoxes(made.Problem(), &made.solution);
  EXPECT_EQ(made.solution.state.boxes, before.boxes);
  EXPECT_TRUE(made.solution.state.poses[0].ToPose().isApprox(before.poses[0].ToPose(), 1e-15));
}

/// x - 3, or nothing at all.
class Line : public ceres::SizedCostFunction<1, 2> {
 public:
  explicit Line(bool works) : works_(works) {}
  bool Evaluate(double const* const* x, double* residual, double** jacobians) const override {
    residual[0] = x[0][0] - 3 + x[0][1];
    if (jacobians && jacobians[0]) jacobians[0][0] = jacobians[0][1] = 1;
    return works_;
  }

 private:
  bool works_;
};

TEST(Minimise, SaysWhetherItCouldAndWhetherItEndedByItsTolerance) {
  for (const auto& [works, steps] :
       {std::pair(true, 20), std::pair(true, 1), std::pair(false, 20)}) {
    RefineOptions options;
    options.inner_iterations = steps;
    ceres::Problem ceres;
    std::vector<double> x = {1, 0.5};
    ceres.AddResidualBlock(new Line(works), nullptr, x.data());
    ceres.SetManifold(x.data(), new ceres::SubsetManifold(2, {1}));
    const Minimum minimum = Minimise(options, &ceres);
    EXPECT_EQ(minimum.usable, works);
    EXPECT_EQ(minimum.converged, works && steps == 20);
    EXPECT_NEAR(x[0], works ? 2.5 : 1, 1e-3);
    EXPECT_EQ(x[1], 0.5) << "held";
  }
}

// PlusJacobian is against differences in the test of the columns above.
TEST(LeftPoseManifold, PlusIsPerturbLeft) {
  RandomStream random(5, 0, "plus");
  for (int trial = 0; trial < 30; ++trial) {
    const Pose pose = RandomPose(random);
    Vector6d delta;
    for (int i = 0; i < 6; ++i) delta[i] = random.Normal(0, trial % 2 ? 0.5 : 1e-9);
    const PoseBlock x(pose);
    PoseBlock y;
    ASSERT_TRUE(LeftPoseManifold().Plus(x.values, delta.data(), y.values));
    EXPECT_TRUE(y.ToPose().isApprox(PerturbLeft(delta, pose), 1e-12));
    EXPECT_LT((LeftDifference(pose, y.ToPose()) - delta).norm(), 1e-9);
    // A small step before another pose is the step of its adjoint behind it.
    const Pose other = RandomPose(random);
    const Vector6d step = 1e-6 * delta.normalized();
    const Vector6d turned = LeftDifference(other * pose, other * PerturbLeft(step, pose));
    EXPECT_LT((turned - Adjoint(other) * step).norm(), 1e-9);
  }
}

TEST(BuildModel, MovesTurnsAndGrowsOnTheSameFloor) {
  const Structure structure = PaperStructure();
  const BuildModel model(structure);
  std::vector<double> boxes(3 * structure.boxes().size(), 0);
  EXPECT_EQ(boxes.size(), 3 * structure.boxes().size());
  const double size = 0.02;
  boxes[static_cast<std::size_t>(BuildModel::X(1))] = 0.003;
  boxes[static_cast<std::size_t>(BuildModel::Z(1))] = -0.004;
  boxes[static_cast<std::size_t>(BuildModel::Yaw(1))] = M_PI / 2;
  const Structure built = model.Built({&size, boxes.data()});
  EXPECT_NEAR(built.FloorHeight(), structure.FloorHeight(), 1e-9);
  for (std::size_t b = 0; b < structure.boxes().size(); ++b) {
    const Box &before = structure.boxes()[b], &after = built.boxes()[b];
    EXPECT_TRUE(after.size.isApprox(1.02 * before.size, 1e-12));
    Eigen::Vector3d expected = before.structure_from_box.translation();
    expected.y() += 0.02 * (expected.y() - structure.FloorHeight());
    if (b == 1) expected += Eigen::Vector3d(0.003, 0, -0.004);
    EXPECT_TRUE(after.structure_from_box.translation().isApprox(expected, 1e-9)) << b;
    // A quarter turn about the vertical takes +x to -z.
    const Eigen::Vector3d x = after.structure_from_box.linear().col(0),
                          was = before.structure_from_box.linear().col(0);
    const Eigen::Vector3d turned = b == 1 ? Eigen::Vector3d(was.z(), was.y(), -was.x()) : was;
    EXPECT_TRUE(x.isApprox(turned, 1e-9)) << b;
  }
}

TEST(ParseEstimate, NamesItsWords) {
  EXPECT_TRUE(ParseEstimate("auto").boxes);
  EXPECT_TRUE(ParseEstimate("auto").depth_offset);
  EXPECT_FALSE(ParseEstimate("none").size);
  const EstimateSet two = ParseEstimate("size, depth_gain");
  EXPECT_TRUE(two.size && two.depth_gain);
  EXPECT_FALSE(two.boxes || two.depth_offset);
  for (const char* bad : {"", "boxes,,size", "box", "auto,size", "size,"})
    ExpectError<ConfigError>([&] { ParseEstimate(bad); }, {"refine.estimate", "depth_offset"});
}

// Depths of two sensors: light that bounces adds 4 mm times its share to those of one and nothing
// to those of the other, and a side that both see bulges by 3 mm.
TEST(Solve, TellsMultipathAndBulgesFromPoses) {
  const Neighbours made;
  const Structure& structure = made.rig.structure;
  RefineOptions options;
  options.max_overlap_points = 0;
  const JointProblem problem(structure, made.frames, options);
  Solution solution{
      AskedFor({}, problem.priors, 2), NominalState(structure, made.poses), {}, {0, 0}};
  constexpr double kBounce = 0.004, kBulge = 0.003;
  std::map<int, int> seen;
  for (const Pose& pose : made.poses) {
    for (const FaceObservation& face : Observe(structure, pose, 8).faces) ++seen[face.label];
  }
  const int bulging = std::max_element(seen.begin(), seen.end(), [](const auto& a, const auto& b) {
                        return a.second < b.second;
                      })->first;
  for (std::size_t i = 0; i < 2; ++i) {
    FrameObservations observed = Observe(structure, made.poses[i], 8);
    const DepthErrorModel errors = ErrorsOf("");
    for (FaceObservation& face : observed.faces) {
      const Side& side = structure.SideOfLabel(face.label);
      const Eigen::Vector3d normal = made.poses[i].linear().transpose() * side.normal;
      face.by_errors.setZero();
      face.by_errors.head<kFrameErrors>() = FrameErrorsAt(errors, face.p, normal);
      face.by_errors[kDiffuseMultipath] =
          DiffuseMultipathShare(structure, side, made.poses[i] * face.p,
                                made.poses[i].translation(), errors.bounce_reach_m);
      const double share = face.by_errors[kDiffuseMultipath];
      if (face.label == bulging) face.p += kBulge * face.bulge / normal.dot(face.p) * face.p;
      if (i == 0) face.p *= 1 + kBounce * share / face.p.z();
    }
    observed.noise.depth.smooth_m = 0.0005;
    SetCovariance(problem.model, made.poses[i], &observed);
    solution.observed.push_back(std::move(observed));
  }
  ASSERT_TRUE(Solve(problem, &solution));
  EXPECT_NEAR(solution.state.errors[0][kDiffuseMultipath], -kBounce, 0.1 * kBounce);
  EXPECT_NEAR(solution.state.errors[1][kDiffuseMultipath], 0, 0.1 * kBounce);
  for (int label = 1; label < structure.num_classes(); ++label) {
    EXPECT_NEAR(solution.state.bulges[0][static_cast<std::size_t>(BuildModel::Bulge(label))],
                label == bulging ? kBulge : 0, 0.2 * kBulge)
        << label;
  }
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_LT(ComparePoses(solution.state.poses[i].ToPose(), made.poses[i]).translation_m, 1.5e-3);
    EXPECT_LT(ComparePoses(solution.state.poses[i].ToPose(), made.poses[i]).rotation_deg, 0.05);
  }
}

TEST(HoldFrame, LeavesNoErrors) {
  const Neighbours made;
  const JointProblem problem(made.rig.structure, made.frames, RefineOptions());
  Solution solution{
      AskedFor({}, problem.priors, 2), NominalState(made.rig.structure, made.poses), {}, {0, 0}};
  for (std::size_t i = 0; i < 2; ++i) {
    solution.state.errors[i].fill(0.001);
  }
  HoldFrame(problem, 0, &solution);
  EXPECT_TRUE(solution.state.errors[0].isZero());
  EXPECT_EQ(solution.state.errors[1][kDiffuseMultipath], 0.001) << "another frame";
}

}  // namespace
}  // namespace volalign::refine_internal::parameters_test
