#include "train/train_state.h"

#include <ATen/Context.h>
#include <ATen/TensorOperators.h>
#include <c10/core/GradMode.h>
#include <fmt/format.h>

#include <map>

#include "core/base/error.h"
#include "core/nn/checkpoint.h"

namespace volalign {
namespace {

StructureNet MakeNet(const StructureNetOptions& options, const Compute& compute) {
  StructureNet net(options);
  net->to(compute.device);
  net->SetComputeType(compute.type);
  net->SetChannelsLast(compute.channels_last);
  return net;
}

StructureNet DrawNet(const TrainConfig& config, int num_classes, const Compute& compute) {
  at::manual_seed(static_cast<std::uint64_t>(config.run.seed));
  return MakeNet(config.model.Options(num_classes), compute);
}

}  // namespace

TrainState::TrainState(const TrainConfig& config, int num_classes, const Compute& compute)
    : net(DrawNet(config, num_classes, compute)),
      flat(*net),
      optimizer(config.optim, &flat),
      average(MakeNet(net->options(), compute), config.optim.ema_decay, flat) {}

void TrainState::Step(double lr, const at::Tensor& gradient_norm, const at::Tensor& finite) {
  optimizer.Step(lr, gradient_norm, finite);
  average.Update(flat, optimizer.steps(), finite);
}

void TrainState::Update(double lr, const at::Tensor& gradient_norm, const at::Tensor& finite) {
  if (!finite.is_cpu()) {
    Step(lr, gradient_norm, finite);
  } else if (finite.item<bool>()) {
    Step(lr, gradient_norm);
  } else {
    c10::NoGradGuard no_grad;
    flat.gradients().zero_();
  }
}

std::int64_t StartFrom(const std::string& path, const Structure& structure, TrainState* state) {
  const LoadedModel model = LoadCheckpoint(path);
  if (!(model.meta.network == state->net->options())) {
    throw ConfigError(
        fmt::format("run.init = {}: its network differs from the one that `model` describes; its "
                    "configuration is:\n{}",
                    path, model.meta.config_yaml));
  }
  CheckStructure(model.meta, structure);
  std::map<std::string, at::Tensor> tensors;
  AddModuleTensors(*model.net, "", &tensors);
  CopyIntoModule(tensors, "", *state->net, path);
  state->average.Reset(state->flat);
  return model.meta.samples;
}

}  // namespace volalign
