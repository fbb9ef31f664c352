#include "infer/refine/solver.h"

#include <ceres/sized_cost_function.h>
#include <gtest/gtest.h>

#include <vector>

namespace volalign::refine_internal {
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
    EXPECT_EQ(Minimise(options, ceres.problem.get()), works);
    EXPECT_NEAR(x[0], works ? 2.5 : 1, 1e-3);
    EXPECT_EQ(x[1], 0.5) << "held";
  }
}

}  // namespace
}  // namespace volalign::refine_internal
