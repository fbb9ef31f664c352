#include "infer/report/advice.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cstddef>
#include <utility>

#include "infer/checks/verdict.h"

namespace volalign {

namespace {

/// Names the least certain sensors, and the largest standard deviation after a second capture.
/// Empty if there are several captures already, or fewer than two such sensors.
std::string AdviseSecondCapture(const CalibrationResult& result) {
  std::vector<std::pair<double, const FrameResult*>> known;
  std::vector<Matrix6d> covariances;
  for (const FrameResult& sensor : result.sensors) {
    if (!sensor.structure_from_sensor || !sensor.covariance.allFinite() ||
        !(sensor.covariance.determinant() > 0))
      continue;
    known.emplace_back(LargestSigmaPosition(*sensor.structure_from_sensor, sensor.covariance),
                       &sensor);
    covariances.push_back(sensor.covariance);
  }
  if (known.size() < 2 || !result.captures.empty()) return "";
  const std::vector<Matrix6d> after = WithSecondCapture(covariances);
  double worst = 0;
  for (std::size_t i = 0; i < after.size(); ++i) {
    worst =
        std::max(worst, LargestSigmaPosition(*known[i].second->structure_from_sensor, after[i]));
  }
  std::stable_sort(known.begin(), known.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  return fmt::format(
      "least certain: {} ({:.1f} mm) and {} ({:.1f} mm). To improve: move only the stack, capture "
      "again, and calibrate with both captures ({:.1f} mm at best)",
      known[0].second->name, 1000 * known[0].first, known[1].second->name, 1000 * known[1].first,
      1000 * worst);
}

}  // namespace

std::vector<Matrix6d> WithSecondCapture(const std::vector<Matrix6d>& covariances) {
  Matrix6d information = Matrix6d::Zero();
  for (const Matrix6d& covariance : covariances) information += covariance.inverse();
  const Matrix6d common = information.inverse();
  std::vector<Matrix6d> after;
  for (const Matrix6d& covariance : covariances) after.emplace_back((covariance + common) / 2);
  return after;
}

std::vector<std::string> Advise(const CalibrationResult& result) {
  std::vector<std::string> advice;
  if (result.verdict() == SensorStatus::kOk) {
    advice.emplace_back(
        "the poses can be used: volalign convert writes them for other programs. To see later "
        "whether a sensor moved, take a new capture and run volalign check");
  } else if (result.placed() > 0 && !result.findings.empty()) {
    advice.emplace_back(
        "all poses are doubtful for the same reason: do what is said above, and calibrate again");
  } else if (result.placed() > 0) {
    advice.emplace_back(
        "use the poses of the sensors that are ok. For the others, do what is said above, and "
        "calibrate again");
  } else {
    advice.emplace_back("no pose can be used; do what is said above and calibrate again");
  }
  if (const std::string second = AdviseSecondCapture(result); !second.empty())
    advice.push_back(second);
  return advice;
}

}  // namespace volalign
