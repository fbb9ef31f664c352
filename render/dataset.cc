#include "render/dataset.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <set>
#include <string_view>
#include <utility>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/folder.h"
#include "core/base/progress_line.h"
#include "core/base/text.h"
#include "core/formats/image_io.h"
#include "core/json/json_archive.h"
#include "core/plot/picture.h"
#include "render/capture_writer.h"

namespace volalign {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr char kFormat[] = "volalign.samples/2";
constexpr char kRowsName[] = "samples.jsonl";
constexpr std::uint64_t kSheetSamples = 24;
constexpr std::chrono::seconds kCommitInterval{5};

std::string PoolHash(const std::vector<IntrinsicsPoolEntry>& pool) {
  std::string text;
  for (const IntrinsicsPoolEntry& entry : pool) {
    text += entry.sensor + ":";
    for (const Intrinsics& k : entry.intrinsics)
      text += DescribedJson(k, entry.sensor).dump() + ";";
  }
  return Sha256(text);
}

DatasetHeader MakeHeader(const SampleContext& context, const DatasetOptions& options) {
  DatasetHeader header;
  header.data_yaml = WriteConfig(context.config);
  header.seed = options.seed;
  header.first_index = options.first_index;
  header.count = options.count;
  header.batch_size = context.batch_size;
  header.samples_per_folder = options.samples_per_folder;
  header.structure = {context.structure.name(), context.structure.Hash(),
                      context.structure.num_classes()};
  header.intrinsics_hash = PoolHash(context.pool);
  header.image_sizes = context.config.image_sizes;
  return header;
}

}  // namespace

template <class Archive>
void Describe(Archive& ar, DatasetHeader& h) {
  ar.Constant("format", kFormat);
  ar("complete", h.complete);
  ar("count", h.count);
  ar("seed", h.seed);
  ar("first_index", h.first_index);
  ar("batch_size", h.batch_size);
  ar("samples_per_folder", h.samples_per_folder);
  std::string folders = "index / samples_per_folder, six digits, each with a samples.jsonl";
  ar.WriteOnly("folders", folders);
  double depth_scale = kDepthScale;
  ar.WriteOnly("depth_scale", depth_scale);
  std::string convention =
      "structure_from_sensor, metres, row-major, sensor: x right y down z forward, structure: y up";
  ar.WriteOnly("convention", convention);
  ar("structure", h.structure);
  ar("intrinsics_sha256", h.intrinsics_hash);
  ar("image_sizes", h.image_sizes);
  ar("data", h.data_yaml);
}

namespace {

void WriteHeader(const fs::path& dir, const DatasetHeader& h) {
  WriteFileAtomically(dir / "index.json", WriteDescribed(h, "index.json", 2));
}

DatasetHeader ReadHeader(const fs::path& dir) {
  const fs::path path = dir / "index.json";
  const nlohmann::json json = ParseStrictJson(ReadFile(path, kMaxTextBytes), path.string());
  const ObjectReader index(json, path.string());
  if (index.Text("format") != kFormat) {
    throw DataError(fmt::format(
        "{}: format '{}' is not {}: write the samples again with `volalign render --config`, to an "
        "empty folder",
        path.string(), index.Text("format"), kFormat));
  }
  auto h = ReadDescribed<DatasetHeader>(index);
  if (h.count < 1 || h.batch_size < 1 || h.samples_per_folder < 1) {
    throw DataError(fmt::format(
        "{}: count = {}, batch_size = {} and samples_per_folder = {} have to be positive",
        path.string(), h.count, h.batch_size, h.samples_per_folder));
  }
  return h;
}

std::string FolderName(const DatasetHeader& header, std::uint64_t index) {
  return fmt::format("{:06}", index / static_cast<std::uint64_t>(header.samples_per_folder));
}

/// The first sample index of the folder after that of `index`.
std::uint64_t NextFolder(const DatasetHeader& header, std::uint64_t index) {
  const auto size = static_cast<std::uint64_t>(header.samples_per_folder);
  return (index / size + 1) * size;
}

/// A row of samples.jsonl: a sample without its images, but with their names.
struct SampleRow {
  Sample sample;
  std::string depth, labels;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("index", sample.index);
    ar("depth", depth);
    ar("labels", labels);
    ar("sensor", sample.sensor);
    ar("intrinsics", sample.intrinsics);
    ar("structure_from_sensor", sample.structure_from_sensor);
    ar("box_offsets", sample.box_offsets);
    ar("size_scale", sample.size_scale);
  }
};

