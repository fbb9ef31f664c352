#include "infer/plan/plan_rig.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "core/base/input_file.h"
#include "core/base/noise_fields.h"
#include "core/base/random.h"
#include "core/geometry/lens.h"
#include "core/geometry/sensor_kind.h"
#include "core/geometry/structure.h"
#include "core/geometry/visibility.h"
#include "infer/initial/sides_fix_pose.h"

namespace volalign {

namespace {

constexpr float kEdgeStep = 0.08F;  // m, least step between neighbours that is a depth edge
constexpr double kFarthest = 12;    // m, of the floor

/// Adds the floor where nothing stands before it.
void AddFloor(const RayTable& rays, const Pose& structure_from_sensor, double height,
              DepthImage* depth) {
  for (int v = 0; v < depth->height(); ++v) {
    for (int u = 0; u < depth->width(); ++u) {
      const Eigen::Vector2f& ray = rays.at(u, v);
      if ((*depth)(u, v) > 0 || !ray.allFinite()) continue;
      const double falls =
          (structure_from_sensor.linear() * Eigen::Vector3d(ray.x(), ray.y(), 1)).y();
      const double z = (height - structure_from_sensor.translation().y()) / falls;
      if (falls < 0 && z < kFarthest) (*depth)(u, v) = static_cast<float>(z);
    }
  }
}

/// Removes `count` pixels on the far side of every depth edge, along rows and columns.
void LeaveGaps(int count, PlannedFrame* planned) {
  DepthImage& depth = planned->frame.depth;
  const DepthImage before = depth;
  const auto clear = [&](int u, int v, int du, int dv) {
    for (int k = 0; k < count && depth.Contains(u, v); ++k, u += du, v += dv) {
      depth(u, v) = 0;
      planned->labels(u, v) = 0;
    }
  };
  ForEachNeighbourPair(before.width(), before.height(),
                       [&](int u, int v, int p, int q, std::uint64_t /*pair*/) {
                         const float a = before(u, v), b = before(p, q);
                         if (a == 0 || b == 0 || std::abs(a - b) < kEdgeStep) return;
                         if (a < b) {
                           clear(p, q, p - u, q - v);
                         } else {
                           clear(u, v, u - p, v - q);
                         }
                       });
}

}  // namespace

PlannedFrame MeasurePlanned(SensorFrame frame, const Structure& structure, std::uint64_t seed,
                            std::uint64_t index) {
  const Pose& pose = *frame.ground_truth;
  const RayTable rays = ComputeRays(frame.intrinsics);
  ExpectedView view = CastView(structure, rays, pose);
  AddFloor(rays, pose, structure.FloorHeight(), &view.depth);
  PlannedFrame planned{std::move(frame), std::move(view.labels)};
  planned.frame.depth = std::move(view.depth);
  DepthImage& depth = planned.frame.depth;
  const DepthErrorModel& errors = ErrorsOf(planned.frame.sensor);
  const double focal = planned.frame.intrinsics.fx;
  LeaveGaps(static_cast<int>(std::lround(errors.edge_gap_rad * focal)), &planned);
  RandomStream random(seed, index, "planned");
  const Image<float> smooth =
      SmoothField(depth.width(), depth.height(), errors.smooth_rad * focal, random);
  const double offset = errors.offset_m * random.Normal();
  const PixelRandom pixel(random);
  for (std::size_t i = 0; i < depth.size(); ++i) {
    const double z = depth[i];
    if (z == 0) continue;
    const double error = offset + errors.White(z) * pixel.Normal(i) + errors.Smooth(z) * smooth[i];
    depth[i] = static_cast<float>(std::max(0.001, z + error));
  }
  return planned;
}

namespace {

constexpr double kSurfaceGrid = 0.04;  // m

/// Gives the true labels of frames, which it recognises by their depth maps.
class TrueLabels : public Segmenter {
 public:
  explicit TrueLabels(const std::vector<PlannedFrame>& planned) : planned_(planned) {}
  std::vector<SegmentationResult> Segment(
      const std::vector<SegmentationRequest>& requests) override {
    std::vector<SegmentationResult> results;
    for (const SegmentationRequest& request : requests) {
      const auto found = std::find_if(
          planned_.begin(), planned_.end(),
          [&](const PlannedFrame& planned) { return planned.frame.depth == *request.depth; });
      const int width = request.depth->width(), height = request.depth->height();
      results.push_back({found == planned_.end() ? LabelImage(width, height) : found->labels,
                         Image<float>(width, height, 1.0F)});
    }
    return results;
  }

