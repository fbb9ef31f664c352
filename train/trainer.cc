#include "train/trainer.h"

#include <ATen/Context.h>
#include <ATen/ops/stack.h>
#include <c10/core/GradMode.h>
#include <fmt/format.h>
#include <torch/cuda.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <sstream>

#include "core/checkpoint.h"
#include "core/error.h"
#include "core/file_util.h"
#include "train/losses.h"
#include "train/optimizer.h"

namespace volalign {
namespace {

using nlohmann::json;
using Clock = std::chrono::steady_clock;

constexpr char kStateFormat[] = "volalign.training/1";

double Seconds(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

std::atomic<bool> g_interrupted{false};
static_assert(std::atomic<bool>::is_always_lock_free);

/// While it lives, SIGINT and SIGTERM only set a flag.
class InterruptGuard {
 public:
  InterruptGuard() {
    g_interrupted = false;
    struct sigaction action {};
    action.sa_handler = [](int) { g_interrupted = true; };
    sigaction(SIGINT, &action, &old_int_);
    sigaction(SIGTERM, &action, &old_term_);
  }
  ~InterruptGuard() {
    sigaction(SIGINT, &old_int_, nullptr);
    sigaction(SIGTERM, &old_term_, nullptr);
  }
  InterruptGuard(const InterruptGuard&) = delete;
  InterruptGuard& operator=(const InterruptGuard&) = delete;

 private:
  struct sigaction old_int_ {
  }, old_term_{};
};

at::Device ParseDevice(const std::string& name) {
  at::Device device(at::kCPU);
  try {
    device = at::Device(name);
  } catch (const std::exception&) {
    throw ConfigError(fmt::format("run.device = '{}' is no device: use cpu, cuda or cuda:N", name));
  }
  if (!device.is_cpu() && !device.is_cuda()) {
    throw ConfigError(fmt::format("run.device = '{}' is no device: use cpu, cuda or cuda:N", name));
  }
  if (device.is_cuda() && !torch::cuda::is_available()) {
    throw ConfigError(fmt::format(
        "run.device = '{}': this LibTorch finds no CUDA device: use run.device = cpu", name));
  }
  return device;
}

/// Keys that may differ when a run is resumed: they change no sample and no step. The length of a
/// one_cycle run does: its learning rate falls to zero there.
const std::set<std::string>& FreeKeys() {
  static const std::set<std::string> keys = {"run.samples",        "run.validation_samples",
                                             "run.validate_every", "run.checkpoint_every",
                                             "run.log_every",      "run.half_checkpoint",
                                             "run.threads",        "run.loader_threads",
                                             "run.prefetch",       "run.device",
                                             "run.dataset",        "run.validation_dataset"};
  return keys;
}

void RequireSameRun(const std::string& old_yaml, const TrainConfig& config,
                    const std::string& path) {
  // A key that did not exist yet when the state was saved had its default's effect.
  const ConfigSource before = ConfigSource::FromString(
      WriteConfig(ReadConfig<TrainConfig>(ConfigSource::FromString(old_yaml, path))), path);
  const ConfigSource now = ConfigSource::FromString(WriteConfig(config), "the given configuration");
  const bool length_matters = config.optim.schedule == "one_cycle";
  for (const auto& [key, leaf] : now.leaves()) {
    const std::vector<std::string>& values = before.leaves().at(key).values;
    if (length_matters && key == "run.samples" && values != leaf.values) {
      throw ConfigError(fmt::format(
          "run.samples = {} differs from {} in {}: with optim.schedule = one_cycle the learning "
          "rate depends on it, and would jump: resume with the run's own, or start a new run from "
          "its weights with run.init",
          fmt::join(leaf.values, ", "), fmt::join(values, ", "), path));
    }
    if (FreeKeys().count(key) > 0) continue;
    if (values != leaf.values) {
      throw ConfigError(fmt::format(
          "{} = {} differs from {} in {}: resume with the run's own config.yaml, or start a new "
          "run",
          key, fmt::join(leaf.values, ", "), fmt::join(values, ", "), path));
    }
  }
}

/// Means over the steps since the last row.
struct Window {
  double loss = 0, segmentation = 0, procrustes = 0, gradient_norm = 0;
  std::int64_t degenerate = 0, steps = 0;
  double data_s = 0, forward_s = 0, loss_s = 0, backward_s = 0, optim_s = 0;
  Clock::time_point start = Clock::now();
};

std::string Duration(double seconds) {
  const auto s = static_cast<long>(std::max(0.0, seconds));
  if (s >= 3600) return fmt::format("{}h{:02}m", s / 3600, s / 60 % 60);
  return fmt::format("{}m{:02}s", s / 60, s % 60);
}

/// A bar that redraws itself on a terminal; plain lines elsewhere.
class Progress {
 public:
  explicit Progress(bool quiet) : quiet_(quiet), terminal_(isatty(STDERR_FILENO) != 0) {}

  void Row(std::int64_t samples, std::int64_t total, double loss, double rate, double lr) {
    if (quiet_) return;
    const double share = static_cast<double>(samples) / static_cast<double>(total);
    const std::string text = fmt::format(
        "{}/{}  loss {:.4f}  {:.1f} samples/s  lr {:.2e}  {} left", samples, total, loss, rate, lr,
        Duration(static_cast<double>(total - samples) / std::max(rate, 1e-9)));
    if (terminal_) {
      constexpr int kWidth = 30;
      const int full = static_cast<int>(share * kWidth);
      fmt::print(stderr, "\r[{:=<{}}{:<{}}] {}\033[K", "", full, "", kWidth - full, text);
    } else {
      fmt::print(stderr, "{:5.1f} %  {}\n", 100 * share, text);
    }
    std::fflush(stderr);
  }

  void Line(const std::string& text) {
    if (quiet_) return;
    fmt::print(stderr, "{}{}\n", terminal_ ? "\r\033[K" : "", text);
  }

 private:
  bool quiet_, terminal_;
};

class Trainer {
 public:
  Trainer(const TrainingData& data, const TrainConfig& config, const TrainOptions& options)
      : data_(data),
        config_(config),
        options_(options),
        device_(ParseDevice(config.run.device)),
        progress_(options.quiet) {
    at::manual_seed(static_cast<std::uint64_t>(config.run.seed));
    const StructureNetOptions net_options = config.model.Options(data.structure.num_classes());
    net_ = StructureNet(net_options);
    net_->to(device_);
    if (!config.run.init.empty() && !options.resume) StartFrom(config.run.init);
    flat_.emplace(*net_);
    adam_.emplace(config.optim, &*flat_);
    average_ = StructureNet(net_options);
    average_->to(device_);
    flat_average_.emplace(*average_);
    CopyToAverage();
    const at::ScalarType type = config.run.precision == "bf16" ? at::kBFloat16 : at::kFloat;
    net_->SetComputeType(type);
    average_->SetComputeType(type);
    loss_.emplace(config.loss, data.structure, device_);
  }

  TrainResult Run() {
    OpenRunFolder();
    InterruptGuard guard;
    TrainResult result;
    result.checkpoint = options_.run_dir / "model.pt";
    const RunConfig& run = config_.run;
    const std::int64_t stop = options_.stop_at_samples > 0
                                  ? std::min(options_.stop_at_samples, run.samples)
                                  : run.samples;
    std::unique_ptr<SampleSource> source;
    if (samples_ < stop) {
      source =
          data_.open(static_cast<std::uint64_t>(run.seed), static_cast<std::uint64_t>(samples_));
    }
    Window window;
    std::int64_t saved = samples_;
    std::int64_t validated = -1;
    while (samples_ < stop && !g_interrupted) {
      result.loss = Step(*source, &window);
      const std::int64_t before = samples_ - run.batch_size;
      const bool last = samples_ >= stop;
      if (Crossed(before, samples_, run.log_every) || last) {
        WriteTrainRow(&window);
        window = Window();
      }
      if (Crossed(before, samples_, run.validate_every)) {
        result.validation = ValidateNow();
        validated = samples_;
        window.start = Clock::now();
      }
      if (Crossed(before, samples_, run.checkpoint_every)) {
        SaveAll();
        saved = samples_;
        window.start = Clock::now();
      }
    }
    result.samples = samples_;
    result.finished = samples_ >= run.samples;
    if (result.finished && validated != samples_) result.validation = ValidateNow();
    if (saved != samples_ || !std::filesystem::exists(result.checkpoint)) SaveAll();
    metrics_.close();
    progress_.Line(fmt::format("{} after {} samples: {}",
                               result.finished ? "finished" : "stopped (continue with --resume)",
                               samples_, result.checkpoint.string()));
    return result;
  }

 private:
  void StartFrom(const std::string& path) {
    const LoadedModel model = LoadCheckpoint(path);
    if (!(model.meta.network == net_->options())) {
      throw ConfigError(
          fmt::format("run.init = {}: its network differs from the one that `model` describes; its "
                      "configuration is:\n{}",
                      path, model.meta.config_yaml));
    }
    CheckStructure(model.meta, data_.structure);
    std::map<std::string, at::Tensor> tensors;
    AddModuleTensors(*model.net, "", &tensors);
    CopyIntoModule(tensors, "", *net_, path);
    init_samples_ = model.meta.samples;
  }

  static bool Crossed(std::int64_t before, std::int64_t after, std::int64_t every) {
    return before / every != after / every;
  }

  std::filesystem::path StatePath() const { return options_.run_dir / "last.state"; }

  void OpenRunFolder() {
    const std::filesystem::path metrics = options_.run_dir / "metrics.jsonl";
    const bool exists = std::filesystem::exists(StatePath());
    if (options_.resume) {
      if (!exists) {
        throw IoError(fmt::format("{}: no such file, so there is nothing to resume: drop --resume",
                                  StatePath().string()));
      }
      LoadState();
    } else if (exists) {
      throw Error(fmt::format("{} holds a run already: use --resume, or another --run-dir",
                              options_.run_dir.string()));
    }
    WriteFileAtomically(options_.run_dir / "config.yaml", WriteConfig(config_));
    // Rows that were written after the state was saved will come again.
    std::string kept;
    if (options_.resume && std::filesystem::exists(metrics)) {
      std::istringstream rows(ReadFile(metrics));
      for (std::string row; std::getline(rows, row);) {
        const json j = json::parse(row, nullptr, /*allow_exceptions=*/false);
        if (j.is_object() && j.value("samples", std::int64_t{0}) <= samples_) kept += row + "\n";
      }
    }
    WriteFileAtomically(metrics, kept);
    metrics_.open(metrics, std::ios::app);
    if (!metrics_) throw IoError(fmt::format("{}: cannot be written", metrics.string()));
  }

  void Synchronize() const {
    if (device_.is_cuda()) torch::cuda::synchronize(device_.index());
  }

  at::Tensor Encode(const at::Tensor& depth) const {
    const at::Tensor input = EncodeDepth(depth, net_->options().input);
    return config_.run.channels_last ? input.contiguous(at::MemoryFormat::ChannelsLast) : input;
  }

  double Step(SampleSource& source, Window* window) {
    const auto t0 = Clock::now();
    const std::vector<Sample> drawn = source.Next();
    const Batch batch = Collate(drawn).To(device_);
    NoteCameras(drawn);
    const auto t1 = Clock::now();
    net_->train();
    const at::Tensor log_probs = net_->forward(Encode(batch.depth));
    Synchronize();
    const auto t2 = Clock::now();
    const LossTerms terms = (*loss_)(log_probs, batch.depth, batch.labels, batch.rays, samples_);
    Synchronize();
    const auto t3 = Clock::now();
    terms.total.backward();
    Synchronize();
    const auto t4 = Clock::now();
    const at::Tensor norm = adam_->GradientNorm();
    // One transfer a step, before the weights change, so that no bad step ever reaches them.
    const at::Tensor numbers = at::stack({terms.total.detach().to(at::kDouble),
                                          terms.segmentation.detach().to(at::kDouble),
                                          terms.procrustes.detach().to(at::kDouble),
                                          terms.degenerate.to(at::kDouble), norm.to(at::kDouble)})
                                   .to(at::kCPU);
    const double* value = numbers.data_ptr<double>();
    if (!std::isfinite(value[0]) || !std::isfinite(value[4])) {
      throw Error(fmt::format(
          "step {} (samples {} to {}): loss {} with gradient norm {}: lower optim.lr or set "
          "optim.clip_norm; the last good state is {}",
          adam_->steps() + 1, samples_, samples_ + static_cast<std::int64_t>(drawn.size()) - 1,
          value[0], value[4],
          std::filesystem::exists(StatePath()) ? StatePath().string() : "none"));
    }
    lr_ = LearningRate(config_.optim, samples_, config_.run.samples);
    adam_->Step(lr_, norm);
    UpdateAverage();
    Synchronize();
    const auto t5 = Clock::now();

    samples_ += static_cast<std::int64_t>(drawn.size());
    window->loss += value[0];
    window->segmentation += value[1];
    window->procrustes += value[2];
    window->degenerate += static_cast<std::int64_t>(value[3]);
    window->gradient_norm += value[4];
    ++window->steps;
    window->data_s += Seconds(t0, t1);
    window->forward_s += Seconds(t1, t2);
    window->loss_s += Seconds(t2, t3);
    window->backward_s += Seconds(t3, t4);
    window->optim_s += Seconds(t4, t5);
    return value[0];
  }

  /// The weights that are validated and shipped: a running mean whose decay grows to ema_decay, so
  /// that the random start is forgotten early.
  void UpdateAverage() {
    if (config_.optim.ema_decay == 0) return;
    c10::NoGradGuard no_grad;
    const double t = static_cast<double>(adam_->steps());
    const double weight = 1 - std::min(config_.optim.ema_decay, (1 + t) / (10 + t));
    flat_average_->parameters().lerp_(flat_->parameters(), weight);
    flat_average_->buffers().lerp_(flat_->buffers(), weight);
  }

  void CopyToAverage() {
    c10::NoGradGuard no_grad;
    flat_average_->parameters().copy_(flat_->parameters());
    flat_average_->buffers().copy_(flat_->buffers());
  }

  void NoteCameras(const std::vector<Sample>& drawn) {
    for (const Sample& s : drawn) {
      for (double f : {s.intrinsics.fx, s.intrinsics.fy}) {
        focal_px_.first = focal_px_.first == 0 ? f : std::min(focal_px_.first, f);
        focal_px_.second = std::max(focal_px_.second, f);
      }
    }
    image_sizes_.insert({drawn[0].depth.width(), drawn[0].depth.height()});
  }

  void WriteRow(const json& row) {
    metrics_ << row.dump() << "\n" << std::flush;
    if (!metrics_) {
      throw IoError(fmt::format("{}: writing failed: is the disk full?",
                                (options_.run_dir / "metrics.jsonl").string()));
    }
  }

  void WriteTrainRow(Window* window) {
    const double n = static_cast<double>(window->steps);
    const double rate = n * config_.run.batch_size / Seconds(window->start, Clock::now());
    WriteRow({{"type", "train"},
              {"step", adam_->steps()},
              {"samples", samples_},
              {"loss", window->loss / n},
              {"loss_seg", window->segmentation / n},
              {"loss_3d", window->procrustes / n},
              {"degenerate", window->degenerate},
              {"gradient_norm", window->gradient_norm / n},
              {"lr", lr_},
              {"samples_per_s", rate},
              {"step_s",
               {{"data", window->data_s / n},
                {"forward", window->forward_s / n},
                {"loss", window->loss_s / n},
                {"backward", window->backward_s / n},
                {"optim", window->optim_s / n}}}});
    progress_.Row(samples_, config_.run.samples, window->loss / n, rate, lr_);
  }

  ValidationResult ValidateNow() {
    if (config_.run.validation_samples == 0) return {};
    if (config_.optim.ema_decay == 0) CopyToAverage();
    const std::unique_ptr<SampleSource> source =
        data_.open(static_cast<std::uint64_t>(config_.run.validation_seed), 0);
    ValidationResult v =
        Validate(average_, *loss_, data_.structure, ParseKeypointKind(config_.loss.keypoints),
                 *source, config_.run.validation_samples, device_, config_.run.channels_last);
    WriteRow({{"type", "validation"},
              {"step", adam_->steps()},
              {"samples", samples_},
              {"validation_samples", v.samples},
              {"loss_seg", v.loss_seg},
              {"loss_3d", v.loss_3d},
              {"miou", v.miou},
              {"miou_authors", v.miou_authors},
              {"posed", v.posed},
              {"keypoint_rmse_m", v.keypoint_rmse_m},
              {"median_translation_error_m", v.median_translation_error_m},
              {"median_rotation_error_deg", v.median_rotation_error_deg}});
    progress_.Line(
        fmt::format("validation at {}: loss_seg {:.4f}  mIoU {:.3f}  posed {}/{}  median pose "
                    "error {:.1f} cm {:.2f} deg",
                    samples_, v.loss_seg, v.miou, v.posed, v.samples,
                    100 * v.median_translation_error_m, v.median_rotation_error_deg));
    return v;
  }

  void SaveAll() {
    json sizes = json::array();
    for (const auto& [width, height] : image_sizes_) sizes.push_back({width, height});
    const json meta = {{"samples", samples_},
                       {"init_samples", init_samples_},
                       {"steps", adam_->steps()},
                       {"lr", lr_},
                       {"focal_px", {focal_px_.first, focal_px_.second}},
                       {"image_sizes", sizes},
                       {"data_identity", data_.identity},
                       {"config", WriteConfig(config_)}};
    if (config_.optim.ema_decay == 0) CopyToAverage();
    TensorFile state{kStateFormat, meta.dump(1), {}};
    AddModuleTensors(*net_, "model/", &state.tensors);
    AddModuleTensors(*average_, "average/", &state.tensors);
    flat_->AddViews(adam_->mean(), "adam_mean/", &state.tensors);
    flat_->AddViews(adam_->square(), "adam_square/", &state.tensors);
    WriteTensorFile(StatePath(), state);

    CheckpointMeta checkpoint;
    checkpoint.network = average_->options();
    checkpoint.structure = data_.structure;
    checkpoint.focal_px = focal_px_;
    checkpoint.image_sizes.assign(image_sizes_.begin(), image_sizes_.end());
    checkpoint.roll_offsets_deg = config_.data.pose.roll_offsets_deg;
    checkpoint.samples = init_samples_ + samples_;
    checkpoint.config_yaml = WriteConfig(config_);
    SaveCheckpoint(options_.run_dir / "model.pt", average_, checkpoint,
                   config_.run.half_checkpoint);
  }

  void LoadState() {
    const std::string path = StatePath().string();
    const TensorFile state = ReadTensorFile(StatePath(), kStateFormat);
    try {
      const json meta = json::parse(state.meta);
      RequireSameRun(meta.at("config").get<std::string>(), config_, path);
      if (meta.value("data_identity", std::string()) != data_.identity) {
        throw ConfigError(fmt::format(
            "{} was trained on other samples than run.dataset = '{}' gives: resume with the "
            "run's own dataset (config.yaml there names it), or start a new run",
            path, config_.run.dataset));
      }
      samples_ = meta.at("samples").get<std::int64_t>();
      init_samples_ = meta.value("init_samples", std::int64_t{0});
      adam_->set_steps(meta.at("steps").get<std::int64_t>());
      lr_ = meta.at("lr").get<double>();
      focal_px_ = {meta.at("focal_px").at(0).get<double>(),
                   meta.at("focal_px").at(1).get<double>()};
      for (const json& size : meta.at("image_sizes")) {
        image_sizes_.insert({size.at(0).get<int>(), size.at(1).get<int>()});
      }
    } catch (const json::exception& e) {
      throw DataError(fmt::format("{}: invalid metadata ({})", path, e.what()));
    }
    CopyIntoModule(state.tensors, "model/", *net_, path);
    CopyIntoModule(state.tensors, "average/", *average_, path);
    RestoreMoments(state, "adam_mean/", adam_->mean());
    RestoreMoments(state, "adam_square/", adam_->square());
  }

  void RestoreMoments(const TensorFile& state, const std::string& prefix, const at::Tensor& flat) {
    c10::NoGradGuard no_grad;
    std::map<std::string, at::Tensor> views;
    flat_->AddViews(flat, prefix, &views);
    for (auto& [name, view] : views) {
      const auto found = state.tensors.find(name);
      if (found == state.tensors.end() || found->second.sizes() != view.sizes() ||
          found->second.scalar_type() != at::kFloat) {
        throw DataError(fmt::format("{}: tensor '{}' is missing or of another shape or type",
                                    StatePath().string(), name));
      }
      view.copy_(found->second);
    }
  }

  const TrainingData& data_;
  TrainConfig config_;
  TrainOptions options_;
  at::Device device_;
  Progress progress_;
  StructureNet net_{nullptr}, average_{nullptr};
  std::optional<FlatModule> flat_, flat_average_;
  std::optional<Adam> adam_;
  std::optional<TrainingLoss> loss_;
  std::int64_t samples_ = 0;
  std::int64_t init_samples_ = 0;  ///< that run.init was trained on
  double lr_ = 0;
  std::pair<double, double> focal_px_{0, 0};
  std::set<std::pair<int, int>> image_sizes_;
  std::ofstream metrics_;
};

}  // namespace

TrainResult TrainOn(const TrainingData& data, const TrainConfig& config,
                    const TrainOptions& options) {
  ValidateConfig(config);
  config.Validate();
  return Trainer(data, config, options).Run();
}

}  // namespace volalign
