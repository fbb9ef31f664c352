#pragma once

// Frames whose answer is known in closed form: the structure by core's ray casting, a floor and
// walls by ray against plane.

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "core/base/random.h"
#include "core/geometry/camera.h"
#include "core/geometry/lens.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "core/geometry/visibility.h"
#include "infer/view/segmenter.h"
#include "infer/view/sensor_frame.h"
#include "tests/core/base/pixels.h"

namespace volalign::testing_infer {

inline Structure PaperStructure() { return ReadStructure("configs/structure.yaml"); }

/// 0 where no side has the name.
inline int LabelOf(const Structure& structure, const std::string& name) {
  const std::vector<std::string> names = structure.SideNames();
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (names[i] == name) return static_cast<int>(i) + 1;
  }
  return 0;
}

inline std::vector<int> LabelsOf(const Structure& structure,
                                 const std::vector<std::string>& names) {
  std::vector<int> labels;
  for (const std::string& name : names) labels.push_back(LabelOf(structure, name));
  return labels;
}

inline Intrinsics Kinect() { return {320, 288, 252.2, 252.2, 163.9, 168.2, {}}; }

/// 20x10 pixels of 25 mm at 1 m, the axis between the middle ones: for pixels counted by hand.
inline Intrinsics Coarse() { return {20, 10, 40, 40, 9.5, 4.5, {}}; }

inline Pose MakePose(const Eigen::Vector3d& rotation_vector, const Eigen::Vector3d& translation) {
  Pose pose = Pose::Identity();
  pose.linear() = RotationExp(rotation_vector);
  pose.translation() = translation;
  return pose;
}

/// A sensor mounted on its side, looking at a point near the structure's middle. Angles in degrees,
/// metres.
inline Pose RingPose(double phi_deg, double rho = 2.0, double y = 0.4, double roll_deg = 90,
                     const Eigen::Vector3d& look_at = Eigen::Vector3d(-0.1, 0, 0)) {
  const double phi = phi_deg * M_PI / 180;
  return LookAt(Eigen::Vector3d(rho * std::cos(phi), y, rho * std::sin(phi)), look_at,
                roll_deg * M_PI / 180);
}

/// Ray (x/z, y/z) of a point of the picture through the lens, whose model is compared with OpenCV's
/// in camera_test. NaN where Newton's method does not converge.
inline Eigen::Vector2d RayThroughLens(const Intrinsics& k, double u, double v) {
  const Eigen::Vector2d seen((u - k.cx) / k.fx, (v - k.cy) / k.fy);
  Eigen::Vector2d ray = seen;
  for (int step = 0; step < 50; ++step) {
    const BentRay lens = BendRay(k, ray);
    if ((lens.bent - seen).norm() < 1e-12) return ray;
    ray -= lens.by_ray.inverse() * (lens.bent - seen);
  }
  return Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
}

/// An Azure Kinect with its lens: the factory calibration in issue 1518 of Microsoft's
/// Azure-Kinect-Sensor-SDK, for the 320x288 picture.
inline Intrinsics KinectWithLens() {
  Intrinsics intrinsics = Kinect();
  intrinsics.fx = intrinsics.fy = 252.3;
  intrinsics.distortion = {0.92185, 0.50040, 0, 0, 0.02836, 1.25842, 0.75181, 0.14419};
  return intrinsics;
}

struct Scene {
  bool floor = true;
  double wall = 0;  ///< walls at |x| = |z| = wall where positive
  /// Where the structure stands in the room.
  Pose room_from_structure = Pose::Identity();
};

struct SyntheticView {
  DepthImage depth;
  LabelImage labels;
};

/// Lens and all, where the intrinsics have one.
inline SyntheticView Render(const Structure& structure, const Intrinsics& intrinsics,
                            const Pose& pose, const Scene& scene = {}) {
  const RayTable rays = ComputeRays(intrinsics);
  ExpectedView view = CastView(structure, rays, pose);
  const Eigen::Vector3d origin = pose.translation();
  const Eigen::Vector3d in_room = scene.room_from_structure * origin;
  for (const auto [u, v] : Pixels(intrinsics.width, intrinsics.height)) {
    if (view.depth(u, v) > 0 || !rays.at(u, v).allFinite()) continue;
    const Eigen::Vector3d direction =
        pose.linear() * Eigen::Vector3d(rays.at(u, v).x(), rays.at(u, v).y(), 1);
    double nearest = 1e9;
    if (scene.floor && direction.y() < 0) {
      nearest = (structure.FloorHeight() - origin.y()) / direction.y();
    }
    const Eigen::Vector3d to = scene.room_from_structure.linear() * direction;
    for (const int axis : {0, 2}) {
      if (scene.wall <= 0 || to[axis] == 0) continue;
      const double t = (std::copysign(scene.wall, to[axis]) - in_room[axis]) / to[axis];
      nearest = std::min(nearest, t);
    }
    if (nearest < 15) view.depth(u, v) = static_cast<float>(nearest);
  }
  return {std::move(view.depth), std::move(view.labels)};
}

