// Calibrates rigs that `render` did not make: frames by the analytic ray-caster of the tests, with
// perfect labels and errors that share nothing with the sensor models of the renderer. What the
// refinement gets wrong here is not what it was tuned to.
//
//   raycast_rigs [KEY=VALUE ...]
//
// seeds=3000:3004   one rig of 6 or 7 sensors each, half Kinects, half stereo cameras
// estimate=none,auto  what is estimated beside the poses, one row of the table each; + joins words:
// size+boxes white_mm=0.5:2 warp_mm=0.5:2 warp_px=3:8   range of one sensor's errors at 2 m; both
// grow with the square of the distance gap=4             most pixels lost at a depth edge
// gap_share=0.5:0.5 share of them that the nearer surface loses, range over sensors
// dropout=0.05      share of the pixels that are lost elsewhere
// boxes_mm=0 yaw_deg=0 size_percent=0   how the stack differs from its description, standard
// deviations verbose=0         1: a line for each sensor
//
// A row: errors of the refined poses, of the heights alone, estimated sizes, how many sensors keep
// their initial pose, and shares of errors within the 68 % and 95 % intervals, pooled and by
// component (x y z, about x y z). The row "points to boxes" is a yardstick: each sensor alone, all
// points near the true boxes brought onto them by a robust fit from the true pose.

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <cstdlib>
#include <map>
#include <string>
#include <vector>

#include "core/base/statistics.h"
#include "core/base/text.h"
#include "infer/calib/calibrate.h"
#include "infer/calib/result.h"
#include "tests/infer/view/synthetic.h"

namespace volalign {
namespace {

using namespace testing_infer;  // NOLINT(google-build-using-namespace): its analytic frames

struct Range {
  double low, high;
  double Draw(RandomStream& random) const { return random.Uniform(low, high); }
};

struct Options {
  std::map<std::string, std::string> values = {
      {"seeds", "3000:3004"},   {"estimate", "none,auto"}, {"white_mm", "0.5:2"},
      {"warp_mm", "0.5:2"},     {"warp_px", "3:8"},        {"gap", "4"},
      {"gap_share", "0.5:0.5"}, {"dropout", "0.05"},       {"boxes_mm", "0"},
      {"yaw_deg", "0"},         {"size_percent", "0"},     {"verbose", "0"}};

