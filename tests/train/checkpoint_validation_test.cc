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
  const std::string table = ValidationTable(Scored().result);
  EXPECT_NE(table.find("| all | 4 | 0.375 |"), std::string::npos) << table;
  EXPECT_NE(table.find("| rho 150-225 cm | 2 | 0.600 |"), std::string::npos) << table;
  EXPECT_EQ(table.find("275-350"), std::string::npos) << table;
}

}  // namespace
}  // namespace volalign::checkpoint_validation_test
