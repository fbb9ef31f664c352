// What `volalign check` finds: a rendered rig is calibrated, one of its sensors is moved, the stack
// is built up elsewhere, and the rig is calibrated again. Devices keep their errors.
//
//   moved_sensors [seeds=3000:3010] [mm=5,10,15,20,30] [deg=0.2,0.4,0.6,1.2]
//
// mm and deg: movements to try, each of one of the eight Azure Kinects of configs/rig_ring8.yaml.
// The stack stands anywhere within 0.5 m of where it stood, its boxes 3 mm off their places.
// A row: of how many moved sensors that both calibrations place and call ok the movement was found,
// and how many of all others were accused. Sensor and direction are drawn from the seed.

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <string>
#include <vector>

#include "core/base/random.h"
#include "core/nn/cpu/torch_threads.h"
#include "infer/calib/calibrate.h"
#include "infer/evaluate/items.h"
#include "infer/rigcheck/movement.h"
#include "infer/segment/load.h"
#include "render/egl/egl_context.h"
#include "render/egl/gl_depth_renderer.h"

namespace volalign {
namespace {

using Values = std::map<std::string, std::string>;

std::vector<double> Numbers(const std::string& text) {
  std::vector<double> numbers;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t comma = std::min(text.find(',', begin), text.size());
    numbers.push_back(std::atof(text.substr(begin, comma - begin).c_str()));
    begin = comma + 1;
  }
  return numbers;
}

struct Trial {
  std::string label;
  double mm = 0, deg = 0;
  int moved = 0, found = 0, others = 0, accused = 0, undecided = 0;
};

Rig ReadRigOf(std::uint64_t seed) {
  ConfigSource source = ConfigSource::FromFile("configs/rig_ring8.yaml");
  source.Set("assembly.position_mm=3");
  Rig rig = ReadRig(source);
  rig.seed = seed;
  TurnStructure(137.50776405003785 * static_cast<double>(seed), &rig);
  for (RigSensor& sensor : rig.sensors) {
    sensor.sensor = "azure_kinect_nfov_binned";
    sensor.image_size.clear();
  }
  rig.placements = DrawPlacements(rig, 1, 0.5);
  return rig;
}

struct Placed {
  std::vector<SensorEstimate> standing;
  std::vector<std::string> ok;
};

Placed Place(const RigCapture& rendered, Segmenter& segmenter) {
  const EvaluationCapture capture = EvaluationCaptureOf(rendered);
  const CalibrationResult result = Calibrate(capture.frames, capture.structure, segmenter);
  Placed placed;
  for (const FrameResult& sensor : result.sensors) {
    if (!sensor.structure_from_sensor) continue;
    placed.standing.push_back({sensor.name, *sensor.structure_from_sensor, sensor.covariance});
    if (sensor.status == SensorStatus::kOk) placed.ok.push_back(sensor.name);
  }
  return placed;
}

bool Contains(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

void Count(const Placed& last, const Placed& now, const std::string& mover, Trial* trial) {
  const bool counts =
      trial->mm + trial->deg > 0 && Contains(last.ok, mover) && Contains(now.ok, mover);
  trial->moved += counts;
  for (const SensorMovement& sensor : FindMovements(last.standing, now.standing).sensors) {
    trial->undecided += sensor.movement == Movement::kUndecided;
    if (sensor.name == mover && trial->mm + trial->deg > 0) {
      trial->found += counts && sensor.movement == Movement::kMoved;
    } else {
      ++trial->others;
      trial->accused += sensor.movement == Movement::kMoved;
    }
  }
}

void Run(const Values& values) {
  std::vector<Trial> trials(1);
  trials[0].label = "nothing";
  for (const double mm : Numbers(values.at("mm")))
    trials.push_back({fmt::format("{} mm", mm), mm, 0});
  for (const double deg : Numbers(values.at("deg")))
    trials.push_back({fmt::format("{} deg", deg), 0, deg});
  SetTorchThreads(2);
  const auto segmenter = LoadNetworkSegmenter("models/m05-lite.safetensors");
  EglContext egl{EglContextOptions{}};
  GlDepthRenderer renderer;
  for (const std::uint64_t seed : ParseSeeds(values.at("seeds"))) {
    Rig rig = ReadRigOf(seed);
    // All that is tried is a further capture of the same rig: rooms and devices stay as they are.
    const RigPlacement elsewhere = rig.placements[0];
    rig.placements.assign(trials.size(), elsewhere);
    RandomStream random(seed, 0, "moved");
    const std::string mover =
        rig.sensors[static_cast<std::size_t>(random.Below(static_cast<int>(rig.sensors.size())))]
            .name;
    for (std::size_t k = 0; k < trials.size(); ++k) {
      const Eigen::Vector3d axis =
          Eigen::Vector3d(random.Normal(), random.Normal(), random.Normal()).normalized();
      RigMovement movement;
      movement.sensor = mover;
      for (std::size_t a = 0; a < 3; ++a) {
        movement.translation_mm[a] = trials[k].mm * axis[static_cast<Eigen::Index>(a)];
        movement.rotation_deg[a] = trials[k].deg * axis[static_cast<Eigen::Index>(a)];
      }
      rig.placements[k].moved.push_back(movement);
    }
    const std::vector<RigCapture> captures = RenderPlacements(rig, renderer);
    const Placed last = Place(captures[0], *segmenter);
    for (std::size_t k = 0; k < trials.size(); ++k)
      Count(last, Place(captures[k + 1], *segmenter), mover, &trials[k]);
    fmt::print(stderr, "seed {}\n", seed);
  }
  fmt::print("| movement | found | others accused | undecided |\n|---|---|---|---|\n");
  for (const Trial& trial : trials) {
    fmt::print("| {} | {} | {} of {} | {} |\n", trial.label,
               trial.moved > 0 ? fmt::format("{} of {}", trial.found, trial.moved) : "-",
               trial.accused, trial.others, trial.undecided);
  }
}

}  // namespace
}  // namespace volalign

int main(int argc, char** argv) {
  volalign::Values values = {
      {"seeds", "3000:3010"}, {"mm", "5,10,15,20,30"}, {"deg", "0.2,0.4,0.6,1.2"}};
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    const std::size_t equals = argument.find('=');
    const auto value = values.find(argument.substr(0, equals));
    if (equals == std::string::npos || value == values.end()) {
      fmt::print(stderr, "moved_sensors: {}? See the comment at the top of its source\n", argument);
      return 1;
    }
    value->second = argument.substr(equals + 1);
  }
  volalign::Run(values);
  return 0;
}
