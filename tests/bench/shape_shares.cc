// What poses explain of a view (infer/initial/view_fit.h), and how far each is from the sensor's:
// what the figures of ViewFit::LogOdds are fitted to. tests/bench/shape_shares.py runs it.
//
//   shape_shares STRUCTURE CAPTURE.json [EXTRINSICS.json]
//
// Asked are the candidates of the search by geometry, and the refined poses that the extrinsics
// have, which are taken for right where the capture has no ground truth. One line of each, with
// tabs: the sensor; m^2 explained, contradicted, where the surface ends and where it goes on, of
// the structure's surface; planes found and open; m and deg from the sensor's pose, not a number
// where it has none.

#include <fmt/format.h>

#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/capture/capture.h"
#include "infer/initial/geometry_search.h"
#include "infer/report/extrinsics.h"
#include "tests/bench/program.h"

namespace volalign {
namespace {

void Print(const SensorFrame& frame, const std::optional<Pose>& truth, const Pose& pose,
           const ViewFit& fit) {
  double metres = std::numeric_limits<double>::quiet_NaN(), degrees = metres;
  if (truth) {
    const Pose off = truth->inverse() * pose;
    metres = off.translation().norm();
    degrees = Eigen::AngleAxisd(off.linear()).angle() / kDegree;
  }
  fmt::print("{}\t{:.5f}\t{:.5f}\t{:.5f}\t{:.5f}\t{:.5f}\t{}\t{}\t{:.4f}\t{:.3f}\n", frame.name,
             fit.explained, fit.contradicted(), fit.ends, fit.goes_on, fit.surface,
             fit.found_planes, fit.open_planes, metres, degrees);
}

int Run(const std::vector<std::string>& arguments) {
  const Structure structure = ReadStructure(arguments.at(0));
  const CaptureFile capture = ReadCapture(arguments.at(1));
  std::map<std::string, Extrinsics::Sensor> refined;
  if (arguments.size() > 2) {
    for (const Extrinsics::Sensor& sensor : ReadExtrinsics(arguments[2]).sensors) {
      if (sensor.structure_from_sensor) refined[sensor.name] = sensor;
    }
  }
  for (const SensorFrame& frame : capture.sensors) {
    const auto found = refined.find(frame.name);
    const bool is_refined = found != refined.end();
    const SensorView view =
        MakeSensorView(frame, is_refined ? found->second.intrinsics : frame.intrinsics);
    std::optional<Pose> truth = frame.ground_truth;
    if (is_refined) {
      const Pose& pose = *found->second.structure_from_sensor;
      if (!truth) truth = pose;
      Print(frame, truth, pose, MeasureShape(LookAround(view, structure).surface, structure, pose));
    }
    for (const GeometricPose& pose : FindCandidatesByGeometry(view, structure))
      Print(frame, truth, pose.structure_from_sensor, pose.shape);
  }
  return 0;
}

}  // namespace
}  // namespace volalign

int main(int argc, char** argv) {
  return volalign::StatusOf([&] { return volalign::Run({argv + 1, argv + argc}); });
}
