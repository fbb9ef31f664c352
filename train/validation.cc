#include "train/validation.h"

#include <ATen/ops/argmax.h>
#include <c10/core/GradMode.h>

#include <cmath>
#include <limits>
#include <vector>

#include "core/camera.h"
#include "core/metrics.h"
#include "core/pose.h"
#include "core/procrustes.h"

namespace volalign {
namespace {

constexpr int kMinPixels = 20;

struct Keypoints {
  std::vector<Eigen::Vector3d> sensor, structure;
};

Keypoints HardKeypoints(const Sample& sample, const LabelImage& labels, const Structure& structure,
                        KeypointKind kind) {
  const std::size_t classes = static_cast<std::size_t>(structure.num_classes());
  std::vector<Eigen::Vector3d> sums(classes, Eigen::Vector3d::Zero());
  std::vector<double> weights(classes, 0.0);
  std::vector<int> counts(classes, 0);
  const Intrinsics& k = sample.intrinsics;
  for (int v = 0; v < labels.height(); ++v) {
    for (int u = 0; u < labels.width(); ++u) {
      const double z = sample.depth(u, v);
      if (z <= 0) continue;
      const double weight = z * z * z;
      const std::size_t label = labels(u, v);
      sums[label] += weight * z * Eigen::Vector3d((u - k.cx) / k.fx, (v - k.cy) / k.fy, 1.0);
      weights[label] += weight;
      ++counts[label];
    }
  }
  Keypoints keypoints;
  for (std::size_t label = 1; label < classes; ++label) {
    if (counts[label] < kMinPixels) continue;
    keypoints.sensor.push_back(sums[label] / weights[label]);
    keypoints.structure.push_back(structure.Keypoint(static_cast<int>(label), kind));
  }
  return keypoints;
}

}  // namespace

ValidationResult Validate(StructureNet& net, const TrainingLoss& loss, const Structure& structure,
                          KeypointKind keypoints, SampleSource& source, int samples,
                          const at::Device& device, bool channels_last) {
  c10::NoGradGuard no_grad;
  net->eval();
  ValidationResult result;
  MiouOptions present, all;
  present.num_classes = all.num_classes = structure.num_classes();
  all.absent_counts_as_one = true;
  std::vector<double> translation, rotation;
  while (result.samples < samples) {
    const std::vector<Sample> drawn = source.Next();
    const Batch batch = Collate(drawn).To(device);
    at::Tensor input = EncodeDepth(batch.depth, net->options().input);
    if (channels_last) input = input.contiguous(at::MemoryFormat::ChannelsLast);
    const at::Tensor log_probs = net->forward(input);
    const LossTerms terms = loss(log_probs, batch.depth, batch.labels, batch.intrinsics,
                                 std::numeric_limits<std::int64_t>::max());
    const double count = static_cast<double>(drawn.size());
    result.loss_seg += count * terms.segmentation.item<double>();
    result.loss_3d += count * terms.procrustes.item<double>();
    const at::Tensor predicted = at::argmax(log_probs, 1).to(at::kByte).to(at::kCPU).contiguous();
    const std::uint8_t* pixels = predicted.data_ptr<std::uint8_t>();
    for (const Sample& s : drawn) {
      LabelImage labels(s.labels.width(), s.labels.height());
      std::copy(pixels, pixels + labels.size(), labels.begin());
      pixels += labels.size();
      result.miou += MeanIou(labels, s.labels, s.depth, present);
      result.miou_authors += MeanIou(labels, s.labels, s.depth, all);
      ++result.samples;
      const Keypoints found = HardKeypoints(s, labels, structure, keypoints);
      if (found.structure.size() < 3 ||
          SecondSingularValue(found.structure) <= kMinSecondSingularValue) {
        continue;
      }
      const ProcrustesResult aligned = AlignPoints(found.sensor, found.structure);
      const PoseError error = ComparePoses(aligned.target_from_source, s.structure_from_sensor);
      ++result.posed;
      result.keypoint_rmse_m += aligned.rms;
      translation.push_back(error.translation_m);
      rotation.push_back(error.rotation_deg);
    }
  }
  result.loss_seg /= result.samples;
  result.loss_3d /= result.samples;
  result.miou /= result.samples;
  result.miou_authors /= result.samples;
  if (result.posed > 0) {
    result.keypoint_rmse_m /= result.posed;
    result.median_translation_error_m = Summarise(translation).median;
    result.median_rotation_error_deg = Summarise(rotation).median;
  }
  return result;
}

}  // namespace volalign
