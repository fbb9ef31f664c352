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
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/lens.h"
#include "core/geometry/metrics.h"
#include "core/geometry/pose.h"
#include "core/geometry/procrustes.h"

namespace volalign {
namespace {

constexpr int kMinPixels = 20;

}  // namespace

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
  MiouOptions present, all;
  present.num_classes = all.num_classes = structure.num_classes();
  all.absent_counts_as_one = true;
  BatchPacker packer(device);
  while (static_cast<int>(scores.size()) < samples) {
    if (count) count(static_cast<std::int64_t>(scores.size()), samples);
    const std::vector<Sample> drawn = source();
    const Batch batch = Unpack(packer.Pack(drawn));
    at::Tensor input = EncodeDepth(batch.depth, net->options().input);
    if (channels_last) input = input.contiguous(at::MemoryFormat::ChannelsLast);
    const at::Tensor log_probs = net->forward(input);
    const LossTerms terms = loss(log_probs, batch.depth, batch.labels, batch.rays,
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
      score.loss_seg = nll[static_cast<std::int64_t>(i)].item<double>();
      score.miou = MeanIou(labels, s.labels, s.depth, present);
      score.miou_authors = MeanIou(labels, s.labels, s.depth, all);
      const SideKeypoints found = FindKeypoints(s, labels, structure, keypoints);
      score.posed = found.structure.size() >= 3 &&
                    SecondSingularValue(found.structure) > kMinSecondSingularValue;
      if (score.posed) {
        const ProcrustesResult aligned = AlignPoints(found.sensor, found.structure);
        const PoseError error = ComparePoses(aligned.target_from_source, s.structure_from_sensor);
        score.keypoint_rmse_m = aligned.rms;
        score.translation_error_m = error.translation_m;
        score.rotation_error_deg = error.rotation_deg;
      }
      scores.push_back(std::move(score));
      if (static_cast<int>(examples.size()) < kLabelExamples) {
        examples.push_back({s.depth, s.labels, std::move(labels)});
      }
    }
  }
  ValidationResult result = Summarise(scores);
  sums.erase("loss_seg");  // the scores have it, in double
  for (const auto& [name, sum] : sums) result.terms[name] = sum / result.samples;
  result.scores = std::move(scores);
  result.examples = std::move(examples);
  return result;
}

ValidationResult Summarise(const std::vector<SampleScore>& scores) {
  ValidationResult result;
  std::vector<double> translation, rotation;
  for (const SampleScore& score : scores) {
    ++result.samples;
    result.loss_seg += score.loss_seg;
    result.miou += score.miou;
    result.miou_authors += score.miou_authors;
    if (!score.posed) continue;
    ++result.posed;
    result.keypoint_rmse_m += score.keypoint_rmse_m;
    translation.push_back(score.translation_error_m);
    rotation.push_back(score.rotation_error_deg);
  }
  if (result.samples > 0) {
    result.loss_seg /= result.samples;
    result.miou /= result.samples;
    result.miou_authors /= result.samples;
  }
  if (result.posed > 0) {
    result.keypoint_rmse_m /= result.posed;
    result.median_translation_error_m = Summarise(translation).median;
    result.median_rotation_error_deg = Summarise(rotation).median;
  }
  return result;
}

}  // namespace volalign