  double Number(const std::string& key) const { return std::atof(values.at(key).c_str()); }
  Range Pair(const std::string& key) const {
    const std::string& text = values.at(key);
    const std::size_t colon = text.find(':');
    return {std::atof(text.c_str()),
            std::atof(text.c_str() + (colon == std::string::npos ? 0 : colon + 1))};
  }
};

Intrinsics Stereo() {
  Intrinsics intrinsics;
  intrinsics.width = 320;
  intrinsics.height = 180;
  intrinsics.fx = intrinsics.fy = 235.7;
  intrinsics.cx = 160.3;
  intrinsics.cy = 89.1;
  return intrinsics;
}

/// Pixels that a depth edge costs: runs of up to `most`, of which the nearer surface loses `share`.
void LoseEdges(DepthImage* depth, int most, double share, RandomStream& random) {
  const DepthImage whole = *depth;
  const auto lose = [&](int u, int v, int du, int dv) {
    const int x = u + du, y = v + dv;
    if (!whole.Contains(x, y) || !(whole(u, v) > 0) || !(whole(x, y) > 0)) return;
    if (std::abs(whole(u, v) - whole(x, y)) < 0.05 + 0.02 * whole(u, v)) return;
    const bool first_is_near = whole(u, v) < whole(x, y);
    const int lost = random.Below(most + 1);
    int near = 0;
    for (int k = 0; k < lost; ++k) near += random.Chance(share);
    const int first = first_is_near ? near : lost - near;
    for (int k = 0; k < first; ++k) {
      if (whole.Contains(u - k * du, v - k * dv)) (*depth)(u - k * du, v - k * dv) = 0;
    }
    for (int k = 0; k < lost - first; ++k) {
      if (whole.Contains(x + k * du, y + k * dv)) (*depth)(x + k * du, y + k * dv) = 0;
    }
  };
  for (int v = 0; v < whole.height(); ++v) {
    for (int u = 0; u < whole.width(); ++u) {
      lose(u, v, 1, 0);
      lose(u, v, 0, 1);
    }
  }
}

void Measure(const Options& options, std::uint64_t seed, std::uint64_t index, DepthImage* depth) {
  RandomStream random(seed, index, "measure");
  const double white = 1e-3 * options.Pair("white_mm").Draw(random);
  const double warp = 1e-3 * options.Pair("warp_mm").Draw(random);
  const double length = options.Pair("warp_px").Draw(random);
  const double share = options.Pair("gap_share").Draw(random);
  const double dropout = options.Number("dropout");
  DepthImage error(depth->width(), depth->height(), 1.0f);
  if (warp > 0) {
    AddSmoothError(&error, warp, length, seed * 100 + index);
  }
  LoseEdges(depth, static_cast<int>(options.Number("gap")), share, random);
  for (std::size_t k = 0; k < depth->size(); ++k) {
    float& z = (*depth)[k];
    const double growth = static_cast<double>(z) * z / 4;
    z += static_cast<float>(growth * (error[k] - 1 + white * random.Normal()));
    if (random.Chance(dropout)) z = 0;
  }
}

Structure BuiltStructure(const Structure& nominal, const Options& options, std::uint64_t seed) {
  RandomStream random(seed, 0, "build");
  const double size = 1 + options.Number("size_percent") / 100 * random.Normal();
  std::vector<Pose> offsets;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Box& box : nominal.boxes()) {
    const Eigen::Vector3d centre = box.structure_from_box.translation();
    Pose offset = Pose::Identity();
    offset.linear() = RotationExp({0, random.Normal() * options.Number("yaw_deg") * M_PI / 180, 0});
    const double sigma = 1e-3 * options.Number("boxes_mm");
    const Eigen::Vector3d shift(random.Normal() * sigma,
                                (size - 1) * (centre.y() - nominal.FloorHeight()),
                                random.Normal() * sigma);
    offset.translation() = centre - offset.linear() * centre + shift;
    mean += Eigen::Vector3d(shift.x(), 0, shift.z()) / static_cast<double>(nominal.boxes().size());
    offsets.push_back(offset);
  }
  for (Pose& offset : offsets) offset.translation() -= mean;
  return nominal.Displaced(offsets, size);
}

Rig MakeRig(const Options& options, std::uint64_t seed) {
  RandomStream random(seed, 0, "rig");
  Rig rig{BuiltStructure(PaperStructure(), options, seed), {}, {}};
  const int count = 6 + random.Below(2);
  const double turn = random.Uniform(0, 360), wall = random.Uniform(2.8, 4.0);
  for (int i = 0; i < count; ++i) {
    const double phi = turn + 360.0 * i / count + random.Uniform(-15, 15);
    const Eigen::Vector3d look_at(random.Uniform(-0.1, 0.1), random.Uniform(-0.1, 0.1),
                                  random.Uniform(-0.1, 0.1));
    const Pose pose =
        RingPose(phi, random.Uniform(1.65, 2.35), random.Uniform(0.0, 0.7), 90, look_at);
    rig.Add("S" + std::to_string(i), pose, {true, wall}, i % 2 ? Stereo() : Kinect());
    Measure(options, seed, static_cast<std::uint64_t>(i), &rig.frames.back().depth);
    LabelImage& labels = rig.labels.back();
    for (std::size_t k = 0; k < labels.size(); ++k) {
      if (!(rig.frames.back().depth[k] > 0)) labels[k] = 0;
    }
  }
  return rig;
}

/// The yardstick: see the top.
Pose PointsToBoxes(const SensorFrame& frame, const Structure& structure) {
  constexpr double kNear = 0.04, kScale = 0.003;
  const SensorView view = MakeSensorView(frame.depth, frame.intrinsics);
  Pose pose = *frame.ground_truth;
  for (int iteration = 0; iteration < 8; ++iteration) {
    Matrix6d h = Matrix6d::Identity() * 1e-9;
    Vector6d g = Vector6d::Zero();
    for (int v = 0; v < view.height(); ++v) {
      for (int u = v % 2; u < view.width(); u += 2) {
        if (!(view.depth(u, v) > 0)) continue;
        const Eigen::Vector3d p = pose * view.Point(u, v);
        const SurfaceDistance nearest = DistanceToSurface(structure, p);
        if (nearest.side < 0 || nearest.distance > kNear) continue;
        const Side& side = structure.sides()[static_cast<std::size_t>(nearest.side)];
        const double r = side.normal.dot(p - side.centre);
        if (nearest.distance - std::abs(r) > 1e-6) continue;  // beyond the side's end
        const double weight = 1 / (1 + r * r / (kScale * kScale));
        Vector6d j;
        j << side.normal, p.cross(side.normal);
        h += weight * j * j.transpose();
        g += weight * r * j;
      }
    }
    pose = PerturbLeft(-h.ldlt().solve(g), pose);
  }
  return pose;
}

struct Row {
  std::vector<double> mm, deg, own_mm, height_mm, height_in_sigmas, sizes, in_sigmas[6], box_mm,
      shifts;
  int weak = 0;
};

double Mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value / static_cast<double>(values.size());
  return sum;
}
double ShareWithin(const std::vector<double>& values, double limit) {
  double count = 0;
  for (const double value : values) count += std::abs(value) <= limit;
  return 100 * count / static_cast<double>(values.size());
}