/// The complete lines of a samples.jsonl.
std::vector<std::string_view> Lines(const std::string& text) {
  std::vector<std::string_view> lines;
  std::size_t start = 0;
  for (std::size_t end; (end = text.find('\n', start)) != std::string::npos; start = end + 1) {
    lines.emplace_back(text.data() + start, end - start);
  }
  return lines;
}

class DatasetWriter {
 public:
  DatasetWriter(const fs::path& dir, std::shared_ptr<const SampleContext> context,
                const DatasetOptions& options)
      : dir_(dir), context_(std::move(context)), options_(options), lock_(dir) {
    header_ = MakeHeader(*context_, options);
  }

  DatasetResult Run() {
    Adopted adopted = Adopt();
    next_ = adopted.next;
    rows_ = std::move(adopted.rows);
    header_.complete = adopted.complete;
    DatasetResult result;
    result.found = next_ - header_.first_index;
    if (next_ < End()) {
      WriteHeader(dir_, header_);
      RemoveLeftovers();
      Draw();
      result.written = header_.count - result.found;
    }
    if (!header_.complete) {
      header_.complete = true;
      WriteHeader(dir_, header_);
    }
    return result;
  }

 private:
  /// The results of an earlier run.
  struct Adopted {
    std::uint64_t next = 0;  // first sample without a row
    std::string rows;        // of the folder that `next` falls into
    bool complete = false;
  };

  std::uint64_t End() const { return header_.first_index + header_.count; }

  Adopted Adopt() const {
    Adopted adopted;
    std::uint64_t& next = adopted.next = header_.first_index;
    if (!fs::exists(dir_ / "index.json")) return adopted;
    const DatasetHeader old = ReadHeader(dir_);
    RequireSame(old);
    while (next < End()) {
      const fs::path path = dir_ / FolderName(header_, next) / kRowsName;
      if (!fs::exists(path)) break;
      const std::uint64_t end = std::min(NextFolder(header_, next), End());
      const std::string text = ReadFile(path, kMaxLogBytes);
      const std::vector<std::string_view> lines = Lines(text);
      const std::size_t kept = std::min<std::size_t>(lines.size(), end - next);
      for (std::size_t i = 0; i < kept; ++i) adopted.rows += std::string(lines[i]) + "\n";
      next += kept;
      if (next == NextFolder(header_, next - 1)) adopted.rows.clear();
      if (next < end) break;  // only the last folder may be incomplete
    }
    adopted.complete = old.complete && next == End() && old.count == header_.count;
    return adopted;
  }

  void RequireSame(const DatasetHeader& old) const {
    const auto refuse = [&](const std::string& what) {
      throw ConfigError(fmt::format(
          "{} holds other samples: {}: use another folder, or the same recipe, seed and first "
          "index",
          dir_.string(), what));
    };
    const std::vector<std::string> differences = DifferencesFrom(old, *context_);
    if (!differences.empty()) refuse(differences[0]);
    const auto require = [&](const char* name, std::uint64_t now, std::uint64_t before) {
      if (now != before) refuse(fmt::format("{} = {} (dataset: {})", name, now, before));
    };
    require("seed", header_.seed, old.seed);
    require("first index", header_.first_index, old.first_index);
    require("batch size", static_cast<std::uint64_t>(header_.batch_size),
            static_cast<std::uint64_t>(old.batch_size));
    require("samples per folder", static_cast<std::uint64_t>(header_.samples_per_folder),
            static_cast<std::uint64_t>(old.samples_per_folder));
    if (header_.count < old.count) {
      throw ConfigError(
          fmt::format("{} was begun for {} samples, more than the {} asked for now: ask for as "
                      "many, or use another folder",
                      dir_.string(), old.count, header_.count));
    }
  }

  /// Removes temporary files of a killed run.
  void RemoveLeftovers() const {
    for (std::uint64_t index = next_; index < End(); index = NextFolder(header_, index)) {
      RemoveTemporaries(dir_ / FolderName(header_, index));
    }
  }

