#include "train/checkpoint_validation.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace volalign::checkpoint_validation_test {
namespace {

ValidatedModel Scored() {
  ValidatedModel model;
  model.file = "a.pt";
  // At 2 m, at the limit of the first two bands, and beyond the last one.
  for (const auto& [rho, miou] : {std::pair(2.0, 0.5), {2.0, 0.7}, {2.25, 0.2}, {3.6, 0.1}}) {
    SampleScore score;
    score.sensor = rho > 2.1 ? "far" : "near";
    score.rho_m = rho;
    score.miou = miou;
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
  EXPECT_NE(text.find("rho 150-225 cm"), std::string::npos) << text;
  EXPECT_EQ(text.find("275-350"), std::string::npos) << text;
  const auto rows = nlohmann::json::parse(FormatTable(table, TableFormat::kJson));
  EXPECT_EQ(rows.at(0).at("group"), "all");
  EXPECT_EQ(rows.at(0).at("samples"), 4);
  EXPECT_NEAR(rows.at(0).at("miou").get<double>(), 0.375, 1e-12);
  EXPECT_FALSE(rows.at(0).contains("median_translation_error_m"));
}

}  // namespace
}  // namespace volalign::checkpoint_validation_test
