// Rigs in which no floor tells up from down.

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <string>
#include <vector>

#include "infer/calibrate.h"
#include "infer/pose/aliases.h"
#include "tests/infer/synthetic.h"

namespace volalign {
namespace {

using testing_infer::CalibrateRig;
using testing_infer::Certain;
using testing_infer::PaperStructure;
using testing_infer::Rig;
using testing_infer::RingPose;
using testing_infer::StoredSegmenter;

/// Labels that a network gives that takes the structure for one that stands upside down.
LabelImage UpsideDownLabels(const Rig& rig, std::size_t i) {
  const Pose motion = FindAliases(rig.structure).front().motion;
  LabelImage labels = CastView(rig.structure, ComputeRays(rig.frames[i].intrinsics),
                               motion * *rig.frames[i].ground_truth)
                          .labels;
  for (std::size_t k = 0; k < labels.size(); ++k) {
    if (rig.labels[i][k] == 0) labels[k] = 0;
  }
  return labels;
}

void Dump(const Rig& rig, const std::string& folder) {
  std::ofstream json(folder + "/capture.json");
  json << "{\"format\":\"volalign.capture/1\",\"depth_scale\":0.001,\"sensors\":[";
  for (std::size_t i = 0; i < rig.frames.size(); ++i) {
    const auto& f = rig.frames[i];
    std::ofstream pgm(folder + "/" + f.name + ".pgm");
    pgm << "P2\n" << f.depth.width() << " " << f.depth.height() << "\n65535\n";
    for (float z : f.depth) pgm << std::lround(z * 1000) << "\n";
    json << (i ? "," : "") << "{\"name\":\"" << f.name << "\",\"depth\":\"" << f.name << ".pgm\",\"intrinsics\":{\"width\":" << f.intrinsics.width
         << ",\"height\":" << f.intrinsics.height << ",\"fx\":" << f.intrinsics.fx << ",\"fy\":" << f.intrinsics.fy << ",\"cx\":" << f.intrinsics.cx << ",\"cy\":" << f.intrinsics.cy << ",\"distortion\":[]}}";
  }
  json << "],\"ground_truth\":{";
  for (std::size_t i = 0; i < rig.frames.size(); ++i) {
    json << (i ? "," : "") << "\"" << rig.frames[i].name << "\":[";
    for (int r = 0; r < 4; ++r) {
      json << (r ? ",[" : "[");
      for (int c = 0; c < 4; ++c) json << (c ? "," : "") << rig.frames[i].ground_truth->matrix()(r, c);
      json << "]";
    }
    json << "]";
  }
  json << "}}\n";
}

TEST(Up, Dump) {
  for (int k = 0; k < 4; ++k) {
    Rig rig{PaperStructure(), {}, {}};
    for (int i = 0; i < 6; ++i)
      rig.Add("S" + std::to_string(i), RingPose(20 + 60.0 * i + 7 * k, 1.9 + 0.1 * (i % 3), 0.2 + 0.1 * (i % 4)), {false, k % 2 ? 3.5 : 0.0});
    const std::string folder = "/tmp/views/up" + std::to_string(k);
    (void)!system(("mkdir -p " + folder).c_str());
    Dump(rig, folder);
  }
}

TEST(Up, TwoOfSix) {
  for (const double wall : {0.0, 3.5}) {
    for (int k = 0; k < 3; ++k) {
      Rig rig{PaperStructure(), {}, {}};
      for (int i = 0; i < 6; ++i) {
        rig.Add("S" + std::to_string(i), RingPose(20 + 60.0 * i + 17 * k, 1.9 + 0.1 * (i % 3), 0.2 + 0.1 * (i % 4)), {false, wall});
        rig.frames.back().quarter_turns = kAutoTurns;
      }
      StoredSegmenter segmenter;
      if (wall > 0) {
        for (std::size_t i = 0; i < 6; ++i) {
          SensorFrame& frame = rig.frames[i];
          const SensorView view = MakeSensorView(frame.depth, frame.intrinsics);
          for (int v = 0; v < view.height(); ++v) {
            for (int u = 0; u < view.width(); ++u) {
              const Eigen::Vector3d p = *frame.ground_truth * view.Point(u, v);
              if (rig.labels[i](u, v) == 0 && std::abs(p.y()) > 0.6) frame.depth(u, v) = 0;
            }
          }
        }
      }
      for (std::size_t i = 0; i < 6; ++i)
        segmenter.Store(rig.frames[i].depth, Certain(i % 3 == 1 ? UpsideDownLabels(rig, i) : rig.labels[i]));
      const CalibrationResult result = Calibrate(rig.frames, rig.structure, segmenter);
      for (const SensorResult& s : result.sensors)
        std::printf("wall %.1f k %d %s: %s %s | %s | err %.1f mm %.2f deg turns %d\n", wall, k, s.name.c_str(), ToString(s.status), ToString(s.code), s.reason.c_str(),
          s.error ? 1000 * s.error->translation_m : -1, s.error ? s.error->rotation_deg : -1, s.quarter_turns);
      for (auto& [n, t] : result.timings_s) std::printf("%s %.2f ", n.c_str(), t);
      std::printf("\n");
    }
  }
}

}  // namespace
}  // namespace volalign
