#include "render/sample.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

#include "core/base/error.h"
#include "core/base/input_file.h"
#include "core/base/ordered_prefetch.h"
#include "core/base/random.h"
#include "core/geometry/camera.h"
#include "core/geometry/structure.h"
#include "render/noise.h"
#include "render/scene.h"

namespace volalign {
namespace {

template <class T>
void RequireOrdered(const std::array<T, 2>& range, const std::string& key) {
  if (!(range[0] <= range[1])) {
    throw ConfigError(fmt::format("{} = [{}, {}] violates low <= high", key, range[0], range[1]));
  }
}

void Validate(const SampleConfig& config) {
  ValidateConfig(config);
  RequireOrdered(config.pose.rho_cm, "data.pose.rho_cm");
  RequireOrdered(config.pose.height_cm, "data.pose.height_cm");
  RequireOrdered(config.scene.wall_distance_m, "data.scene.wall_distance_m");
  RequireOrdered(config.scene.clutter_count, "data.scene.clutter_count");
  RequireOrdered(config.scene.tripod_count, "data.scene.tripod_count");
  if (config.pose.phi_deg.empty() && config.pose.phi_jitter_deg > 0) {
    throw ConfigError(fmt::format(
        "data.pose.phi_jitter_deg = {} needs data.pose.phi_deg, the azimuths to deviate from, e.g. "
        "[45, 135, 225, 315]",
        config.pose.phi_jitter_deg));
  }
  if (config.pose.roll_offsets_deg.empty()) {
    throw ConfigError(
        "data.pose.roll_offsets_deg = [] has no mounting roll; give at least one, e.g. [90]");
  }
  if (config.image_sizes.empty()) {
    throw ConfigError("data.image_sizes = [] has no size; give at least one, e.g. [160x144]");
  }
}

/// The pool's intrinsics that fit the image size, by sensor, in the pool's order.
std::vector<std::pair<std::string, std::vector<const Intrinsics*>>> Candidates(
    const std::vector<IntrinsicsPoolEntry>& pool, ImageSize size) {
  std::vector<std::pair<std::string, std::vector<const Intrinsics*>>> out;
  for (const IntrinsicsPoolEntry& entry : pool) {
    for (const Intrinsics& intrinsics : entry.intrinsics) {
      if (!SameAspect(intrinsics, size)) continue;
      auto it = std::find_if(out.begin(), out.end(),
                             [&](const auto& c) { return c.first == entry.sensor; });
      if (it == out.end()) it = out.insert(out.end(), {entry.sensor, {}});
      it->second.push_back(&intrinsics);
    }
  }
  return out;
}

/// Throws ConfigError for a sensor that no batch would draw: no image size has its aspect ratio.
void RequireThatEverySensorIsDrawn(const SampleContext& context) {
  for (const std::string& sensor : context.config.sensors) {
    std::vector<std::string> resolutions;
    bool drawn = false;
    for (const IntrinsicsPoolEntry& entry : context.pool) {
      if (entry.sensor != sensor) continue;
      const Intrinsics& k = entry.intrinsics.front();
      resolutions.push_back(fmt::format("{}x{}", k.width, k.height));
      for (const auto& [width, height] : context.image_sizes) {
        drawn = drawn || SameAspect(k, {width, height});
      }
    }
    if (drawn) continue;
    throw ConfigError(fmt::format(
        "data.sensors: {} ({}) has the aspect ratio of none of data.image_sizes = [{}] (within 2 "
        "%), so that it would never be drawn: add such a size, or leave the sensor out",
        sensor, fmt::join(resolutions, ", "), fmt::join(context.config.image_sizes, ", ")));
  }
}

double SampleAzimuth(const PoseConfig& config, RandomStream& random) {
  if (config.phi_deg.empty()) return random.Uniform(0, 2 * M_PI);
  const double azimuth =
      config
          .phi_deg[static_cast<std::size_t>(random.Below(static_cast<int>(config.phi_deg.size())))];
  return (azimuth + random.Uniform(-config.phi_jitter_deg, config.phi_jitter_deg)) * M_PI / 180;
}

}  // namespace

std::vector<IntrinsicsPoolEntry> EntriesOf(const std::vector<std::string>& sensors,
                                           const std::vector<IntrinsicsPoolEntry>& pool) {
  std::vector<IntrinsicsPoolEntry> entries;
  std::copy_if(pool.begin(), pool.end(), std::back_inserter(entries), [&](const auto& entry) {
    return sensors.empty() || std::count(sensors.begin(), sensors.end(), entry.sensor) > 0;
  });
  return entries;
}

SampleContext MakeSampleContext(const SampleConfig& config, int batch_size,
                                const Structure* structure,
                                const std::vector<IntrinsicsPoolEntry>* intrinsics) {
  if (batch_size < 1) {
    throw ConfigError(fmt::format("batch size {} violates batch size >= 1", batch_size));
  }
  Validate(config);
  SampleContext context;
  context.config = config;
  context.batch_size = batch_size;
  if (structure == nullptr) RequireInputFile("data.structure", config.structure);
  if (intrinsics == nullptr) RequireInputFile("data.intrinsics", config.intrinsics);
  context.structure = structure != nullptr ? *structure : ReadStructure(config.structure);
  const std::vector<IntrinsicsPoolEntry> pool =
      intrinsics != nullptr ? *intrinsics : ReadIntrinsicsPool(config.intrinsics);
  std::vector<std::string> names;
  for (const IntrinsicsPoolEntry& entry : pool) {
    if (std::find(names.begin(), names.end(), entry.sensor) == names.end()) {
      names.push_back(entry.sensor);
    }
  }
  for (const std::string& sensor : config.sensors) {
    if (std::find(names.begin(), names.end(), sensor) == names.end()) {
      throw ConfigError(fmt::format("data.sensors: {} is not in {}, which has {}", sensor,
                                    config.intrinsics, fmt::join(names, ", ")));
    }
  }
  context.pool = EntriesOf(config.sensors, pool);
  for (const IntrinsicsPoolEntry& entry : context.pool)
    RequireNoiseModels("data.noise.models", config.noise.models, entry.sensor);
  for (const std::string& text : config.image_sizes) {
    const ImageSize size = ParseImageSize(text);
    if (Candidates(context.pool, size).empty()) {
      throw ConfigError(fmt::format(
          "data.image_sizes: no configured sensor has the aspect ratio of {} (within 2 %)", text));
    }
    context.image_sizes.emplace_back(size.width, size.height);
  }
  RequireThatEverySensorIsDrawn(context);
  return context;
}

Pose SamplePose(const PoseConfig& config, RandomStream& random) {
  if (config.roll_offsets_deg.empty()) {
    throw ConfigError(
        "pose.roll_offsets_deg = [] has no mounting roll; give at least one, e.g. [90]");
  }
  const double rho = 0.01 * random.Uniform(config.rho_cm[0], config.rho_cm[1]);
  const double phi = SampleAzimuth(config, random);
  const double y = 0.01 * random.Uniform(config.height_cm[0], config.height_cm[1]);
  const Eigen::Vector3d position(rho * std::cos(phi), y, rho * std::sin(phi));

  const Eigen::Vector3d target = PointInBall(0.01 * config.look_at_radius_cm, random);
  const double roll = random.Uniform(-config.roll_deg, config.roll_deg);
  const double offset = config.roll_offsets_deg[static_cast<std::size_t>(
      random.Below(static_cast<int>(config.roll_offsets_deg.size())))];
  return LookAt(position, target, (roll + offset) * M_PI / 180);
}

Sample Synthesize(const SampleContext& context, DepthRenderer& renderer, std::uint64_t seed,
                  std::uint64_t index) {
  const SampleConfig& config = context.config;
  Sample sample;
  sample.index = index;

  RandomStream size_random(seed, index / static_cast<std::uint64_t>(context.batch_size),
                           "image_size");
  const std::pair<int, int> size = context.image_sizes[static_cast<std::size_t>(
      size_random.Below(static_cast<int>(context.image_sizes.size())))];
  RandomStream sensor_random(seed, index, "sensor");
  const auto candidates = Candidates(context.pool, {size.first, size.second});
  const auto& [sensor, choices] = candidates[static_cast<std::size_t>(
      sensor_random.Below(static_cast<int>(candidates.size())))];
  sample.sensor = sensor;
  sample.intrinsics =
      choices[static_cast<std::size_t>(sensor_random.Below(static_cast<int>(choices.size())))]
          ->Resized(size.first, size.second);

  RandomStream pose_random(seed, index, "pose");
  sample.structure_from_sensor = SamplePose(config.pose, pose_random);

  AssembledStructure built = Assemble(context.structure, config.assembly, seed, index);
  sample.box_offsets = std::move(built.box_offsets);
  sample.size_scale = built.size_scale;
  SceneOptions options;
  options.structure_from_room = built.structure_from_room;
  options.room_probability = config.scene.room_probability;
  options.structure_from_sensors = {sample.structure_from_sensor};
  const SceneMesh mesh = BuildScene(config.scene, built.structure, options, seed, index);

  RenderedView view;
  renderer.Render(mesh, sample.intrinsics, sample.structure_from_sensor, &view);
  NoisyView noisy = ApplyNoise(
      config.noise,
      {view, mesh, built.structure, sample.intrinsics, sample.structure_from_sensor, sample.sensor},
      seed, index);
  sample.depth = std::move(noisy.depth);
  sample.labels = std::move(noisy.labels);
  sample.depth_clean = std::move(view.depth);
  sample.labels_clean = std::move(view.labels);
  return sample;
}

std::function<Sample()> StreamSamples(std::shared_ptr<const SampleContext> context,
                                      const StreamOptions& options) {
  if (context == nullptr || !options.make_renderer)
    throw Error("StreamSamples: no context, or no renderer");
  const auto batch_size = static_cast<std::uint64_t>(context->batch_size);
  const BatchSlice slice = options.slice;
  const int taken = slice.count > 0 ? slice.count : context->batch_size;
  if (options.first_index % batch_size != 0) {
    throw Error(
        fmt::format("StreamSamples: first_index = {} is not a multiple of the batch size {}",
                    options.first_index, batch_size));
  }
  if (slice.first < 0 || slice.first + taken > context->batch_size) {
    throw Error(fmt::format("StreamSamples: {} samples from {} on are no slice of a batch of {}",
                            taken, slice.first, batch_size));
  }
  // Positions count this stream's samples, with `count` per batch.
  const auto count = static_cast<std::uint64_t>(taken);
  const auto make_worker = [context = std::move(context), options, batch_size, count] {
    return [context, options, batch_size, count,
            renderer =
                std::shared_ptr<DepthRenderer>(options.make_renderer())](std::uint64_t position) {
      const std::uint64_t index = position / count * batch_size +
                                  static_cast<std::uint64_t>(options.slice.first) +
                                  position % count;
      Sample sample = Synthesize(*context, *renderer, options.seed, index);
      if (options.drawn) options.drawn(sample);
      return sample;
    };
  };
  using Samples = OrderedPrefetch<Sample>;
  const auto samples =
      std::make_shared<Samples>(Samples::Options{options.first_index / batch_size * count, taken,
                                                 options.prefetch, options.num_threads},
                                make_worker);
  return [samples] { return samples->Take(); };
}

}  // namespace volalign
