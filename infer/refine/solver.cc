#include "infer/refine/solver.h"

#include <ceres/iteration_callback.h>
#include <ceres/solver.h>

#include "core/base/stop.h"

namespace volalign::refine_internal {

namespace {

constexpr double kFunctionTolerance = 1e-7, kParameterTolerance = 1e-9;

/// Ceres lets no exception through its own threads.
class StopCallback : public ceres::IterationCallback {
 public:
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& /*summary*/) override {
    return IsStopAsked() ? ceres::SOLVER_ABORT : ceres::SOLVER_CONTINUE;
  }
};

}  // namespace

Minimum Minimise(const RefineOptions& options, ceres::Problem* problem) {
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  // SuiteSparse factorises with OpenBLAS, whose idle threads keep processors busy: a sixth slower.
  solver.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
  solver.max_num_iterations = options.inner_iterations;
  solver.num_threads = options.threads;
  solver.function_tolerance = kFunctionTolerance;
  solver.parameter_tolerance = kParameterTolerance;
  solver.logging_type = ceres::SILENT;
  StopCallback stop;
  solver.callbacks.push_back(&stop);
  ceres::Solver::Summary summary;
  ceres::Solve(solver, problem, &summary);
  ThrowIfStopped();
  return {summary.IsSolutionUsable(), summary.termination_type == ceres::CONVERGENCE};
}

}  // namespace volalign::refine_internal
