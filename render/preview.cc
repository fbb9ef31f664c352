#include "render/preview.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <utility>
#include <vector>

#include "core/error.h"
#include "core/image_io.h"
#include "core/image_size.h"
#include "core/picture.h"
#include "render/depth_renderer.h"
#include "render/depth_statistics.h"
#include "render/sample.h"

namespace volalign {
namespace {

namespace fs = std::filesystem;

constexpr double kNear = 0.5, kFar = 6.0;  // m
constexpr int kShown = 12;                 // samples of a sensor in the picture
constexpr int kColumns = 8;                // pictures: pairs of depth and labels

struct RealFrame {
  DepthImage depth;
  LabelImage labels;  // empty without a label map
};

bool IsStereo(const std::string& sensor) {
  return sensor.rfind("realsense", 0) == 0 || sensor.rfind("kinect_v1", 0) == 0;
}

std::string Lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

/// Frames of each configured sensor.
std::map<std::string, std::vector<RealFrame>> ReadRealFrames(const PreviewOptions& options,
                                                             const SampleContext& context) {
  std::map<std::string, std::vector<RealFrame>> frames;
  if (options.real_frames.empty()) return frames;
  if (!fs::is_directory(options.real_frames)) {
    throw IoError(fmt::format("{}: no such folder", options.real_frames.string()));
  }
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(options.real_frames)) {
    const std::string name = Lower(entry.path().filename().string());
    const std::string extension = Lower(entry.path().extension().string());
    if (extension == ".pgm" || (extension == ".png" && name.find("depth") != std::string::npos)) {
      files.push_back(entry.path());
    }
  }
  if (files.empty()) {
    throw DataError(
        fmt::format("{}: no depth frames: .pgm files, or .png files with 'depth' in their name",
                    options.real_frames.string()));
  }
  std::sort(files.begin(), files.end());
  for (const fs::path& file : files) {
    RealFrame frame;
    frame.depth = ToMetres(ReadDepthFile(file), options.real_depth_scale);
    const auto entry = std::find_if(
        context.pool.begin(), context.pool.end(), [&](const IntrinsicsPoolEntry& candidate) {
          return SameAspect(candidate.intrinsics.front(),
                            {frame.depth.width(), frame.depth.height()});
        });
    if (entry == context.pool.end()) {
      throw DataError(
          fmt::format("{}: {}x{} is the aspect ratio of no configured sensor (data.sensors)",
                      file.string(), frame.depth.width(), frame.depth.height()));
    }
    std::string name = file.stem().string();
    const std::size_t suffix = Lower(name).rfind("_depth");
    if (suffix != std::string::npos) name.resize(suffix);
    const fs::path labels = options.real_frames / "labels" / (name + ".png");
    if (fs::exists(labels)) {
      frame.labels = ReadPng8(labels);
      if (frame.labels.width() != frame.depth.width() ||
          frame.labels.height() != frame.depth.height()) {
        throw DataError(fmt::format("{}: {}x{}, but its frame {} is {}x{}", labels.string(),
                                    frame.labels.width(), frame.labels.height(), file.string(),
                                    frame.depth.width(), frame.depth.height()));
      }
    }
    frames[entry->sensor].push_back(std::move(frame));
  }
  return frames;
}

}  // namespace

std::string WritePreview(const fs::path& dir, const SampleConfig& config,
                         const PreviewOptions& options, DepthRenderer& renderer) {
  const SampleContext base = MakeSampleContext(config, 1);
  const auto real = ReadRealFrames(options, base);
  std::vector<std::string> sensors;
  for (const IntrinsicsPoolEntry& entry : base.pool) {
    if (std::find(sensors.begin(), sensors.end(), entry.sensor) == sensors.end()) {
      sensors.push_back(entry.sensor);
    }
  }
  std::vector<RgbImage> pictures;
  const auto show = [&](const DepthImage& depth, const LabelImage& labels, int turns) {
    pictures.push_back(Turn(ColourDepth(depth, kNear, kFar), turns));
    pictures.push_back(labels.empty() ? RgbImage(1, 1) : Turn(ColourLabels(labels), turns));
  };
  const auto end_row = [&pictures] {
    while (pictures.size() % kColumns != 0) pictures.emplace_back(1, 1);
  };
  std::string tables;
  for (const std::string& sensor : sensors) {
    const auto found = real.find(sensor);
    SampleConfig one = config;
    one.sensors = {sensor};
    one.image_sizes.clear();
    if (found != real.end()) {
      const DepthImage& frame = found->second.front().depth;
      one.image_sizes = {fmt::format("{}x{}", frame.width(), frame.height())};
    } else {
      for (const std::string& text : config.image_sizes) {
        const auto& entry = *std::find_if(
            base.pool.begin(), base.pool.end(),
            [&](const IntrinsicsPoolEntry& candidate) { return candidate.sensor == sensor; });
        if (SameAspect(entry.intrinsics.front(), ParseImageSize(text))) {
          one.image_sizes.push_back(text);
        }
      }
      if (one.image_sizes.empty()) continue;  // drawn by no batch
    }
    const SampleContext context = MakeSampleContext(one, 1);
    const DepthStatistics::Options kind{IsStereo(sensor)};
    DepthStatistics rendered(kind), clean(kind), measured(kind);
    int upright = 0;
    std::vector<Sample> samples;
    for (int i = 0; i < options.count; ++i) {
      Sample sample = Synthesize(context, renderer, options.seed,
                                 options.first_index + static_cast<std::uint64_t>(i));
      rendered.Add(sample.depth, sample.intrinsics);
      rendered.AddSides(sample.depth, sample.labels, sample.intrinsics);
      clean.Add(sample.depth_clean, sample.intrinsics);
      if (i == 0) upright = UprightTurns(sample.structure_from_sensor);
      if (i < kShown) samples.push_back(std::move(sample));
    }
    if (found != real.end()) {
      for (const RealFrame& frame : found->second) {
        const Intrinsics k = context.pool.front().intrinsics.front().Resized(frame.depth.width(),
                                                                             frame.depth.height());
        measured.Add(frame.depth, k);
        if (!frame.labels.empty()) measured.AddSides(frame.depth, frame.labels, k);
        show(frame.depth, frame.labels, upright);
      }
      end_row();
    }
    for (const Sample& sample : samples) {
      show(sample.depth, sample.labels, UprightTurns(sample.structure_from_sensor));
    }
    end_row();
    std::vector<std::string> names{"rendered", "before noise"};
    std::vector<const DepthStatistics*> sets{&rendered, &clean};
    if (measured.frames() > 0) {
      names.push_back("real");
      sets.push_back(&measured);
    }
    tables += fmt::format("{}, {}\n\n{}\n", sensor, fmt::join(one.image_sizes, ", "),
                          StatisticsTable(names, sets));
  }
  WritePng(dir / "preview.png", Montage(pictures, kColumns));
  return tables;
}

}  // namespace volalign