 private:
  const std::vector<PlannedFrame>& planned_;
};

std::vector<PlannedSensor> SensorsOf(const Rig& rig, const Structure& structure) {
  const std::vector<IntrinsicsPoolEntry> pool = ReadIntrinsicsPool(rig.intrinsics);
  std::vector<PlannedSensor> sensors;
  for (const RigSensor& of : rig.sensors) {
    PlannedSensor sensor;
    sensor.name = of.name;
    sensor.sensor = of.sensor;
    sensor.intrinsics = IntrinsicsOf(of, pool, rig.intrinsics).front();
    sensor.structure_from_sensor =
        RigSensorPose(of, rig.structure_yaw_deg, structure.FloorHeight());
    sensor.distance_m = sensor.structure_from_sensor.translation().norm();
    sensors.push_back(std::move(sensor));
  }
  return sensors;
}

/// Share of the surface points that nothing hides from the sensor that are in its picture.
double ShareInView(const PlannedSensor& sensor, const Structure& structure) {
  const Pose& pose = sensor.structure_from_sensor;
  const Eigen::Vector3d eye = pose.translation();
  const Pose sensor_from_structure = pose.inverse();
  int seen = 0, inside = 0;
  for (const Eigen::Vector3d& point : SampleExposedSurface(structure, kSurfaceGrid)) {
    constexpr double kBefore = 1 - 1e-6;
    if (CastRay(structure, eye, point - eye).t < kBefore) continue;
    ++seen;
    const Eigen::Vector3d p = sensor_from_structure * point;
    if (p.z() <= 0) continue;
    const Eigen::Vector2d pixel = ProjectRay(sensor.intrinsics, p.hnormalized());
    inside += pixel.x() > -0.5 && pixel.x() < sensor.intrinsics.width - 0.5 && pixel.y() > -0.5 &&
              pixel.y() < sensor.intrinsics.height - 0.5;
  }
  return seen > 0 ? static_cast<double>(inside) / seen : 0;
}

void CountSides(const LabelImage& labels, const Structure& structure, PlannedSensor* sensor) {
  const std::vector<std::string> names = structure.SideNames();
  std::vector<int> pixels(names.size() + 1, 0);
  for (const std::uint8_t label : labels) ++pixels[label];
  std::vector<int> usable;
  for (std::size_t label = 1; label < pixels.size(); ++label) {
    if (pixels[label] < kFewestSidePixels) continue;
    usable.push_back(static_cast<int>(label));
    sensor->sides.emplace_back(names[label - 1], pixels[label]);
  }
  std::stable_sort(sensor->sides.begin(), sensor->sides.end(),
                   [](const auto& a, const auto& b) { return a.second > b.second; });
  sensor->sides_fix_pose = SidesFixPose(structure, usable);
}

void AddTrial(const FrameResult& result, PlannedSensor* sensor) {
  if (result.status > sensor->status || sensor->finding.code == SensorCode::kNone) {
    sensor->status = std::max(sensor->status, result.status);
    sensor->finding = {result.code, result.reason, result.hint};
  }
  if (!result.structure_from_sensor) return;
  ++sensor->placed;
  sensor->covariance += result.covariance;
}

void FinishTrials(PlannedSensor* sensor) {
  if (sensor->placed == 0) return;
  sensor->covariance /= sensor->placed;
  const Eigen::Matrix3d position =
      PositionCovariance(sensor->structure_from_sensor, sensor->covariance);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(position);
  sensor->expected_m = std::sqrt(position.trace());
  sensor->expected_deg = std::sqrt(sensor->covariance.diagonal().tail<3>().sum()) / kDegree;
  sensor->weakest = solver.eigenvectors().col(2);
  sensor->weakest_m = std::sqrt(std::max(solver.eigenvalues()[2], 0.0));
}

}  // namespace

RigPlan PlanRig(const Rig& rig, int trials, CalibrateOptions options, const CountDone& count) {
  RequireInputFile("structure", rig.structure);
  RequireInputFile("intrinsics", rig.intrinsics);
  RigPlan plan;
  plan.structure = ReadStructure(rig.structure);
  plan.trials = trials;
  plan.sensors = SensorsOf(rig, plan.structure);
  options.initial.method = PoseMethod::kNetwork;
  for (int trial = 0; trial < trials; ++trial) {
    if (count) count(trial, trials);
    std::vector<PlannedFrame> planned;
    std::vector<SensorFrame> frames;
    for (std::size_t i = 0; i < plan.sensors.size(); ++i) {
      SensorFrame frame;
      frame.name = plan.sensors[i].name;
      frame.sensor = plan.sensors[i].sensor;
      frame.intrinsics = plan.sensors[i].intrinsics;
      frame.ground_truth = plan.sensors[i].structure_from_sensor;
      frame.quarter_turns = UprightTurns(*frame.ground_truth);
      planned.push_back(MeasurePlanned(std::move(frame), plan.structure,
                                       rig.seed + static_cast<std::uint64_t>(trial), i));
      frames.push_back(planned.back().frame);
    }
    TrueLabels labels(planned);
    const CalibrationResult result = Calibrate(frames, plan.structure, labels, options);
    for (std::size_t i = 0; i < plan.sensors.size(); ++i) {
      if (trial == 0) CountSides(planned[i].labels, plan.structure, &plan.sensors[i]);
      AddTrial(result.sensors[i], &plan.sensors[i]);
    }
    if (trial == 0) plan.pairs = result.pairs;
  }
  for (PlannedSensor& sensor : plan.sensors) {
    FinishTrials(&sensor);
    sensor.in_view = ShareInView(sensor, plan.structure);
  }
  return plan;
}

}  // namespace volalign
