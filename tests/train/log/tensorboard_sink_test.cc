#include "train/log/tensorboard_sink.h"

#include <gtest/gtest.h>

#include <cstring>
#include <string>

#include "core/base/file_util.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::tensorboard_sink_test {
namespace {

std::string BytesIn(const std::filesystem::path& folder) {
  std::string bytes;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    bytes += ReadFile(entry.path());
  return bytes;
}

/// A value as summary.proto has it: field 1, the tag; field 2, a float.
std::string Scalar(const std::string& tag, float value) {
  std::string bytes = "\x0a" + std::string(1, static_cast<char>(tag.size())) + tag + "\x15";
  bytes.resize(bytes.size() + sizeof(value));
  std::memcpy(bytes.data() + bytes.size() - sizeof(value), &value, sizeof(value));
  return bytes;
}

TEST(TensorBoardSink, WritesEachNumberUnderItsTag) {
  const TempFolder folder;
  TensorBoardSink sink(folder.path(), "optim:\n  lr: 1\n", 100);
  TrainRow row;
  row.samples = 300;
  row.lr = 0.5;
  row.samples_per_s = 7;
  row.mean.loss = 1.5;
  row.mean.terms["loss_seg"] = 2.5;
  row.mean.terms["loss_3d"] = 3.5;
  row.mean.gradient_norm = 4.5;
  row.mean.times.forward = 5.5;
  sink.Train(row);
  ValidationRow validation;
  validation.samples = 300;
  validation.result.miou = 0.75;
  validation.result.keypoint_rmse_m = 0.25;
  sink.Validation(validation);
  std::string bytes = BytesIn(folder.path());
  for (const std::string& part :
       {Scalar("train/loss", 1.5F), Scalar("train/loss_seg", 2.5F), Scalar("train/loss_3d", 3.5F),
        Scalar("train/gradient_norm", 4.5F), Scalar("train/lr", 0.5F),
        Scalar("speed/samples_per_s", 7), Scalar("speed/forward_s", 5.5F),
        Scalar("validation/miou", 0.75F), std::string("    optim:\n      lr: 1\n")}) {
    EXPECT_NE(bytes.find(part), std::string::npos) << part;
  }
  EXPECT_EQ(bytes.find("keypoint_rmse_m"), std::string::npos);  // no sample has a pose
  EXPECT_EQ(bytes.find("predicted"), std::string::npos);
  validation.result.posed = 1;
  validation.result.examples.push_back(
      {DepthImage(4, 3, 1.0F), LabelImage(4, 3), LabelImage(4, 3)});
  sink.Validation(validation);
  bytes = BytesIn(folder.path());
  EXPECT_NE(bytes.find(Scalar("validation/keypoint_rmse_m", 0.25F)), std::string::npos);
  EXPECT_NE(bytes.find("validation/depth, labels, predicted"), std::string::npos);
}

TEST(LabelPictures, HaveARowForEachExample) {
  LabelImage labels(4, 3), predicted(4, 3);
  labels(1, 2) = 5;
  predicted(1, 2) = 7;
  const RgbImage picture = LabelPictures({{DepthImage(4, 3), LabelImage(4, 3), LabelImage(4, 3)},
                                          {DepthImage(4, 3, 1.0F), labels, predicted}});
  ASSERT_EQ(picture.width(), 3 * 4 + 2 * 2);
  ASSERT_EQ(picture.height(), 2 * 3 + 2);
  const Rgb black;
  // Of the second row: depth, labels, predicted labels; pixel (1, 2) of each.
  const Rgb depth = picture(1, 7), label = picture(7, 7), other = picture(13, 7);
  EXPECT_FALSE(depth == black);
  EXPECT_FALSE(label == black);
  EXPECT_FALSE(other == black);
  EXPECT_FALSE(label == other);
  EXPECT_EQ(picture(8, 7), black);
  EXPECT_EQ(picture(1, 2), black);  // nothing was measured in the first row
}

}  // namespace
}  // namespace volalign::tensorboard_sink_test
