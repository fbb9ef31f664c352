#include "train/validation.h"

#include <ATen/ops/argmax.h>
#include <ATen/ops/gather.h>
#include <c10/core/GradMode.h>
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/geometry/lens.h"
#include "core/geometry/metrics.h"
#include "core/geometry/pose.h"
#include "core/geometry/procrustes.h"
#include "train/metric.h"

namespace volalign {
namespace {

constexpr int kMinPixels = 20;

double MiouOf(const MetricInput& input, bool absent_counts_as_one) {
  MiouOptions options;
  options.num_classes = static_cast<int>(input.log_probs.size(0));
  options.absent_counts_as_one = absent_counts_as_one;
  return MeanIou(input.predicted, input.labels, input.depth, options);
}

std::map<std::string, Metric>& Registered() {
  static std::map<std::string, Metric> registered = {
      {"miou", [](const MetricInput& input) { return MiouOf(input, false); }},
      {"miou_authors", [](const MetricInput& input) { return MiouOf(input, true); }}};
  return registered;
}

}  // namespace

void RegisterMetric(const std::string& name, Metric metric) {
  const auto measured = {"loss_seg", kKeypointRmse, kTranslationError, kRotationError};
  if (std::find(measured.begin(), measured.end(), name) != measured.end() ||
      !Registered().emplace(name, std::move(metric)).second)
    throw Error(fmt::format("there is a metric '{}' already", name));
}

SideKeypoints FindKeypoints(const Sample& sample, const LabelImage& labels,
                            const Structure& structure, KeypointKind kind) {
  const std::size_t classes = static_cast<std::size_t>(structure.num_classes());
  std::vector<Eigen::Vector3d> sums(classes, Eigen::Vector3d::Zero());
  std::vector<int> counts(classes, 0);
  const RayTable rays = ComputeRays(sample.intrinsics);
  for (int v = 0; v < labels.height(); ++v) {
    for (int u = 0; u < labels.width(); ++u) {
      const double z = sample.depth(u, v);
      const Eigen::Vector2f& ray = rays.at(u, v);
      if (z <= 0 || !ray.allFinite()) continue;
      const std::size_t label = labels(u, v);
      sums[label] += z * ray.cast<double>().homogeneous();
      ++counts[label];
    }
  }
  SideKeypoints keypoints;
  for (std::size_t label = 1; label < classes; ++label) {
    if (counts[label] < kMinPixels) continue;
    keypoints.sensor.push_back(sums[label] / counts[label]);
    keypoints.structure.push_back(structure.Keypoint(static_cast<int>(label), kind));
  }
  return keypoints;
}

ValidationResult Validate(StructureNet& net, const TrainingLoss& loss, const Structure& structure,
                          KeypointKind keypoints, const SampleSource& source, int samples,
                          const at::Device& device, bool channels_last, const CountDone& count) {
  c10::NoGradGuard no_grad;
  net->eval();
  std::vector<SampleScore> scores;
  std::vector<LabelExample> examples;
  std::map<std::string, double> sums;
  BatchPacker packer(device);
  while (static_cast<int>(scores.size()) < samples) {
    if (count) count(static_cast<std::int64_t>(scores.size()), samples);
    const std::vector<Sample> drawn = source();
    const Batch batch = Unpack(packer.Pack(drawn));
    at::Tensor input = EncodeDepth(batch.depth, net->options().input);
    if (channels_last) input = input.contiguous(at::MemoryFormat::ChannelsLast);
    const at::Tensor log_probs = net->forward(input);
    const LossTerms terms = loss({log_probs, batch.depth, batch.labels, batch.rays},
                                 std::numeric_limits<std::int64_t>::max());
    for (std::size_t i = 0; i < terms.terms.size(); ++i) {
      sums[loss.names()[i]] += static_cast<double>(drawn.size()) * terms.terms[i].item<double>();
    }
    const at::Tensor predicted = at::argmax(log_probs, 1).to(at::kByte).to(at::kCPU).contiguous();
    const std::uint8_t* pixels = predicted.data_ptr<std::uint8_t>();
    const at::Tensor nll =
        -log_probs.gather(1, batch.labels.unsqueeze(1)).mean({1, 2, 3}).to(at::kCPU, at::kDouble);
    for (std::size_t i = 0; i < drawn.size(); ++i) {
      const Sample& s = drawn[i];
      LabelImage labels(s.labels.width(), s.labels.height());
      std::copy(pixels, pixels + labels.size(), labels.begin());
      pixels += labels.size();
      SampleScore score;
      score.sensor = s.sensor;
      const Eigen::Vector3d at = s.structure_from_sensor.translation();
      score.rho_m = std::hypot(at.x(), at.z());
      score.metrics["loss_seg"] = nll[static_cast<std::int64_t>(i)].item<double>();
      const at::Tensor own_log_probs = log_probs[static_cast<std::int64_t>(i)];
      for (const auto& [name, metric] : Registered()) {
        const double value = metric({s.depth, s.labels, labels, own_log_probs});
        if (!std::isnan(value)) score.metrics[name] = value;
      }
      const SideKeypoints found = FindKeypoints(s, labels, structure, keypoints);
      if (found.structure.size() >= 3 &&
          SecondSingularValue(found.structure) > kMinSecondSingularValue) {
        const ProcrustesResult aligned = AlignPoints(found.sensor, found.structure);
        const PoseError error = ComparePoses(aligned.target_from_source, s.structure_from_sensor);
        score.metrics[kKeypointRmse] = aligned.rms;
        score.metrics[kTranslationError] = error.translation_m;
        score.metrics[kRotationError] = error.rotation_deg;
      }
      scores.push_back(std::move(score));
      if (static_cast<int>(examples.size()) < kLabelExamples) {
        examples.push_back({s.depth, s.labels, std::move(labels)});
      }
    }
  }
  ValidationResult result = Summarise(scores);
  // The scores have loss_seg, in double.
  for (const auto& [name, sum] : sums) result.means.emplace(name, sum / result.samples);
  result.scores = std::move(scores);
  result.examples = std::move(examples);
  return result;
}

ValidationResult Summarise(const std::vector<SampleScore>& scores) {
  ValidationResult result;
  result.samples = static_cast<int>(scores.size());
  std::map<std::string, std::vector<double>> values;
  for (const SampleScore& score : scores) {
    for (const auto& [name, value] : score.metrics) values[name].push_back(value);
  }
  for (const auto& [name, of_samples] : values) {
    if (name == kKeypointRmse) result.samples_with_pose = static_cast<int>(of_samples.size());
    if (name == kTranslationError || name == kRotationError) {
      result.means["median_" + name] = Summarise(of_samples).median;
    } else {
      result.means[name] = std::accumulate(of_samples.begin(), of_samples.end(), 0.0) /
                           static_cast<double>(of_samples.size());
    }
  }
  return result;
}

}  // namespace volalign
