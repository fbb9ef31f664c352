#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/base/progress_line.h"
#include "core/nn/network.h"
#include "train/batch.h"
#include "train/log/metrics.h"
#include "train/losses.h"

namespace volalign {

inline constexpr int kLabelExamples = 4;

/// Means and medians over some samples. The terms of the loss belong to batches and are left out;
/// `scores` stay empty.
ValidationResult Summarise(const std::vector<SampleScore>& scores);

/// Keypoints of the sides that `labels` has in a sample's depth map, in two frames, m.
struct SideKeypoints {
  std::vector<Eigen::Vector3d> sensor;  ///< as seen
  std::vector<Eigen::Vector3d> structure;
};

/// Finds keypoints of sides with 20 pixels or more. The keypoint in the sensor frame is the mean of
/// the side's points, as in the paper and in L_3D.
SideKeypoints FindKeypoints(const Sample& sample, const LabelImage& labels,
                            const Structure& structure, KeypointKind kind);

/// Runs `net` in evaluation mode over `samples` samples (rounded up to whole batches) of the
/// source. The first kLabelExamples become examples. Poses are those of the keypoints
/// (FindKeypoints) of the argmax labels. `count` receives the progress in samples.
ValidationResult Validate(StructureNet& net, const TrainingLoss& loss, const Structure& structure,
                          KeypointKind keypoints, const SampleSource& source, int samples,
                          const at::Device& device, bool channels_last,
                          const CountDone& count = nullptr);

}  // namespace volalign