  void Draw() {
    const std::uint64_t batch = static_cast<std::uint64_t>(header_.batch_size);
    const std::uint64_t sheet_end = header_.first_index + std::min(header_.count, kSheetSamples);
    // The pictures have clean depth, which is not kept. So those samples are drawn again.
    const std::uint64_t start = next_ < sheet_end ? header_.first_index : next_;
    StreamOptions stream_options;
    stream_options.seed = header_.seed;
    stream_options.first_index = start / batch * batch;
    stream_options.num_threads = options_.num_threads;
    stream_options.make_renderer = options_.make_renderer;
    stream_options.drawn = [this, first = next_](const Sample& sample) {
      if (sample.index >= first && sample.index < End()) WriteImages(sample);
    };
    const std::uint64_t batches = (End() - 1) / batch + 1 - start / batch;
    const std::uint64_t ahead =
        std::max<std::uint64_t>(4, 2 * static_cast<std::uint64_t>(options_.num_threads) / batch);
    stream_options.prefetch = static_cast<int>(std::min(batches, ahead));
    const std::function<Sample()> draw = StreamSamples(context_, stream_options);
    ProgressLine line(options_.progress);
    const auto show = [&] {
      line.Count("samples", static_cast<std::int64_t>(next_ - header_.first_index),
                 static_cast<std::int64_t>(header_.count));
    };
    show();
    auto committed_at = Clock::now();
    std::vector<RgbImage> pictures;
    while (next_ < End()) {
      Sample sample = draw();
      const std::uint64_t index = sample.index;
      if (index < start) continue;
      if (start == header_.first_index && index < sheet_end) {
        pictures.push_back(SheetPicture(std::to_string(index), sample.depth_clean, sample.depth,
                                        sample.labels, sample.structure_from_sensor));
        if (index + 1 == sheet_end) {
          WriteContactSheet(dir_ / "contact_sheet.png", pictures);
          pictures.clear();
        }
      }
      if (index < next_) continue;
      next_ = index + 1;
      rows_ += WriteDescribed(
          SampleRow{std::move(sample), ImageName(index, "depth"), ImageName(index, "labels")},
          kRowsName, -1);
      if (next_ == NextFolder(header_, index) || next_ == End() ||
          Clock::now() - committed_at > kCommitInterval) {
        Commit();
        committed_at = Clock::now();
      }
      show();
    }
  }

  static std::string ImageName(std::uint64_t index, const char* kind) {
    return fmt::format("{:08}_{}.png", index, kind);
  }

  void WriteImages(const Sample& sample) const {
    const fs::path folder = dir_ / FolderName(header_, sample.index);
    const auto write = [&](const char* kind, const auto& image) {
      WriteFileAtomically(folder / ImageName(sample.index, kind),
                          EncodePng(image, PngEffort::kFast), /*sync=*/false);
    };
    write("depth", FromMetres(sample.depth, kDepthScale));
    write("labels", sample.labels);
  }

  /// Writes the rows. Their images were written before.
  void Commit() {
    lock_.Sync();
    WriteFileAtomically(dir_ / FolderName(header_, next_ - 1) / kRowsName, rows_);
    if (next_ == NextFolder(header_, next_ - 1)) rows_.clear();
  }

  const fs::path dir_;
  const std::shared_ptr<const SampleContext> context_;
  const DatasetOptions options_;
  const FolderLock lock_;
  DatasetHeader header_;
  std::uint64_t next_ = 0;
  std::string rows_;  // of the folder that next_ falls into
};

/// Depth of a row's PNG, m. Single precision as in the sensor models' rounding, so that training
/// sees the same numbers as when it renders.
DepthImage DepthFromSteps(const Image16& steps) {
  DepthImage depth(steps.width(), steps.height());
  for (std::size_t i = 0; i < steps.size(); ++i) {
    depth[i] = static_cast<float>(steps[i]) * static_cast<float>(kDepthScale);
  }
  return depth;
}

/// `line` is row `number` (from 1) of the samples.jsonl `path`.
Sample ReadRow(std::string_view line, std::uint64_t number, const fs::path& path) {
  const std::string where = fmt::format("{}:{}", path.string(), number);
  auto row = ReadDescribed<SampleRow>(std::string(line), where);
  Sample& sample = row.sample;
  for (const std::string& image : {row.depth, row.labels}) {
    const fs::path file = image;
    if (file.is_absolute() || std::find(file.begin(), file.end(), "..") != file.end()) {
      throw DataError(
          fmt::format("{}: the image \"{}\" is not in the row's folder", where, Shortened(image)));
    }
  }
  const fs::path depth_path = path.parent_path() / row.depth;
  const fs::path labels_path = path.parent_path() / row.labels;
  const Image16 steps = ReadDepthFile(depth_path);
  sample.labels = ReadPng8(labels_path);
  const auto require_size = [&](const fs::path& image, int width, int height) {
    if (width == sample.intrinsics.width && height == sample.intrinsics.height) return;
    throw DataError(fmt::format("{}: {}x{} pixels, but {} says {}x{}", image.string(), width,
                                height, path.string(), sample.intrinsics.width,
                                sample.intrinsics.height));
  };
  require_size(depth_path, steps.width(), steps.height());
  require_size(labels_path, sample.labels.width(), sample.labels.height());
  sample.depth = DepthFromSteps(steps);
  return std::move(sample);
}

}  // namespace

