#include "train/real_frames.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/random.h"
#include "core/formats/image_io.h"
#include "core/geometry/camera.h"
#include "core/geometry/lens.h"
#include "core/geometry/visibility.h"
#include "core/json/json_archive.h"

namespace volalign {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

fs::path FindDepth(const std::string& file, const fs::path& extrinsics, const fs::path& capture) {
  fs::path beside = extrinsics.parent_path() / file;
  if (fs::exists(beside)) return beside;
  fs::path with_capture = capture.parent_path() / file;
  if (fs::exists(with_capture)) return with_capture;
  throw IoError(fmt::format("{}: its depth file {} is neither there nor beside {}",
                            extrinsics.string(), file, capture.string()));
}

/// The structure with its boxes as built, by the calibration.
Structure AsBuilt(const Structure& structure, const ObjectReader& file) {
  std::map<std::string, Pose> found;
  for (const ObjectReader& box :
       file.Has("boxes") ? file.Children("boxes") : std::vector<ObjectReader>()) {
    Pose displacement = Pose::Identity();
    displacement.translation() = box.Read<Eigen::Vector3d>("translation_m");
    displacement.rotate(
        Eigen::AngleAxisd(box.Number("yaw_deg") * M_PI / 180, Eigen::Vector3d::UnitY()));
    found[box.Text("name")] = displacement;
  }
  std::vector<Pose> offsets;
  for (const Box& box : structure.boxes()) {
    const auto at = found.find(box.name);
    // Its turn is about the vertical through its centre.
    const Eigen::Translation3d centre(box.structure_from_box.translation());
    offsets.push_back(at == found.end() ? Pose::Identity()
                                        : Pose(centre * at->second * centre.inverse()));
  }
  return structure.Displaced(offsets, file.Has("size") ? file.Child("size").Number("scale") : 1.0);
}

void ReadCalibration(const fs::path& path, const Structure& structure,
                     std::vector<RealFrame>* frames) {
  const json read = ParseStrictJson(ReadFile(path, kMaxResultBytes), path.string());
  const ObjectReader file(read, path.string());
  const auto refuse = [&](const std::string& why) {
    throw ConfigError(fmt::format("data.real: {} {}", path.string(), why));
  };
  if (file.Text("format") != "volalign.extrinsics/1") refuse("is no volalign.extrinsics/1");
  if (file.Text("verdict") != "ok")
    refuse("has the verdict " + file.Text("verdict") + ": name accepted calibrations");
  if (file.Child("structure").Text("sha256") != structure.Hash())
    refuse("is of another structure than data.structure");
  std::vector<std::string> captures, depths;
  file.OneOrList("capture", captures);
  if (captures.size() != 1) refuse("is of several captures: calibrate each of them alone");
  const auto built = std::make_shared<const Structure>(AsBuilt(structure, file));
  const ObjectReader sensors = file.Child("sensors");
  for (const std::string& name : sensors.Keys()) {
    const ObjectReader sensor = sensors.Child(name);
    if (sensor.Text("status") != "ok") continue;
    RealFrame frame;
    frame.sensor = sensor.Has("sensor") ? sensor.Text("sensor") : "";
    frame.intrinsics = sensor.Read<Intrinsics>("intrinsics");
    frame.structure_from_sensor = sensor.Read<Pose>("structure_from_sensor");
    frame.structure = built;
    const double gain = sensor.Has("depth_gain") ? sensor.Number("depth_gain") : 1,
                 offset = sensor.Has("depth_offset_m") ? sensor.Number("depth_offset_m") : 0;
    sensor.OneOrList("depth", depths);
    for (const std::string& depth : depths) {
      frame.name = FindDepth(depth, path, captures[0]).string();
      frame.depth = ToMetres(ReadDepthFile(frame.name), sensor.Number("depth_scale"));
      // The pose belongs to the corrected depth.
      for (float& z : frame.depth) {
        if (z > 0) z = static_cast<float>(z * gain + offset);
      }
      if (frame.depth.width() != frame.intrinsics.width ||
          frame.depth.height() != frame.intrinsics.height) {
        throw DataError(fmt::format("{} has another size than its intrinsics in {}", frame.name,
                                    path.string()));
      }
      frames->push_back(frame);
    }
  }
}

/// The nearest source pixel of each of `count` pixels, for resampling from `source` pixels.
std::vector<int> NearestPixels(int source, int count) {
  std::vector<int> nearest;
  for (int i = 0; i < count; ++i)
    nearest.push_back(std::min(source - 1, static_cast<int>((i + 0.5) * source / count)));
  return nearest;
}

/// p = Turning(q) p' for an image that was turned by q quarters.
Eigen::Matrix3d Turning(int quarter_turns) {
  // One turn sends (x, y) to (-y, x).
  return Eigen::AngleAxisd(-quarter_turns * M_PI / 2, Eigen::Vector3d::UnitZ()).toRotationMatrix();
}

/// Does the depth belong to the structure seen at a pixel next to (u, v)?
bool ExplainedBeside(const ExpectedView& expected, int u, int v, float z) {
  for (int dv = -1; dv <= 1; ++dv) {
    for (int du = -1; du <= 1; ++du) {
      if (!expected.depth.Contains(u + du, v + dv)) continue;
      const float near = expected.depth(u + du, v + dv);
      if (near > 0 && std::abs(z - near) <= kLabelReach) return true;
    }
  }
  return false;
}

void Label(const ExpectedView& expected, Sample* sample) {
  sample->labels = expected.labels;
  for (int v = 0; v < sample->depth.height(); ++v) {
    for (int u = 0; u < sample->depth.width(); ++u) {
      float& z = sample->depth(u, v);
      const float structure = expected.depth(u, v);
      const bool known = structure > 0 ? std::abs(z - structure) <= kLabelReach
                                       : !ExplainedBeside(expected, u, v, z);
      if (z > 0 && known) continue;
      z = 0;
      sample->labels(u, v) = 0;
    }
  }
}

}  // namespace

