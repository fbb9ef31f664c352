#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "core/config/config.h"
#include "core/geometry/structure.h"
#include "core/model/network_options.h"
#include "train/training_data_config.h"

namespace volalign {

std::vector<std::string> NetworkKinds();    // core/nn/network.h
std::vector<std::string> OptimizerNames();  // train/optimizer_rule.h

/// The network. Its number of classes is the structure's, and no key.
struct ModelConfig : StructureNetOptions {
  template <class Archive>
  void Describe(Archive& ar) {
    ar("kind", kind,
       "network: paper, or one that your own program registers (core/nn/network.h); volalign "
       "itself "
       "cannot load such a checkpoint",
       OneOf(NetworkKinds()));
    ar("base_channels", base_channels, "width c of the first convolution",
       Between(1, kMostBaseChannels));
    ar("attention", attention, "soft attention after the bottleneck and each decoder level");
    ar("normalization", normalization,
       "kind of normalisation after every convolution but the classifier");
    ar("input", input, "depth (metres, the paper) or depth_mask (centred and clamped depth, mask)");
    ar("residual_blocks", residual_blocks, "blocks in the bottleneck",
       Between(0, kMostResidualBlocks));
    ar("background_bias", background_bias, "initial bias of the background class");
  }
  StructureNetOptions Options(int of_structure) const {
    StructureNetOptions options = *this;
    options.num_classes = of_structure;
    return options;
  }
};

/// L = L_seg + lambda L_3D, the paper's loss; the defaults are the paper's.
struct LossConfig {
  bool procrustes = true;
  double lambda = 0.1;
  std::int64_t lambda_warmup_samples = 0;
  int min_side_pixels = 1;
  KeypointKind keypoints = KeypointKind::kCentre;
  std::vector<std::string> terms;
  std::vector<double> term_weights;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("procrustes", procrustes, "add the soft Procrustes term");
    ar("lambda", lambda, "weight of the soft Procrustes term", AtLeast(0));
    ar("lambda_warmup_samples", lambda_warmup_samples,
       "number of samples over which lambda rises linearly from 0", AtLeast(0));
    ar("min_side_pixels", min_side_pixels,
       "smallest number of pixels with which a side counts as visible", AtLeast(1));
    ar("keypoints", keypoints,
       "keypoint of a side: its centre (the paper), or exposed: the centre of the area that no "
       "other box covers");
    ar("terms", terms,
       "names of terms that the program registers (train/loss_term.h), added to the loss");
    ar("term_weights", term_weights, "weight of each of loss.terms", AtLeast(0),
       Removed("class_weights", "all labels weigh the same; register a loss term for others",
               std::vector<std::string>{}));
  }
};

enum class Schedule { kConstant, kOneCycle };
constexpr Words<Schedule, 2> WordsOf(Schedule) {
  return {{{"constant", Schedule::kConstant}, {"one_cycle", Schedule::kOneCycle}}};
}

struct OptimConfig {
  std::string optimizer = "adam";
  double lr = 2e-4;
  double beta1 = 0.9;
  double beta2 = 0.99;
  double weight_decay = 0;
  Schedule schedule = Schedule::kConstant;
  std::int64_t warmup_samples = 0;
  double clip_norm = 0;
  double ema_decay = 0;

  template <class Archive>
  void Describe(Archive& ar) {
    using Harmless = std::vector<std::string>;
    const char* const no_sgd = "a program may register an optimiser; leave the key out";
    const char* const cosine = "the schedule is constant or one_cycle; leave the key out";
    ar("optimizer", optimizer,
       "adam, adamw (decoupled weight decay), or one that your own program registers "
       "(train/optimizer_rule.h)",
       OneOf(OptimizerNames()));
    ar("lr", lr, "learning rate; the peak of a schedule", Above(0),
       Removed("momentum", no_sgd, Harmless{"0.9"}), Removed("nesterov", no_sgd, Harmless{"false"}),
       Removed("period_samples", cosine, Harmless{"0"}),
       Removed("step_factor", cosine, Harmless{"0.1"}),
       Removed("min_lr", "one_cycle falls to 0; leave the key out", Harmless{"0"}));
    ar("beta1", beta1, "decay of the gradient's mean", Between(0, 0.9999));
    ar("beta2", beta2, "decay of the gradient's square", Between(0, 0.999999));
    ar("weight_decay", weight_decay,
       "weight decay of convolution weights: adamw shrinks them by it, adam adds it times the "
       "weights to the gradient",
       AtLeast(0));
    ar("schedule", schedule,
       "learning rate after the warm-up: constant, or one_cycle (cosine to 0 at run.samples)");
    ar("warmup_samples", warmup_samples, "length of the linear warm-up", AtLeast(0));
    ar("clip_norm", clip_norm, "largest norm of the gradient; 0 leaves it as it is", AtLeast(0));
    ar("ema_decay", ema_decay,
       "decay per step of the averaged weights that are validated and shipped; 0: the weights "
       "themselves",
       Between(0, 0.999999));
  }
  /// Does the number of samples in a run change the learning rate before its end?
  bool DependsOnLength() const { return schedule == Schedule::kOneCycle; }
};