std::string DatasetHeader::Identity() const {
  return Sha256(fmt::format("{}\n{} {} {} {}\n{} {} {}", data_yaml, seed, first_index, count,
                            batch_size, structure.sha256, structure.num_classes, intrinsics_hash));
}

std::vector<std::string> DifferencesFrom(const DatasetHeader& header,
                                         const SampleContext& context) {
  std::vector<std::string> differences;
  const std::string before =
      WriteConfig(ReadConfig<SampleConfig>(ConfigSource::FromString(header.data_yaml, "dataset")));
  const std::set<std::string> not_compared = {"structure", "intrinsics", "renderer"};
  for (const auto& [key, was, is] : FindDifferences(before, WriteConfig(context.config))) {
    if (not_compared.count(key) == 0)
      differences.push_back(fmt::format("data.{} = {} (dataset: {})", key, is, was));
  }
  if (context.structure.Hash() != header.structure.sha256) {
    differences.push_back(fmt::format("data.structure = {} has other boxes or labels (dataset: {})",
                                      context.config.structure, header.structure.name));
  }
  if (PoolHash(context.pool) != header.intrinsics_hash) {
    differences.push_back(
        fmt::format("data.intrinsics = {} has other numbers", context.config.intrinsics));
  }
  return differences;
}

DatasetResult WriteDataset(const fs::path& dir, std::shared_ptr<const SampleContext> context,
                           const DatasetOptions& options) {
  if (context == nullptr) throw Error("WriteDataset: no context");
  if (options.count < 1 || options.num_threads < 1 || options.samples_per_folder < 1) {
    throw Error(fmt::format(
        "WriteDataset: count = {}, num_threads = {}, samples_per_folder = {} violate >= 1",
        options.count, options.num_threads, options.samples_per_folder));
  }
  return DatasetWriter(dir, std::move(context), options).Run();
}

Dataset::Dataset(fs::path dir) : dir_(std::move(dir)) {
  if (!fs::exists(dir_ / "index.json")) {
    throw IoError(fmt::format(
        "{}: no such file: write a dataset with `volalign render --config RECIPE -o {} --count N`",
        (dir_ / "index.json").string(), dir_.string()));
  }
  header_ = ReadHeader(dir_);
  const std::uint64_t end = header_.first_index + header_.count;
  for (std::uint64_t i = header_.first_index; i < end; i = NextFolder(header_, i)) {
    const fs::path rows = dir_ / FolderName(header_, i) / kRowsName;
    if (header_.complete && fs::exists(rows)) continue;
    throw DataError(
        fmt::format("{}: incomplete: {} not there: run the `volalign render --config` that "
                    "began it again, which continues it",
                    dir_.string(),
                    header_.complete ? rows.string() + " is"
                                     : fmt::format("not all {} samples are", header_.count)));
  }
}

std::vector<Sample> Dataset::Read(std::uint64_t first_index, int count) const {
  const std::uint64_t begin = header_.first_index, end = begin + header_.count;
  const std::uint64_t stop = first_index + static_cast<std::uint64_t>(count);
  if (count < 1 || first_index < begin || stop > end) {
    throw Error(fmt::format("samples {} to {} are not all in {}, which has {} to {}", first_index,
                            stop - 1, dir_.string(), begin, end - 1));
  }
  std::vector<Sample> samples;
  for (std::uint64_t i = first_index; i < stop;) {
    const fs::path path = dir_ / FolderName(header_, i) / kRowsName;
    const std::string text = ReadFile(path, kMaxLogBytes);
    const std::vector<std::string_view> lines = Lines(text);
    const std::uint64_t folder_end = NextFolder(header_, i);
    const std::uint64_t folder_begin =
        std::max(begin, folder_end - static_cast<std::uint64_t>(header_.samples_per_folder));
    for (; i < std::min(stop, folder_end); ++i) {
      const std::uint64_t line = i - folder_begin;
      if (line >= lines.size()) {
        throw DataError(fmt::format("{}: the row of sample {} is missing", path.string(), i));
      }
      Sample sample = ReadRow(lines[line], line + 1, path);
      if (sample.index != i) {
        throw DataError(fmt::format("{}: line {} is sample {}, not {}", path.string(), line + 1,
                                    sample.index, i));
      }
      const auto high = std::max_element(sample.labels.begin(), sample.labels.end());
      if (*high >= header_.structure.num_classes) {
        throw DataError(fmt::format("{}: sample {} has label {}, but its structure only {}",
                                    path.string(), i, *high, header_.structure.num_classes - 1));
      }
      samples.push_back(std::move(sample));
    }
  }
  return samples;
}

}  // namespace volalign