std::vector<RealFrame> ReadRealFrames(const std::vector<std::string>& extrinsics,
                                      const Structure& structure) {
  std::vector<RealFrame> frames;
  for (const std::string& path : extrinsics) {
    const std::size_t before = frames.size();
    ReadCalibration(path, structure, &frames);
    if (frames.size() > before) continue;
    throw ConfigError(fmt::format("data.real: {} has no sensor whose status is ok", path));
  }
  return frames;
}

std::unique_ptr<Sample> LabelledSample(const RealFrame& frame, int width, int height,
                                       const std::vector<double>& roll_offsets_deg) {
  const int upright = UprightTurns(frame.structure_from_sensor);
  for (const double offset : roll_offsets_deg) {
    // A sensor mounted with a roll of 90 deg has to be turned once to stand upright.
    const int turns = ((upright - static_cast<int>(std::lround(offset / 90))) % 4 + 4) % 4;
    const Intrinsics turned = frame.intrinsics.Turned(turns);
    if (!SameAspect(turned, {width, height})) continue;
    auto sample = std::make_unique<Sample>();
    sample->sensor = frame.sensor;
    sample->intrinsics = turned.Resized(width, height);
    sample->structure_from_sensor = frame.structure_from_sensor;
    sample->structure_from_sensor.rotate(Turning(turns));
    const DepthImage depth = Turn(frame.depth, turns);
    const std::vector<int> columns = NearestPixels(depth.width(), width),
                           rows = NearestPixels(depth.height(), height);
    sample->depth = DepthImage(width, height);
    for (int v = 0; v < height; ++v) {
      for (int u = 0; u < width; ++u)
        sample->depth(u, v) =
            depth(columns[static_cast<std::size_t>(u)], rows[static_cast<std::size_t>(v)]);
    }
    Label(
        CastView(*frame.structure, ComputeRays(sample->intrinsics), sample->structure_from_sensor),
        sample.get());
    sample->depth_clean = sample->depth;
    sample->labels_clean = sample->labels;
    return sample;
  }
  return nullptr;
}

SampleSource MixRecordedFrames(SampleSource inner,
                               std::shared_ptr<const std::vector<RealFrame>> frames, double share,
                               std::uint64_t seed, const std::vector<double>& roll_offsets_deg) {
  using Labelled = std::vector<std::shared_ptr<const Sample>>;
  return [=, of_size = std::map<std::pair<int, int>, Labelled>()]() mutable {
    std::vector<Sample> batch = inner();
    for (Sample& sample : batch) {
      RandomStream random(seed, sample.index, "real");
      if (random.Uniform() >= share) continue;
      const int width = sample.depth.width(), height = sample.depth.height();
      const auto [at, is_new] = of_size.try_emplace({width, height});
      Labelled& fitting = at->second;  // labelled once
      for (std::size_t i = 0; is_new && i < frames->size(); ++i) {
        std::shared_ptr<const Sample> labelled =
            LabelledSample((*frames)[i], width, height, roll_offsets_deg);
        if (labelled) fitting.push_back(std::move(labelled));
      }
      if (fitting.empty()) continue;
      const std::uint64_t index = sample.index;
      sample = *fitting[static_cast<std::size_t>(random.Below(static_cast<int>(fitting.size())))];
      sample.index = index;
    }
    return batch;
  };
}

SampleSource ValidationFrames(const std::vector<RealFrame>& frames,
                              const std::vector<std::pair<int, int>>& image_sizes, int batch_size,
                              const std::vector<double>& roll_offsets_deg) {
  std::map<std::pair<int, int>, std::vector<Sample>> of_size;
  for (const RealFrame& frame : frames) {
    std::unique_ptr<Sample> sample;
    for (const auto& [width, height] : image_sizes) {
      sample = LabelledSample(frame, width, height, roll_offsets_deg);
      if (sample) break;
    }
    if (!sample) {
      throw ConfigError(
          fmt::format("data.real: {} ({}x{}) has the aspect ratio of none of data.image_sizes",
                      frame.name, frame.intrinsics.width, frame.intrinsics.height));
    }
    const std::pair<int, int> size{sample->depth.width(), sample->depth.height()};
    of_size[size].push_back(std::move(*sample));
  }
  std::vector<std::vector<Sample>> batches;
  for (auto& [size, samples] : of_size) {
    for (std::size_t first = 0; first < samples.size(); first += batch_size) {
      const std::size_t end = std::min(samples.size(), first + batch_size);
      batches.emplace_back(samples.begin() + first, samples.begin() + end);
    }
  }
  return [batches = std::move(batches), next = std::size_t{0}]() mutable {
    return batches[next++ % batches.size()];
  };
}

}  // namespace volalign
