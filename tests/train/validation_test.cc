#include "train/validation.h"

#include <ATen/TensorOperators.h>
#include <c10/core/GradMode.h>
#include <gtest/gtest.h>

#include "tests/train/synthetic_source.h"

namespace volalign::validation_test {
namespace {

TEST(Validate, ScoresABackgroundOnlyNetworkByHand) {
  const TrainingData data = SyntheticData(2, 32, 1u << 20);
  StructureNetOptions options;
  options.base_channels = 2;
  options.residual_blocks = 1;
  StructureNet net(options);
  c10::NoGradGuard no_grad;
  for (at::Tensor& p : net->parameters()) p.zero_();
  net->named_parameters()["classifier.bias"][0] = 5;  // background everywhere
  LossConfig config;
  const TrainingLoss loss(config, data.structure, at::kCPU);
  const auto source = data.open_validation();
  const ValidationResult v = Validate(net, loss, data.structure, KeypointKind::kCentre, *source, 3,
                                      at::kCPU, /*channels_last=*/false);
  EXPECT_EQ(v.samples, 4);  // whole batches
  EXPECT_EQ(v.posed, 0);
  double miou_authors = 0, nll = 0;
  const double log_sum = std::log(std::exp(5.0) + 20);
  const auto again = data.open_validation();
  for (int batch = 0; batch < 2; ++batch) {
    for (const Sample& s : again->Next()) {
      std::vector<int> pixels(21, 0);
      double sum = 0;
      bool hidden_background = false;
      for (std::size_t i = 0; i < s.labels.size(); ++i) {
        sum += log_sum - (s.labels[i] == 0 ? 5.0 : 0.0);
        if (s.depth[i] > 0) ++pixels[s.labels[i]];
        hidden_background |= s.depth[i] > 0 && s.labels[i] == 0;
      }
      nll += sum / static_cast<double>(s.labels.size()) / 4;
      // Every side that is there scores 0, every absent one 1; background: its share.
      double total = 0;
      int seen = 0;
      for (int k = 1; k < 21; ++k) {
        total += pixels[k] == 0;
        seen += pixels[k];
      }
      if (hidden_background) total += static_cast<double>(pixels[0]) / (pixels[0] + seen);
      miou_authors += total / 21 / 4;
    }
  }
  EXPECT_NEAR(v.miou_authors, miou_authors, 1e-9);
  EXPECT_NEAR(v.loss_seg, nll, 1e-5);
}

TEST(FindKeypoints, OfOnePoseAreTheSameThroughALens) {
  const Structure structure = ReadStructureYaml("configs/structure.yaml");
  Sample pinhole;
  pinhole.intrinsics = {640, 576, 400, 400, 320, 288, {}};
  pinhole.structure_from_sensor = LookAt({1.5, 0.4, 1.5}, {-0.1, 0, 0}, M_PI / 2);
  Sample lens = pinhole;
  lens.intrinsics.distortion = {0.92185, 0.50040, 0, 0, 0.02836, 1.25842, 0.75181, 0.14419};
  std::vector<SideKeypoints> found;
  for (Sample* sample : {&pinhole, &lens}) {
    const ExpectedView view =
        CastView(structure, ComputeRays(sample->intrinsics), sample->structure_from_sensor);
    sample->depth = view.depth;
    found.push_back(FindKeypoints(*sample, view.labels, structure, KeypointKind::kExposed));
  }
  ASSERT_GE(found[0].sensor.size(), 8U);
  ASSERT_EQ(found[0].sensor.size(), found[1].sensor.size());
  for (std::size_t i = 0; i < found[0].sensor.size(); ++i) {
    EXPECT_EQ(found[0].structure[i], found[1].structure[i]);
    // Which pixels fall on a side's rim differs.
    EXPECT_LT((found[0].sensor[i] - found[1].sensor[i]).norm(), 0.004) << i;
  }
}

TEST(MedianPoseError, SaysNothingWithoutAPose) {
  ValidationResult result;
  EXPECT_EQ(MedianPoseError(result), "-");
  result.posed = 1;
  result.median_translation_error_m = 0.1234;
  result.median_rotation_error_deg = 1.5;
  EXPECT_EQ(MedianPoseError(result), "12.3 cm, 1.50 deg");
}

}  // namespace
}  // namespace volalign::validation_test
