#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "core/config/config.h"
#include "core/config/config_word.h"
#include "core/geometry/structure.h"
#include "core/model/network_limits.h"
#include "train/training_data_config.h"

namespace volalign {

struct StructureNetOptions;
std::vector<std::string> NetworkKinds();  // core/nn/network.h

/// The network, but for the number of classes, which the structure gives
/// (core/model/network_options.h).
struct ModelConfig {
  std::string kind = "paper";
  int base_channels = 32;
  bool attention = true;
  std::string normalization = "none";
  std::string input = "depth";
  int residual_blocks = 4;
  double background_bias = 0;

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
    ar("normalization", normalization, "after every convolution but the classifier",
       OneOf({"none", "batch", "group"}));
    ar("input", input, "depth (metres, the paper) or depth_mask (centred and clamped depth, mask)",
       OneOf({"depth", "depth_mask"}));
    ar("residual_blocks", residual_blocks, "blocks in the bottleneck",
       Between(0, kMostResidualBlocks));
    ar("background_bias", background_bias, "initial bias of the background class");
  }
  StructureNetOptions Options(int num_classes) const;
};

/// L = L_seg + lambda L_3D, the paper's loss; the defaults are the paper's.
struct LossConfig {
  bool procrustes = true;
  double lambda = 0.1;
  std::int64_t lambda_warmup_samples = 0;
  int min_side_pixels = 1;
  std::string keypoints = "centre";
  std::vector<std::string> terms;
  std::vector<double> term_weights;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("procrustes", procrustes, "add the soft Procrustes term");
    ar("lambda", lambda, "weight of the soft Procrustes term", AtLeast(0));
    ar("lambda_warmup_samples", lambda_warmup_samples,
       "lambda rises linearly from 0 over so many samples", AtLeast(0));
    ar("min_side_pixels", min_side_pixels, "a side counts as visible from so many pixels on",
       AtLeast(1));
    ar("keypoints", keypoints, "point that stands for a side: centre (the paper) or exposed",
       OneOf({"centre", "exposed"}));
    ar("terms", terms,
       "names of terms that the program registers (train/loss_term.h), added to the loss");
    ar("term_weights", term_weights, "weight of each of loss.terms", AtLeast(0),
       Removed("class_weights", "all labels weigh the same; register a loss term for others",
               std::vector<std::string>{}));
  }
};
KeypointKind ParseKeypointKind(const std::string& word);

enum class OptimizerKind { kAdam, kAdamW, kSgd };
inline constexpr std::array<std::pair<const char*, OptimizerKind>, 3> kOptimizers{
    {{"adam", OptimizerKind::kAdam},
     {"adamw", OptimizerKind::kAdamW},
     {"sgd", OptimizerKind::kSgd}}};

enum class Schedule { kConstant, kOneCycle, kCosine, kStep };
inline constexpr std::array<std::pair<const char*, Schedule>, 4> kSchedules{
    {{"constant", Schedule::kConstant},
     {"one_cycle", Schedule::kOneCycle},
     {"cosine", Schedule::kCosine},
     {"step", Schedule::kStep}}};

struct OptimConfig {
  OptimizerKind optimizer = OptimizerKind::kAdam;
  double lr = 2e-4;
  double beta1 = 0.9;
  double beta2 = 0.99;
  double momentum = 0.9;
  bool nesterov = false;
  double weight_decay = 0;
  Schedule schedule = Schedule::kConstant;
  std::int64_t warmup_samples = 0;
  std::int64_t period_samples = 0;
  double step_factor = 0.1;
  double min_lr = 0;
  double clip_norm = 0;
  double ema_decay = 0;

  template <class Archive>
  void Describe(Archive& ar) {
    DescribeWord(ar, "optimizer", optimizer, kOptimizers,
                 "adam, adamw (decoupled weight decay), or sgd (stochastic gradient descent with "
                 "momentum)");
    ar("lr", lr, "learning rate; the peak of a schedule", Above(0));
    ar("beta1", beta1, "adam, adamw: decay of the gradient's mean", Between(0, 0.9999));
    ar("beta2", beta2, "adam, adamw: decay of the gradient's square", Between(0, 0.999999));
    ar("momentum", momentum, "sgd: share of the step before that is added to a step",
       Between(0, 0.9999));
    ar("nesterov", nesterov, "sgd: Nesterov's momentum");
    ar("weight_decay", weight_decay,
       "of convolution weights only: adamw shrinks them by it, adam and sgd add it times the "
       "weights to the gradient",
       AtLeast(0));
    DescribeWord(ar, "schedule", schedule, kSchedules,
                 "after the warm-up: constant; one_cycle (cosine to min_lr at run.samples); cosine "
                 "(to min_lr after period_samples, then again from lr); step (times step_factor "
                 "every period_samples)");
    ar("warmup_samples", warmup_samples, "length of the linear warm-up", AtLeast(0));
    ar("period_samples", period_samples,
       "of cosine and step; 0 with cosine: the rest of the run after the warm-up", AtLeast(0));
    ar("step_factor", step_factor, "of step", Above(0));
    ar("min_lr", min_lr, "learning rate to which one_cycle and cosine fall", AtLeast(0));
    ar("clip_norm", clip_norm, "largest norm of the gradient; 0 leaves it as it is", AtLeast(0));
    ar("ema_decay", ema_decay,
       "decay per step of the averaged weights that are validated and shipped; 0: the weights "
       "themselves",
       Between(0, 0.999999));
  }
  /// Whether the number of samples in a run changes the learning rate on the way there.
  bool DependsOnLength() const;
  /// What no single key can say. Throws ConfigError.
  void Validate() const;
};