void Count(const Rig& rig, const CalibrationResult& result, bool verbose, Row* row) {
  for (std::size_t i = 0; i < rig.frames.size(); ++i) {
    const FrameResult& sensor = result.sensors[i];
    if (!sensor.structure_from_sensor) {
      fmt::print("    {} {}: {}\n", sensor.name, ToString(sensor.code), sensor.reason);
      continue;
    }
    const Pose& truth = *rig.frames[i].ground_truth;
    const PoseError error = ComparePoses(*sensor.structure_from_sensor, truth);
    row->mm.push_back(1000 * error.translation_m);
    row->deg.push_back(error.rotation_deg);
    const double height = sensor.structure_from_sensor->translation().y() - truth.translation().y();
    row->height_mm.push_back(1000 * height);
    const Pose apart = truth * sensor.structure_from_sensor->inverse();
    Vector6d delta;
    delta << apart.translation(), RotationLog(apart.linear());
    for (int k = 0; k < 6; ++k)
      row->in_sigmas[k].push_back(delta[k] / std::sqrt(sensor.covariance(k, k)));
    row->weak += sensor.status != SensorStatus::kOk;
    if (verbose) {
      fmt::print("    {} {:5.2f} mm {:.3f} deg  height {:5.2f} mm  offset {:5.2f} mm gain {:.4f}\n",
                 sensor.name, 1000 * error.translation_m, error.rotation_deg, 1000 * height,
                 1000 * sensor.depth_offset_m, sensor.depth_gain);
    }
  }
  row->sizes.push_back(100 * (result.size_scale - 1));
  const std::vector<Box>& built = rig.structure.boxes();
  for (std::size_t b = 0; b < built.size(); ++b)
    row->box_mm.push_back(1000 * (result.built.boxes()[b].structure_from_box.translation() -
                                  built[b].structure_from_box.translation())
                                     .norm());
  if (verbose) {
    fmt::print("    size {:.4f} +- {:.4f} {}", result.size_scale, result.sigma_size_scale,
               result.size_estimated ? "estimated" : "held");
    for (const RefinedBox& box : result.boxes)
      fmt::print("  ({:.1f} {:.1f} {:.2f}{})", 1000 * box.x, 1000 * box.z, box.yaw * 180 / M_PI,
                 box.estimated ? "" : " held");
    fmt::print("\n");
  }
}

void Print(const std::string& name, const Row& row) {
  std::vector<double> all;
  for (const auto& component : row.in_sigmas)
    all.insert(all.end(), component.begin(), component.end());
  fmt::print(
      "{:28s} {:2d} sensors  {:5.2f} mm (95 %: {:5.2f}, mean {:5.2f})  {:.3f} deg  height {:5.2f} "
      "mm",
      name, row.mm.size(), Median(row.mm), Quantile(row.mm, 0.95), Mean(row.mm), Median(row.deg),
      Mean(row.height_mm));
  if (!all.empty()) {
    fmt::print(" {:5.2f} sigma  boxes {:.2f} mm  weak {}  68: {:.0f}% 95: {:.0f}% [",
               Mean(row.in_sigmas[1]), Mean(row.box_mm), row.weak, ShareWithin(all, 1),
               ShareWithin(all, 1.96));
    for (const auto& component : row.in_sigmas) fmt::print(" {:.0f}", ShareWithin(component, 1));
    fmt::print(" |");
    for (const auto& component : row.in_sigmas) fmt::print(" {:.0f}", ShareWithin(component, 1.96));
    fmt::print(" ] sizes");
    for (const double size : row.sizes) fmt::print(" {:.2f}", size);
  }
  fmt::print("\n");
}

int Main(int argc, char** argv) {
  Options options;
  for (int i = 1; i < argc; ++i) {
    const std::vector<std::string> parts = Split(argv[i], '=');
    if (parts.size() != 2 || options.values.count(parts[0]) == 0) {
      fmt::print(stderr, "{}: no such setting; the top of tests/bench/raycast_rigs.cc has them\n",
                 argv[i]);
      return 1;
    }
    options.values[parts[0]] = parts[1];
  }
  const bool verbose = options.Number("verbose") > 0;
  const Structure nominal = PaperStructure();
  std::vector<std::string> variants = Split(options.values["estimate"], ',');
  std::map<std::string, Row> rows;
  Row yardstick;
  const Range seeds = options.Pair("seeds");
  for (double seed = seeds.low; seed < seeds.high; ++seed) {
    Rig rig = MakeRig(options, static_cast<std::uint64_t>(seed));
    for (const SensorFrame& frame : rig.frames) {
      const Pose pose = PointsToBoxes(frame, rig.structure);
      const PoseError error = ComparePoses(pose, *frame.ground_truth);
      yardstick.mm.push_back(1000 * error.translation_m);
      yardstick.deg.push_back(error.rotation_deg);
      yardstick.height_mm.push_back(
          1000 * (pose.translation().y() - frame.ground_truth->translation().y()));
    }
    StoredSegmenter segmenter = rig.PerfectSegmenter();
    for (const std::string& variant : variants) {
      CalibrateOptions calibrate;
      calibrate.refine.estimate = variant;
      std::replace(calibrate.refine.estimate.begin(), calibrate.refine.estimate.end(), '+', ',');
      if (verbose) fmt::print("  seed {} {}\n", seed, variant);
      Count(rig, Calibrate(rig.frames, nominal, segmenter, calibrate), verbose, &rows[variant]);
    }
  }
  Print("points to boxes", yardstick);
  for (const std::string& variant : variants) Print(variant, rows[variant]);
  return 0;
}

}  // namespace
}  // namespace volalign

int main(int argc, char** argv) { return volalign::Main(argc, argv); }
