#include "infer/report/advice.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <random>
#include <string>

namespace volalign::advice_test {
namespace {

Matrix6d RandomCovariance(std::mt19937* random) {
  std::normal_distribution<double> normal(0, 0.003);
  Eigen::Matrix<double, 6, 9> root;
  for (double& x : root.reshaped()) x = normal(*random);
  return root * root.transpose();
}

/// By the whole linear problem: poses of all sensors, and where the stack stands in the second
/// still.
std::vector<Matrix6d> SolvedAtOnce(const std::vector<Matrix6d>& covariances) {
  const auto n = static_cast<Eigen::Index>(covariances.size());
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(6 * (n + 1), 6 * (n + 1));
  for (Eigen::Index i = 0; i < n; ++i) {
    const Matrix6d of = covariances[static_cast<std::size_t>(i)].inverse();
    information.block<6, 6>(6 * i, 6 * i) += 2 * of;
    information.block<6, 6>(6 * i, 6 * n) -= of;
    information.block<6, 6>(6 * n, 6 * i) -= of;
    information.block<6, 6>(6 * n, 6 * n) += of;
  }
  const Eigen::MatrixXd inverse = information.inverse();
  std::vector<Matrix6d> after;
  for (Eigen::Index i = 0; i < n; ++i) after.emplace_back(inverse.block<6, 6>(6 * i, 6 * i));
  return after;
}

TEST(WithSecondStill, IsTheSolutionOfAllEquationsTogether) {
  std::mt19937 random(1);
  std::vector<Matrix6d> covariances;
  for (int i = 0; i < 5; ++i) covariances.push_back(RandomCovariance(&random));
  const std::vector<Matrix6d> after = WithSecondStill(covariances),
                              expected = SolvedAtOnce(covariances);
  for (std::size_t i = 0; i < after.size(); ++i)
    EXPECT_LT((after[i] - expected[i]).norm(), 1e-8 * expected[i].norm()) << i;
  // A single sensor cannot tell the stack's second place from its own errors.
  EXPECT_LT((WithSecondStill({covariances[0]})[0] - covariances[0]).norm(),
            1e-8 * covariances[0].norm());
}

FrameResult Placed(const std::string& name, double sigma_m) {
  FrameResult sensor;
  sensor.name = name;
  sensor.status = SensorStatus::kOk;
  sensor.structure_from_sensor = Pose::Identity();
  sensor.covariance = sigma_m * sigma_m * Matrix6d::Identity();
  return sensor;
}

TEST(Advise, NamesTheLeastKnownAlsoWhereAllIsOk) {
  CalibrationResult result;
  result.sensors = {Placed("S1", 0.004), Placed("S2", 0.002), Placed("S3", 0.003)};
  const std::vector<std::string> advice = Advise(result);
  ASSERT_EQ(advice.size(), 2u);
  EXPECT_NE(advice[0].find("volalign convert"), std::string::npos);
  // 16 / 2 + 1 / (1 / 16 + 1 / 4 + 1 / 9) / 2 = 3.03^2
  EXPECT_EQ(advice[1].find("least certain: S1 (4.0 mm) and S3 (3.0 mm)"), 0u) << advice[1];
  EXPECT_NE(advice[1].find("3.0 mm at best"), std::string::npos) << advice[1];
  result.sensors[1].status = SensorStatus::kWeak;
  EXPECT_EQ(Advise(result)[0].find("volalign convert"), std::string::npos);
  result.stills.resize(2);
  EXPECT_EQ(Advise(result).size(), 1u) << "what a third still would bring is another question";
}

}  // namespace
}  // namespace volalign::advice_test
