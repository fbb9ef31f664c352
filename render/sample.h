#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/base/batch_slice.h"
#include "core/base/image.h"
#include "core/geometry/camera.h"
#include "core/geometry/pose.h"
#include "core/geometry/structure.h"
#include "render/depth_renderer.h"
#include "render/sample_config.h"

namespace volalign {

class RandomStream;

/// One training sample. All images have the intrinsics' size.
struct Sample {
  std::uint64_t index = 0;
  DepthImage depth;         ///< m, as the sensor would give it; 0 for no measurement
  LabelImage labels;        ///< training labels: 0 where noise removed the depth
  DepthImage depth_clean;   ///< before noise
  LabelImage labels_clean;  ///< before noise
  Intrinsics intrinsics;
  std::string sensor;  ///< pool name of the sensor whose intrinsics and noise were drawn
  Pose structure_from_sensor = Pose::Identity();
  /// structure_from_structure displacement of each box from its nominal place; identities for exact
  /// assembly. Includes the vertical shifts that keep scaled boxes stacked.
  std::vector<Pose> box_offsets;
  double size_scale = 1;  ///< of all boxes, about their own centres (Structure::Displaced)
};

/// A SampleConfig with its files and choices; immutable, shared by worker threads.
struct SampleContext {
  SampleConfig config;
  Structure structure;
  std::vector<IntrinsicsPoolEntry> pool;         ///< of the configured sensors
  std::vector<std::pair<int, int>> image_sizes;  ///< width, height
  int batch_size = 16;  ///< the image size is a function of index / batch_size
};

/// The pool's entries for these sensors; all of them if there is none.
std::vector<IntrinsicsPoolEntry> EntriesOf(const std::vector<std::string>& sensors,
                                           const std::vector<IntrinsicsPoolEntry>& pool);

/// Reads config.structure unless `structure` is given, and config.intrinsics unless `intrinsics`
/// are. Throws ConfigError for an unknown sensor, an image size without a sensor of its aspect
/// ratio, and a sensor without an image size of its own. Throws IoError or DataError.
SampleContext MakeSampleContext(const SampleConfig& config, int batch_size,
                                const Structure* structure = nullptr,
                                const std::vector<IntrinsicsPoolEntry>* intrinsics = nullptr);

/// Draws structure_from_sensor as the paper does (Results, "Implementation details"). The position
/// is (rho cos phi, y, rho sin phi), with phi uniform or around one of config.phi_deg. The look-at
/// point is uniform in a ball about the origin. The sensor is levelled, then turned by a roll and a
/// mounting offset. Throws Error if config.roll_offsets_deg is empty.
Pose SamplePose(const PoseConfig& config, RandomStream& random);

/// A pure function of its arguments: the same bytes after any earlier draws and on any thread. An
/// OpenGL renderer needs its context current on the calling thread.
Sample Synthesize(const SampleContext& context, DepthRenderer& renderer, std::uint64_t seed,
                  std::uint64_t index);

struct StreamOptions {
  std::uint64_t seed = 0;
  std::uint64_t first_index = 0;  ///< a multiple of context.batch_size
  int num_threads = 1;
  RendererFactory make_renderer = nullptr;             ///< called by each worker thread; required
  BatchSlice slice = {};                               ///< other samples are left out
  std::function<void(const Sample&)> drawn = nullptr;  ///< called by the worker, for each sample
  int prefetch = 4;                                    ///< most batches that wait in memory
};

/// Consecutive samples, one per call, drawn on worker threads, each with its own renderer. They
/// come in order for any number of threads. The stream rethrows a worker's exception. Throws Error
/// for other options.
std::function<Sample()> StreamSamples(std::shared_ptr<const SampleContext> context,
                                      const StreamOptions& options);

}  // namespace volalign
