#pragma once

// Frames whose answer is known in closed form: the structure by core's ray casting, a floor and
// walls by ray against plane.

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "core/camera.h"
#include "core/pose.h"
#include "core/random.h"
#include "core/structure.h"
#include "core/visibility.h"
#include "infer/io/capture.h"
#include "infer/view/camera_rays.h"
#include "infer/view/segmenter.h"

namespace volalign::testing_infer {

inline Structure PaperStructure() { return ReadStructureYaml("configs/structure.yaml"); }

/// 0 where no side has the name.
inline int LabelOf(const Structure& structure, const std::string& name) {
  const std::vector<std::string> names = structure.SideNames();
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (names[i] == name) return static_cast<int>(i) + 1;
  }
  return 0;
}

inline Intrinsics Kinect() {
  Intrinsics intrinsics;
  intrinsics.width = 320;
  intrinsics.height = 288;
  intrinsics.fx = intrinsics.fy = 252.2;
  intrinsics.cx = 163.9;
  intrinsics.cy = 168.2;
  return intrinsics;
}

/// 20x10 pixels of 25 mm at 1 m, the axis between the middle ones: for pixels counted by hand.
inline Intrinsics Coarse() {
  Intrinsics intrinsics;
  intrinsics.width = 20;
  intrinsics.height = 10;
  intrinsics.fx = intrinsics.fy = 40;
  intrinsics.cx = 9.5;
  intrinsics.cy = 4.5;
  return intrinsics;
}

/// A sensor mounted on its side, looking at a point near the structure's middle. Angles in degrees,
/// metres.
inline Pose RingPose(double phi_deg, double rho = 2.0, double y = 0.4, double roll_deg = 90,
                     const Eigen::Vector3d& look_at = Eigen::Vector3d(-0.1, 0, 0)) {
  const double phi = phi_deg * M_PI / 180;
  return LookAt(Eigen::Vector3d(rho * std::cos(phi), y, rho * std::sin(phi)), look_at,
                roll_deg * M_PI / 180);
}

struct Scene {
  bool floor = true;
  double wall = 0;  ///< walls at |x| = |z| = wall where positive
};

struct SyntheticView {
  DepthImage depth;
  LabelImage labels;
};

inline SyntheticView Render(const Structure& structure, const Intrinsics& intrinsics,
                            const Pose& pose, const Scene& scene = {}) {
  const RayTable rays = ComputeRays(intrinsics);
  StructureView view = CastView(structure, rays, pose);
  const Eigen::Vector3d origin = pose.translation();
  for (int v = 0; v < intrinsics.height; ++v) {
    for (int u = 0; u < intrinsics.width; ++u) {
      if (view.depth(u, v) > 0) continue;
      const Eigen::Vector3d direction =
          pose.linear() * Eigen::Vector3d(rays.at(u, v).x(), rays.at(u, v).y(), 1);
      double nearest = 1e9;
      if (scene.floor && direction.y() < 0) {
        nearest = (structure.FloorHeight() - origin.y()) / direction.y();
      }
      for (const int axis : {0, 2}) {
        if (scene.wall <= 0 || direction[axis] == 0) continue;
        const double t =
            (std::copysign(scene.wall, direction[axis]) - origin[axis]) / direction[axis];
        nearest = std::min(nearest, t);
      }
      if (nearest < 15) view.depth(u, v) = static_cast<float>(nearest);
    }
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

  void Add(const std::string& name, const Pose& pose, const Scene& scene = {},
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
  for (int i = 0; i < 8; ++i)
    rig.Add("S" + std::to_string(i), RingPose(45.0 * i, 2.0, 0.3 + 0.05 * (i % 3)), scene);
  return rig;
}

/// Gaussian noise with a standard deviation of `sigma_at_2m` * (z / 2)^2, m.
inline void AddNoise(DepthImage* depth, double sigma_at_2m, std::uint64_t seed) {
  RandomStream random(seed, 0, "noise");
  for (float& z : *depth) {
    if (z > 0) z += static_cast<float>(random.Normal() * sigma_at_2m * z * z / 4);
  }
}

}  // namespace volalign::testing_infer
