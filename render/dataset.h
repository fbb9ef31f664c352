#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "render/depth_renderer.h"
#include "render/sample.h"

namespace volalign {

/// Samples on disk, format "volalign.samples/2" (docs/formats.md). index.json describes their
/// sources. There is one folder per thousand samples. It has 16-bit depth and 8-bit label PNGs, and
/// a row per sample in samples.jsonl.
struct DatasetHeader {
  /// The structure in the images.
  struct Shown {
    std::string name, sha256;  ///< Structure::Hash()
    int num_classes = 1;       ///< labels, including background

    template <class Archive>
    void Describe(Archive& ar) {
      ar("name", name);
      ar("sha256", sha256);
      ar("num_classes", num_classes);
    }
  };
  std::string data_yaml;  ///< the resolved SampleConfig
  std::uint64_t seed = 0;
  std::uint64_t first_index = 0;
  std::uint64_t count = 0;  ///< number of samples when complete
  bool complete = false;    ///< all `count` samples exist
  int batch_size = 16;      ///< samples of index / batch_size share one image size
  int samples_per_folder = 1000;
  Shown structure;
  std::string intrinsics_hash;           ///< of the pool of the intrinsics
  std::vector<std::string> image_sizes;  ///< WIDTHxHEIGHT

  /// SHA-256 over everything that decides the samples and their order.
  std::string Identity() const;
};

struct DatasetOptions {
  std::uint64_t seed = 0;
  std::uint64_t first_index = 0;
  std::uint64_t count = 0;
  int num_threads = 1;  ///< threads that render; as many again compress and write
  RendererFactory make_renderer = nullptr;  ///< called by each rendering thread; required
  int samples_per_folder = 1000;
  bool progress = false;  ///< a ProgressLine
};

struct DatasetResult {
  std::uint64_t found = 0;    ///< samples of an earlier run
  std::uint64_t written = 0;  ///< samples of this run
};

/// Draws samples first_index, ..., first_index + count - 1 and writes them to `dir`, with a
/// contact_sheet.png of the first 24. The bytes do not depend on the number of threads. A run that
/// was interrupted or had a smaller count is continued after its last row: a row is written after
/// its images were synced. Depth is rounded to 1 mm, as by all sensor models. depth_clean and
/// labels_clean are not kept. Throws ConfigError if `dir` has samples of another seed,
/// configuration or structure, or more than `count`. Throws IoError if another process writes
/// there, or the disk is full.
DatasetResult WriteDataset(const std::filesystem::path& dir,
                           std::shared_ptr<const SampleContext> context,
                           const DatasetOptions& options);

/// The keys that differ between a header's data section and `context`, one line per key, e.g.
/// "data.noise.models = sensor (dataset: paper)". Empty if both draw the same samples. The files
/// are compared, not their paths; renderers are not compared. A key that the dataset does not know
/// had the effect of its default.
std::vector<std::string> DifferencesFrom(const DatasetHeader& header, const SampleContext& context);

/// Reads datasets of WriteDataset; immutable, for any number of threads.
class Dataset {
 public:
  /// Throws IoError without index.json. Throws DataError for another format, an incomplete dataset
  /// (with the number of missing samples) or a missing folder.
  explicit Dataset(std::filesystem::path dir);

  const DatasetHeader& header() const { return header_; }
  const std::filesystem::path& dir() const { return dir_; }

  /// Samples [first_index, first_index + count), without depth_clean and labels_clean. Throws Error
  /// outside of the dataset. Throws IoError or DataError, with the file, for an image that is
  /// missing, damaged, of another size than its intrinsics, or with labels that the structure does
  /// not have.
  std::vector<Sample> Read(std::uint64_t first_index, int count) const;

 private:
  std::filesystem::path dir_;
  DatasetHeader header_;
};

}  // namespace volalign
