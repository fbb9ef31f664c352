#include "render/preview.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/formats/image_io.h"
#include "core/geometry/image_size.h"
#include "core/plot/picture.h"
#include "core/plot/picture_text.h"
#include "render/capture_writer.h"
#include "render/depth_renderer.h"
#include "render/depth_statistics.h"
#include "render/sample.h"

namespace volalign {
namespace {

namespace fs = std::filesystem;

constexpr int kShown = 12;   // samples of a sensor in the picture
constexpr int kColumns = 8;  // pictures: pairs of depth and labels

struct RealFrame {
  DepthImage depth;
  LabelImage labels;  // empty without a label map
};

bool IsStereo(const std::string& sensor) {
  return sensor.rfind("realsense", 0) == 0 || sensor.rfind("kinect_v1", 0) == 0;
}

/// Reads the frames of each configured sensor.
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

/// The pool's entry of a sensor with the aspect ratio of a size, or null.
const IntrinsicsPoolEntry* FindEntry(const SampleContext& context, const std::string& sensor,
                                     ImageSize size) {
  for (const IntrinsicsPoolEntry& entry : context.pool) {
    if (entry.sensor == sensor && SameAspect(entry.intrinsics.front(), size)) return &entry;
  }
  return nullptr;
}

/// The size of the sensor's real frames, or the configuration's sizes that fit it.
std::vector<std::string> SizesOf(const std::string& sensor, const SampleContext& context,
                                 const std::vector<RealFrame>& real) {
  if (!real.empty()) {
    return {fmt::format("{}x{}", real.front().depth.width(), real.front().depth.height())};
  }
  std::vector<std::string> sizes;
  for (const std::string& text : context.config.image_sizes) {
    if (FindEntry(context, sensor, ParseImageSize(text))) sizes.push_back(text);
  }
  return sizes;
}

/// Pairs of depth and labels, in rows of kColumns pictures.
class Sheet {
 public:
  void Add(const std::string& name, const DepthImage& depth, const LabelImage& labels, int turns) {
    pictures_.push_back(Captioned(Turn(ColourSheetDepth(depth), turns), name));
    pictures_.push_back(labels.empty() ? RgbImage(1, 1)
                                       : Captioned(Turn(ColourLabels(labels), turns), "labels"));
  }
  void EndRow() {
    while (pictures_.size() % kColumns != 0) pictures_.emplace_back(1, 1);
  }
  const std::vector<RgbImage>& pictures() const { return pictures_; }

 private:
  std::vector<RgbImage> pictures_;
};

/// Adds a sensor's rows to the sheet and returns its table of statistics.
std::string PreviewSensor(const std::string& sensor, const std::vector<RealFrame>& real,
                          const SampleContext& context, const PreviewOptions& options,
                          DepthRenderer& renderer, Sheet* sheet) {
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
  for (const RealFrame& frame : real) {
    const ImageSize size{frame.depth.width(), frame.depth.height()};
    const Intrinsics k = FindEntry(context, sensor, size)
                             ->intrinsics.front()
                             .Resized(frame.depth.width(), frame.depth.height());
    measured.Add(frame.depth, k);
    if (!frame.labels.empty()) measured.AddSides(frame.depth, frame.labels, k);
    sheet->Add("real " + sensor, frame.depth, frame.labels, upright);
  }
  sheet->EndRow();
  for (const Sample& sample : samples) {
    sheet->Add(sensor, sample.depth, sample.labels, UprightTurns(sample.structure_from_sensor));
  }
  sheet->EndRow();
  std::vector<std::string> names{"rendered", "before noise"};
  std::vector<const DepthStatistics*> sets{&rendered, &clean};
  if (measured.frames() > 0) {
    names.push_back("real");
    sets.push_back(&measured);
  }
  return fmt::format("{}, {}\n\n{}\n", sensor, fmt::join(context.config.image_sizes, ", "),
                     StatisticsTable(names, sets));
}

}  // namespace

std::string WritePreview(const fs::path& dir, const SampleConfig& config,
                         const PreviewOptions& options, DepthRenderer& renderer) {
  const SampleContext base = MakeSampleContext(config, 1);
  auto real = ReadRealFrames(options, base);
  std::vector<std::string> sensors;
  for (const IntrinsicsPoolEntry& entry : base.pool) {
    if (std::find(sensors.begin(), sensors.end(), entry.sensor) == sensors.end()) {
      sensors.push_back(entry.sensor);
    }
  }
  Sheet sheet;
  std::string tables;
  for (const std::string& sensor : sensors) {
    SampleConfig one = config;
    one.sensors = {sensor};
    one.image_sizes = SizesOf(sensor, base, real[sensor]);
    if (one.image_sizes.empty()) continue;  // a sensor of the whole pool that fits no size
    tables +=
        PreviewSensor(sensor, real[sensor], MakeSampleContext(one, 1), options, renderer, &sheet);
  }
  WriteContactSheet(dir / "preview.png", Montage(sheet.pictures(), kColumns));
  return tables;
}

}  // namespace volalign