enum class Precision { kFp32, kBf16, kAuto };
inline constexpr std::array<std::pair<const char*, Precision>, 3> kPrecisions{
    {{"fp32", Precision::kFp32}, {"bf16", Precision::kBf16}, {"auto", Precision::kAuto}}};

enum class Layout { kContiguous, kChannelsLast, kAuto };
/// Words of run.channels_last.
inline constexpr std::array<std::pair<const char*, Layout>, 3> kLayouts{
    {{"false", Layout::kContiguous}, {"true", Layout::kChannelsLast}, {"auto", Layout::kAuto}}};

struct RunConfig {
  std::int64_t samples = 3200000;
  int batch_size = 16;
  int micro_batch = 0;
  std::string init;
  std::int64_t seed = 1;
  std::int64_t weight_seed = -1;
  std::int64_t validation_seed = 1000001;
  int validation_samples = 256;
  std::int64_t validate_every = 50000;
  std::int64_t checkpoint_every = 20000;
  int keep_states = 2;
  int patience = 0;
  std::int64_t log_every = 160;
  bool tensorboard = true;
  Precision precision = Precision::kFp32;
  Layout channels_last = Layout::kContiguous;
  bool half_checkpoint = true;
  int threads = 0;
  int loader_threads = 1;
  int prefetch = 4;
  std::string device = "cpu";
  double lost_after_s = 600;
  std::string dataset;
  std::string validation_dataset;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("samples", samples,
       "length of the run; a resumed run may have another one unless the learning rate depends on "
       "it (optim.schedule one_cycle, or cosine without period_samples)",
       AtLeast(1));
    ar("batch_size", batch_size, "samples per step, of all processes together", AtLeast(1));
    ar("micro_batch", micro_batch,
       "samples that pass the network at once, for less memory: a step adds up the gradients of "
       "its batch's parts, which is the whole batch's gradient except with batch normalisation, "
       "whose statistics are those of a part; 0: the whole batch",
       AtLeast(0));
    ar("init", init,
       "checkpoint whose weights the run starts from (same network and labels); empty: Xavier");
    ar("seed", seed, "of weights and training samples", AtLeast(0));
    ar("weight_seed", weight_seed, "of the weights alone; -1: that of run.seed", AtLeast(-1));
    ar("validation_seed", validation_seed, "of validation samples; has to differ from run.seed",
       AtLeast(0));
    ar("validation_samples", validation_samples, "rounded up to whole batches; 0: no validation",
       AtLeast(0));
    ar("validate_every", validate_every, "samples between validations", AtLeast(1));
    ar("checkpoint_every", checkpoint_every, "samples between saved states", AtLeast(1));
    ar("keep_states", keep_states, "number of the newest states that are kept", AtLeast(1));
    ar("patience", patience,
       "validations in a row without a better miou after which the run ends; 0: never", AtLeast(0),
       Removed("best_metric", "best.pt is that of the best miou",
               std::vector<std::string>{"miou"}));
    ar("log_every", log_every, "samples between rows of metrics.jsonl", AtLeast(1));
    ar("tensorboard", tensorboard,
       "write event files for TensorBoard (tensorboard/ in the run folder): metrics, label "
       "pictures, configuration");
    DescribeWord(ar, "precision", precision, kPrecisions,
                 "fp32; bf16 for everything but depth, the first convolution and the soft "
                 "Procrustes term; auto: bf16 on a processor that has instructions for it and on a "
                 "CUDA device of compute capability 8 or higher, else fp32; a resumed run keeps "
                 "what was chosen");
    DescribeWord(ar, "channels_last", channels_last, kLayouts,
                 "memory layout of the activations; auto: true on a CPU and with bf16");
    ar("half_checkpoint", half_checkpoint, "store model.pt's weights as float16");
    ar("threads", threads,
       "threads of LibTorch in a process; 0: one for each processor that is idle at the start",
       AtLeast(0));
    ar("loader_threads", loader_threads, "threads that render or read samples", AtLeast(1));
    ar("prefetch", prefetch, "batches rendered or read ahead", AtLeast(1));
    ar("device", device,
       "cpu, cuda or cuda:N; of several processes on a machine each takes the CUDA device of its "
       "LOCAL_RANK");
    ar("lost_after_s", lost_after_s,
       "a process of a run of several that is not heard of for so long counts as lost, s",
       Above(0));
    ar("dataset", dataset,
       "folder of `volalign render --config` to train on, written from the same data section; "
       "empty: render");
    ar("validation_dataset", validation_dataset,
       "such a folder to validate on, of any recipe for the same structure; empty: render");
  }
  std::int64_t WeightSeed() const { return weight_seed < 0 ? seed : weight_seed; }
};

/// A whole training run: configs/m01.yaml and its like.
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
  /// What no single key can say. Throws ConfigError.
  void Validate() const;
  /// Whether the run has validations, on rendered samples or on recorded frames.
  bool Validates() const;
};

/// Reads, checks, validates. Throws ConfigError, for a key that there was once with what it meant.
TrainConfig ReadTrainConfig(const ConfigSource& source);

/// The same of what WriteConfig of this or an earlier version wrote, without Validate; `name` is
/// where it stands, for messages.
TrainConfig ReadSavedConfig(const std::string& yaml, const std::string& name);

}  // namespace volalign