inline SegmentationResult Certain(const LabelImage& labels) {
  return {labels, Image<float>(labels.width(), labels.height(), 1.0f)};
}

/// Answers with the labels that were stored for a depth map, whatever the turn.
class StoredSegmenter : public Segmenter {
 public:
  using Segmenter::Segment;
  void Store(const DepthImage& depth, SegmentationResult result) {
    stored_.emplace_back(depth, std::move(result));
  }
  std::vector<SegmentationResult> Segment(
      const std::vector<SegmentationRequest>& requests) override {
    std::vector<SegmentationResult> results;
    for (const SegmentationRequest& request : requests) {
      const auto found = std::find_if(stored_.begin(), stored_.end(), [&](const auto& item) {
        return item.first == *request.depth;
      });
      results.push_back(found != stored_.end()
                            ? found->second
                            : Certain(LabelImage(request.depth->width(), request.depth->height())));
    }
    return results;
  }

 private:
  std::vector<std::pair<DepthImage, SegmentationResult>> stored_;
};

/// A capture with its labels. The segmenter's answers may be changed before calibration.
struct Rig {
  Structure structure;
  std::vector<SensorFrame> frames;
  std::vector<LabelImage> labels;

  SensorFrame& Add(const std::string& name, const Pose& pose, const Scene& scene = {},
                   const Intrinsics& intrinsics = Kinect()) {
    SyntheticView view = Render(structure, intrinsics, pose, scene);
    SensorFrame frame;
    frame.name = name;
    frame.depth = std::move(view.depth);
    frame.intrinsics = intrinsics;
    frame.quarter_turns = 1;
    frame.ground_truth = pose;
    frames.push_back(std::move(frame));
    labels.push_back(std::move(view.labels));
    return frames.back();
  }
  /// Of the name S0, S1 and so on.
  SensorFrame& Add(const Pose& pose, const Scene& scene = {},
                   const Intrinsics& intrinsics = Kinect()) {
    return Add("S" + std::to_string(frames.size()), pose, scene, intrinsics);
  }

  StoredSegmenter PerfectSegmenter() const {
    StoredSegmenter segmenter;
    for (std::size_t i = 0; i < frames.size(); ++i)
      segmenter.Store(frames[i].depth, Certain(labels[i]));
    return segmenter;
  }
};

inline Rig RingOfEight(const Scene& scene = {}) {
  Rig rig{PaperStructure(), {}, {}};
  for (int i = 0; i < 8; ++i) rig.Add(RingPose(45.0 * i, 2.0, 0.3 + 0.05 * (i % 3)), scene);
  return rig;
}

/// Keeps the labels of sides for which `keep` is true.
template <class Keep>
void Restrict(const Structure& structure, LabelImage* labels, Keep keep) {
  for (std::uint8_t& label : *labels) {
    if (label && !keep(structure.SideOfLabel(label))) label = 0;
  }
}

/// Three sensors round the structure in a room.
inline Rig ThreeSensors() {
  Rig rig{PaperStructure(), {}, {}};
  for (int i = 0; i < 3; ++i) rig.Add(RingPose(25.0 + 110 * i), {true, 3.5});
  return rig;
}

/// Takes depth and labels away beside depth edges, as sensors do: between two neighbouring pixels
/// of which one is over 10 cm nearer, or alone has depth, `least` to `most` pixels along that row
/// or column. Where both have depth, any part of them may belong to the nearer surface.
inline void LeaveGaps(DepthImage* depth, LabelImage* labels, int least, int most,
                      std::uint64_t seed) {
  constexpr float kJump = 0.1f;
  const DepthImage before = *depth;
  RandomStream random(seed, 0, "gaps");
  const auto erase = [&](int u, int v, int du, int dv, int count) {
    for (int k = 0; k < count && depth->Contains(u, v); ++k, u += du, v += dv) {
      (*depth)(u, v) = 0;
      (*labels)(u, v) = 0;
    }
  };
  for (const auto [u, v] : Pixels(before)) {
    for (int axis = 0; axis < 2; ++axis) {
      for (const int sign : {-1, 1}) {
        const int du = axis == 0 ? sign : 0, dv = axis == 0 ? 0 : sign;
        if (!before.Contains(u + du, v + dv) || !(before(u, v) > 0)) continue;
        const float other = before(u + du, v + dv);
        if (other > 0 && other < before(u, v) + kJump) continue;
        const int gap = least + random.Below(most - least + 1);
        const int near = other > 0 ? random.Below(gap + 1) : gap;
        erase(u, v, -du, -dv, near);
        erase(u + du, v + dv, du, dv, gap - near);
      }
    }
  }
}

