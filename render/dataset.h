#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "render/depth_renderer.h"
#include "render/sample.h"

namespace volalign {

/// Samples on disk, format "volalign.samples/2" (docs/formats.md): index.json says what they were
/// drawn from, one folder a thousand samples holds 16-bit depth and 8-bit label PNGs and a row a
/// sample in samples.jsonl.
struct DatasetHeader {
  std::string data_yaml;  ///< the resolved SampleConfig
  std::uint64_t seed = 0;
  std::uint64_t first_index = 0;
  std::uint64_t count = 0;  ///< samples when complete
  bool complete = false;    ///< all `count` samples are there
  int batch_size = 16;      ///< samples of index / batch_size share one image size
  int samples_per_folder = 1000;
  std::string structure_name;
  std::string structure_hash;            ///< Structure::Hash()
  int num_classes = 1;                   ///< labels in the images, background included
  std::string intrinsics_hash;           ///< of the pool that intrinsics were drawn from
  std::vector<std::string> image_sizes;  ///< WIDTHxHEIGHT

  /// SHA-256 over everything that decides which samples are read in which order.
  std::string Identity() const;
};

struct DatasetOptions {
  std::uint64_t seed = 0;
  std::uint64_t first_index = 0;
  std::uint64_t count = 0;
  int num_threads = 1;                      ///< that render, and as many that compress and write
  RendererFactory make_renderer = nullptr;  ///< called by each thread that renders; must be given
  int samples_per_folder = 1000;
  bool progress = false;  ///< a ProgressLine
};

struct DatasetResult {
  std::uint64_t found = 0;    ///< samples that an earlier run had written
  std::uint64_t written = 0;  ///< by this one
};

/// Draws samples first_index, ..., first_index + count - 1 and writes them to `dir`, with a
/// contact_sheet.png of the first 24. The bytes do not depend on the number of threads. An
/// interrupted run, or one with a smaller count, is continued where its last row stands: a row is
/// written after its images were synced, both by renaming. Depth is rounded to 1 mm, as all sensor
/// models leave it; depth_clean and labels_clean are not kept.
/// Throws ConfigError when `dir` holds samples of another seed, configuration or structure, or more
/// than `count`; IoError when another process writes there, or the disk is full.
DatasetResult WriteDataset(const std::filesystem::path& dir,
                           std::shared_ptr<const SampleContext> context,
                           const DatasetOptions& options);

/// The keys of a header's data section and of `context` that differ, one line for each key, e.g.
/// "data.noise.models = sensor (dataset: paper)"; empty when both draw the same samples. Paths are
/// not compared, what they name is; nor are renderers. A key that the dataset does not know had its
/// default's effect.
std::vector<std::string> DifferencesFrom(const DatasetHeader& header, const SampleContext& context);

/// Reads what WriteDataset wrote; immutable, for any number of threads.
class Dataset {
 public:
  /// Throws IoError without index.json, DataError for another format, an incomplete dataset (says
  /// how many samples are missing) or a folder that is gone.
  explicit Dataset(std::filesystem::path dir);

  const DatasetHeader& header() const { return header_; }
  const std::filesystem::path& dir() const { return dir_; }

  /// Samples [first_index, first_index + count), without depth_clean and labels_clean. Throws Error
  /// outside the dataset; IoError or DataError, naming the file, for an image that is missing,
  /// damaged, of another size than its intrinsics, or with labels that the structure does not have.
  std::vector<Sample> Read(std::uint64_t first_index, int count) const;

 private:
  std::filesystem::path dir_;
  DatasetHeader header_;
};

}  // namespace volalign
