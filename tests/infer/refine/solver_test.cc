#include "infer/refine/solver.h"

#include <ceres/sized_cost_function.h>
#include <ceres/version.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "infer/refine/ceres_version.h"

namespace volalign::refine_internal::solver_test {
namespace {

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

TEST(Minimise, SaysWhetherItCould) {
  RefineOptions options;
  options.inner_iterations = 20;
  for (const bool works : {true, false}) {
    CeresProblem ceres;
    std::vector<double> x = {1, 0.5};
    ceres.problem->AddResidualBlock(new Line(works), nullptr, x.data());
    ceres.HoldConstant(x.data(), 2, {1});
    EXPECT_EQ(Minimise(options, ceres.problem.get()).usable, works);
    EXPECT_NEAR(x[0], works ? 2.5 : 1, 1e-3);
    EXPECT_EQ(x[1], 0.5) << "held";
  }
}

TEST(Minimise, SaysWhetherItEndedByItsToleranceOrByTheNumberOfItsSteps) {
  for (const int most : {1, 20}) {
    RefineOptions options;
    options.inner_iterations = most;
    const CeresProblem ceres;
    std::vector<double> x = {1, 0.5};
    ceres.problem->AddResidualBlock(new Line(true), nullptr, x.data());
    const Minimum minimum = Minimise(options, ceres.problem.get());
    EXPECT_TRUE(minimum.usable);
    EXPECT_EQ(minimum.converged, most == 20) << most;
  }
}

TEST(CeresVersion, BeginsWithItsNumber) {
  const std::string number =
      std::to_string(CERES_VERSION_MAJOR) + "." + std::to_string(CERES_VERSION_MINOR) + ".";
  EXPECT_EQ(CeresVersion().rfind(number, 0), 0u) << CeresVersion();
}

}  // namespace
}  // namespace volalign::refine_internal::solver_test
