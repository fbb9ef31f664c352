#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/network.h"
#include "train/batch.h"
#include "train/losses.h"

namespace volalign {

inline constexpr int kLabelExamples = 4;

/// One validation sample.
struct SampleScore {
  std::string sensor;  ///< pool name
  double rho_m = 0;    ///< horizontal distance of the sensor from the structure's origin
  double loss_seg = 0;
  double miou = 0, miou_authors = 0;
  bool posed = false;  ///< the predicted keypoints fix a pose; what follows is of posed samples
  double keypoint_rmse_m = 0, translation_error_m = 0, rotation_error_deg = 0;
};

/// What the network made of a sample, to be looked at.
struct LabelExample {
  DepthImage depth;
  LabelImage labels, predicted;
};

/// Means over the validation samples unless said otherwise.
struct ValidationResult {
  int samples = 0;
  double loss_seg = 0;
  double loss_3d = 0;
  double miou = 0;          ///< over the classes present in an image (core/metrics.h)
  double miou_authors = 0;  ///< over all classes
  int posed = 0;  ///< samples whose predicted keypoints fix a pose (core/procrustes.h); without
                  ///< one, the errors below mean nothing and are left out of files
  double keypoint_rmse_m = 0;             ///< 3D RMSE of aligned keypoints, over posed samples
  double median_translation_error_m = 0;  ///< over posed samples
  double median_rotation_error_deg = 0;   ///< over posed samples
  std::vector<SampleScore> scores;        ///< of each sample, in order
  std::vector<LabelExample> examples;     ///< the first kLabelExamples samples
};

/// Means and medians over some samples; `loss_3d`, which is a batch's, stays 0 and `scores` empty.
ValidationResult Summarise(const std::vector<SampleScore>& scores);

/// The medians over posed samples for a line of text: "12.3 cm, 0.45 deg", or "-" where there are
/// none.
std::string MedianPoseError(const ValidationResult& result);

/// Keypoints of the sides that `labels` shows in a sample's depth map, in two frames, m.
struct SideKeypoints {
  std::vector<Eigen::Vector3d> sensor;  ///< as seen
  std::vector<Eigen::Vector3d> structure;
};

/// A side counts from 20 pixels on; its keypoint in the sensor frame is the mean of its pixels'
/// points, weighted by their area on a plane up to a constant: z^3 times the pixel's on z = 1.
SideKeypoints FindKeypoints(const Sample& sample, const LabelImage& labels,
                            const Structure& structure, KeypointKind kind);

/// Runs `net` in evaluation mode over `samples` samples (rounded up to whole batches) of the
/// source. Poses are those of the keypoints (FindKeypoints) of the argmax labels.
ValidationResult Validate(StructureNet& net, const TrainingLoss& loss, const Structure& structure,
                          KeypointKind keypoints, SampleSource& source, int samples,
                          const at::Device& device, bool channels_last);

}  // namespace volalign
