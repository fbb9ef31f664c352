#include <memory>
#include <utility>

#include "render/sample.h"
#include "render/sample_stream.h"
#include "train/trainer.h"

namespace volalign {
namespace {

class RenderedSource : public SampleSource {
 public:
  RenderedSource(std::shared_ptr<const SampleContext> context, const SampleStream::Options& options)
      : stream_(std::move(context), options) {}
  std::vector<Sample> Next() override { return stream_.Next(); }

 private:
  SampleStream stream_;
};

}  // namespace

TrainResult Train(const TrainConfig& config, const TrainOptions& options) {
  const auto context =
      std::make_shared<const SampleContext>(MakeSampleContext(config.data, config.run.batch_size));
  TrainingData data;
  data.structure = context->structure;
  data.open = [&](std::uint64_t seed, std::uint64_t first_index) {
    SampleStream::Options stream;
    stream.seed = seed;
    stream.first_index = first_index;
    stream.num_threads = config.run.loader_threads;
    stream.prefetch = config.run.prefetch;
    return std::make_unique<RenderedSource>(context, stream);
  };
  return TrainOn(data, config, options);
}

}  // namespace volalign