/// A frame as an SDK delivers it that shows pictures as in a mirror: rows run the other way, and
/// the intrinsics say nothing of it. Labels are those of a network that knows the structure: what
/// it sees is a stack whose left and right sides have changed places.
inline void FlipFrame(const Structure& structure, SensorFrame* frame, LabelImage* labels) {
  const auto flip = [](auto* image) {
    for (const auto [u, v] : Pixels(image->width() / 2, image->height()))
      std::swap((*image)(u, v), (*image)(image->width() - 1 - u, v));
  };
  flip(&frame->depth);
  flip(labels);
  const auto other = [](const std::string& name) {
    const std::size_t slash = name.find('/') + 1;
    const std::string side = name.substr(slash);
    return name.substr(0, slash) + (side == "left" ? "right" : side == "right" ? "left" : side);
  };
  std::vector<std::uint8_t> renamed{0};
  for (const std::string& name : structure.SideNames())
    renamed.push_back(static_cast<std::uint8_t>(LabelOf(structure, other(name))));
  for (std::uint8_t& label : *labels) label = renamed[label];
}

/// Gaussian noise with a standard deviation of `sigma_at_2m` * (z / 2)^2, m.
inline void AddNoise(DepthImage* depth, double sigma_at_2m, std::uint64_t seed) {
  RandomStream random(seed, 0, "noise");
  for (float& z : *depth) {
    if (z > 0) z += static_cast<float>(random.Normal() * sigma_at_2m * z * z / 4);
  }
}

/// Sensors that look from all sides at six equal cartons in a row along x, alike from the front and
/// from behind, in a square room with a cupboard and a bench.
inline Rig RowInARoom(double azimuth, int sensors = 2) {
  std::vector<Box> row;
  for (int i = 0; i < 6; ++i)
    row.push_back(Box::FromMinMax("b" + std::to_string(i), {-0.9 + 0.3 * i, 0, -0.2},
                                  {-0.6 + 0.3 * i, 0.4, 0.2}));
  std::vector<Box> room = row;
  room.push_back(Box::FromMinMax("cupboard", {1.2, 0, -2.4}, {2.0, 1.8, -1.9}));
  room.push_back(Box::FromMinMax("bench", {-2.3, 0, 0.8}, {-1.5, 0.5, 1.8}));
  Rig rig{Structure::FromBoxes("room", room), {}, {}};
  for (int i = 0; i < sensors; ++i) {
    rig.Add(RingPose(azimuth + 360.0 / sensors * i, 1.9, 0.9, 90, {0, 0.2, 0}), {true, 2.5});
    AddNoise(&rig.frames.back().depth, 0.004, static_cast<std::uint64_t>(i));
    rig.frames.back().quarter_turns = kAutoTurns;
  }
  rig.structure = Structure::FromBoxes("row", row);
  return rig;
}

/// Errors as depth sensors have them beside white noise: smooth, with a standard deviation of
/// `sigma` m and correlated over about `length` pixels. A sum of Gaussian bumps at random places.
inline void AddSmoothError(DepthImage* depth, double sigma, double length, std::uint64_t seed) {
  RandomStream random(seed, 0, "smooth error");
  const int width = depth->width(), height = depth->height();
  Image<float> field(width, height, 0.0f);
  const int bumps = static_cast<int>(12 * width * height / (length * length));
  const int reach = static_cast<int>(3 * length);
  for (int k = 0; k < bumps; ++k) {
    const double x = random.Uniform(-length, width + length);
    const double y = random.Uniform(-length, height + length);
    const double size = random.Normal();
    for (int v = std::max(0, static_cast<int>(y) - reach);
         v < std::min(height, static_cast<int>(y) + reach); ++v) {
      for (int u = std::max(0, static_cast<int>(x) - reach);
           u < std::min(width, static_cast<int>(x) + reach); ++u) {
        const double d2 = (u - x) * (u - x) + (v - y) * (v - y);
        field(u, v) += static_cast<float>(size * std::exp(-d2 / (length * length)));
      }
    }
  }
  double squares = 0;
  for (const float e : field) squares += static_cast<double>(e) * e;
  const double scale = sigma / std::sqrt(squares / static_cast<double>(field.size()));
  for (std::size_t i = 0; i < field.size(); ++i) {
    if ((*depth)[i] > 0) (*depth)[i] += static_cast<float>(scale * field[i]);
  }
}

}  // namespace volalign::testing_infer