enum class Precision { kFp32, kBf16, kAuto };
constexpr Words<Precision, 3> WordsOf(Precision) {
  return {{{"fp32", Precision::kFp32}, {"bf16", Precision::kBf16}, {"auto", Precision::kAuto}}};
}

enum class Layout { kContiguous, kChannelsLast, kAuto };
constexpr Words<Layout, 3> WordsOf(Layout) {
  return {
      {{"false", Layout::kContiguous}, {"true", Layout::kChannelsLast}, {"auto", Layout::kAuto}}};
}

struct RunConfig {
  std::int64_t samples = 3200000;
  int batch_size = 16;
  int micro_batch = 0;
  std::string init;
  std::int64_t seed = 1;
  std::int64_t validation_seed = 1000001;
  int validation_samples = 256;
  std::int64_t validate_every = 50000;
  std::int64_t checkpoint_every = 20000;
  std::int64_t log_every = 160;
  bool tensorboard = true;
  Precision precision = Precision::kFp32;
  Layout channels_last = Layout::kContiguous;
  int threads = 0;
  int loader_threads = 1;
  std::string device = "cpu";
  double lost_after_s = 600;
  std::string dataset;
  std::string validation_dataset;

  template <class Archive>
  void Describe(Archive& ar) {
    using Harmless = std::vector<std::string>;
    ar("samples", samples,
       "length of the run. A resumed run may change it unless the learning rate depends on it "
       "(optim.schedule one_cycle)",
       AtLeast(1));
    ar("batch_size", batch_size, "samples per step, of all processes together", AtLeast(1));
    ar("micro_batch", micro_batch,
       "samples that pass the network at once, to save memory; 0: the whole batch. The gradients "
       "of the parts are summed, so only batch normalisation differs",
       AtLeast(0));
    ar("init", init,
       "checkpoint whose weights the run starts from (same network and labels); empty: Xavier");
    ar("seed", seed, "seed of weights and training samples", AtLeast(0),
       Removed("weight_seed", "run.seed is that of the weights, too", Harmless{"-1"}));
    ar("validation_seed", validation_seed,
       "seed of validation samples; has to differ from run.seed", AtLeast(0));
    ar("validation_samples", validation_samples,
       "number of validation samples, rounded up to whole batches; 0: no validation", AtLeast(0));
    ar("validate_every", validate_every, "samples between validations", AtLeast(1));
    ar("checkpoint_every", checkpoint_every,
       "samples between saved states, of which the two newest are kept", AtLeast(1),
       Removed("keep_states", "the two newest states are kept", Harmless{"2"}),
       Removed("patience",
               "best.safetensors has the best validation, and the run goes on to run.samples",
               Harmless{"0"}),
       Removed("best_metric", "best.safetensors is that of the best miou", Harmless{"miou"}),
       Removed("half_checkpoint", "model.safetensors has float16 weights, and states have float32",
               Harmless{"true"}));
    ar("log_every", log_every, "samples between rows of metrics.jsonl", AtLeast(1));
    ar("tensorboard", tensorboard,
       "write event files for TensorBoard (tensorboard/ in the run folder): metrics, label "
       "pictures, configuration");
    ar("precision", precision,
       "fp32, bf16 or auto. Depth, the first convolution and the soft Procrustes term always are "
       "fp32. Auto is bf16 if the processor has instructions for it, or the CUDA device has "
       "compute capability 8 or higher. A resumed run keeps its choice");
    ar("channels_last", channels_last,
       "memory layout of the activations; auto: true on a CPU and with bf16");
    ar("threads", threads,
       "threads of LibTorch in a process; 0: one for each processor that is idle at the start",
       AtLeast(0));
    ar("loader_threads", loader_threads, "threads that render or read samples", AtLeast(1),
       Removed("prefetch", "four batches are rendered or read ahead", Harmless{"4"}));
    ar("device", device,
       "cpu, cuda or cuda:N. If several processes run on a machine, each takes the CUDA device of "
       "its LOCAL_RANK");
    ar("lost_after_s", lost_after_s,
       "seconds without a message after which another process of the run counts as lost", Above(0));
    ar("dataset", dataset,
       "folder of `volalign render --config` to train on, written from the same data section; "
       "empty: render");
    ar("validation_dataset", validation_dataset,
       "folder like run.dataset to validate on, of any recipe for the same structure; empty: "
       "render");
  }
};

/// A whole training run, as in configs/m01.yaml.
struct TrainConfig {
  TrainingDataConfig data;
  ModelConfig model;
  LossConfig loss;
  OptimConfig optim;
  RunConfig run;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("data", data, "training samples");
    ar("model", model, "network");
    ar("loss", loss, "loss");
    ar("optim", optim, "optimiser");
    ar("run", run, "run");
  }
  /// Checks conditions on several keys together. Throws ConfigError.
  void Validate() const;
};

/// Reads, checks and validates. Throws ConfigError; for a removed key, with its former meaning.
TrainConfig ReadTrainConfig(const ConfigSource& source);

/// The same for the output of WriteConfig of this or an earlier version, without Validate. `name`
/// is its place, for messages.
TrainConfig ReadSavedConfig(const std::string& yaml, const std::string& name);

}  // namespace volalign
