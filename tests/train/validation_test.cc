#include "train/validation.h"

#include <ATen/TensorOperators.h>
#include <c10/core/GradMode.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/train/synthetic_source.h"
#include "train/checkpoint_validation.h"
#include "train/metric.h"

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
  const ValidationResult v = Validate(net, loss, data.structure, KeypointKind::kCentre, source, 3,
                                      at::kCPU, /*channels_last=*/false);
  EXPECT_EQ(v.samples, 4);  // whole batches
  EXPECT_EQ(v.samples_with_pose, 0);
  double miou_authors = 0, nll = 0;
  const double log_sum = std::log(std::exp(5.0) + 20);
  const auto again = data.open_validation();
  for (int batch = 0; batch < 2; ++batch) {
    for (const Sample& s : again()) {
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
  EXPECT_NEAR(v.Mean("miou_authors"), miou_authors, 1e-9);
  EXPECT_NEAR(v.Mean("loss_seg"), nll, 1e-5);
  EXPECT_EQ(v.means.count("loss_3d"), 1U);
}

// As the paper and the Procrustes term take them: no pixel weighs more for being far away.
TEST(FindKeypoints, ArePlainMeansOfTheSidesPoints) {
  const Structure structure = ReadStructure("configs/structure.yaml");
  Sample sample;
  sample.intrinsics = {160, 144, 100, 100, 80, 72, {}};
  sample.structure_from_sensor = LookAt({1.5, 0.4, 1.5}, {-0.1, 0, 0}, M_PI / 2);
  const RayTable rays = ComputeRays(sample.intrinsics);
  const ExpectedView view = CastView(structure, rays, sample.structure_from_sensor);
  sample.depth = view.depth;
  std::vector<Eigen::Vector3d> sums(21, Eigen::Vector3d::Zero());
  std::vector<int> counts(21, 0);
  for (const auto [u, v] : Pixels(160, 144)) {
    sums[view.labels(u, v)] += view.depth(u, v) * rays.at(u, v).cast<double>().homogeneous();
    ++counts[view.labels(u, v)];
  }
  const SideKeypoints found = FindKeypoints(sample, view.labels, structure, KeypointKind::kExposed);
  ASSERT_GE(found.sensor.size(), 8U);
  std::size_t i = 0;
  for (int label = 1; label < 21; ++label) {
    const auto k = static_cast<std::size_t>(label);
    if (counts[k] < 20) continue;
    EXPECT_LT((found.sensor.at(i) - sums[k] / counts[k]).norm(), 1e-6) << label;
    EXPECT_EQ(found.structure.at(i), structure.Keypoint(label, KeypointKind::kExposed));
    ++i;
  }
  EXPECT_EQ(i, found.sensor.size());
}

// Of two samples, one without a value.
TEST(RegisterMetric, IsMeasuredInEveryValidation) {
  int asked = 0;
  RegisterMetric("missed", [&](const MetricInput& input) {
    EXPECT_EQ(input.log_probs.sizes(), (std::vector<std::int64_t>{21, 32, 32}));
    EXPECT_EQ(input.predicted.size(), input.labels.size());
    return asked++ % 2 == 0 ? 0.25 : std::nan("");
  });
  EXPECT_THROW(RegisterMetric("missed", nullptr), Error);
  EXPECT_THROW(RegisterMetric("miou", nullptr), Error);
  EXPECT_THROW(RegisterMetric("loss_seg", nullptr), Error);
  const TrainingData data = SyntheticData(2, 32, 1u << 20);
  StructureNetOptions options;
  options.base_channels = 2;
  StructureNet net(options);
  const ValidationResult v =
      Validate(net, TrainingLoss({}, data.structure, at::kCPU), data.structure,
               KeypointKind::kCentre, data.open_validation(), 2, at::kCPU, false);
  EXPECT_EQ(asked, 2);
  EXPECT_EQ(v.Mean("missed"), 0.25);
  EXPECT_EQ(v.scores.at(1).metrics.count("missed"), 0u);
}

TEST(MedianPoseError, SaysNothingWithoutAPose) {
  ValidationResult result;
  EXPECT_EQ(MedianPoseError(result), "-");
  result.samples_with_pose = 1;
  result.means = {{"median_translation_error_m", 0.1234}, {"median_rotation_error_deg", 1.5}};
  EXPECT_EQ(MedianPoseError(result), "12.3 cm, 1.50 deg");
}

ValidatedModel Scored() {
  ValidatedModel model;
  model.file = "a.pt";
  // At 2 m, at the limit of the first two bands, and beyond the last one.
  for (const auto& [rho, miou] : {std::pair(2.0, 0.5), {2.0, 0.7}, {2.25, 0.2}, {3.6, 0.1}}) {
    SampleScore score;
    score.sensor = rho > 2.1 ? "far" : "near";
    score.rho_m = rho;
    score.metrics["miou"] = miou;
    model.result.scores.push_back(score);
  }
  return model;
}

TEST(ValidationJson, HasMeansOfEachSensorAndBandOfDistance) {
  const auto json = nlohmann::json::parse(ValidationJson({Scored()})).at(0);
  EXPECT_EQ(json.at("by_sensor").at("near").at("samples"), 2);
  const auto& bands = json.at("by_rho_cm");
  EXPECT_EQ(bands.size(), 2u);
  EXPECT_EQ(bands.at("150-225").at("samples"), 2);
  EXPECT_NEAR(bands.at("150-225").at("miou").get<double>(), 0.6, 1e-12);
  EXPECT_NEAR(bands.at("225-275").at("miou").get<double>(), 0.2, 1e-12);
}

TEST(ValidationTable, HasTheSameRows) {
  const Table table = ValidationTable({Scored(), Scored()});
  ASSERT_EQ(table.rows.size(), 10u);
  const std::string text = FormatTable(table, TableFormat::kText);
  EXPECT_TRUE(Has(text, "rho 150-225 cm"));
  EXPECT_FALSE(Has(text, "275-350"));
  const auto rows = nlohmann::json::parse(FormatTable(table, TableFormat::kJson));
  EXPECT_EQ(rows.at(0).at("group"), "all");
  EXPECT_EQ(rows.at(0).at("samples"), 4);
  EXPECT_NEAR(rows.at(0).at("miou").get<double>(), 0.375, 1e-12);
  EXPECT_FALSE(rows.at(0).contains("median_translation_error_m"));
}

}  // namespace
}  // namespace volalign::validation_test
