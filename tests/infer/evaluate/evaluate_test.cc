#include "infer/evaluate/evaluate.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "infer/evaluate/storage.h"
#include "infer/evaluate/tables.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/infer/evaluate/stills.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::evaluate_test {
namespace {

using testing_infer::MakeRing;
using testing_infer::Ring;
using testing_infer::StoredSegmenter;
using testing_infer::TwoVariants;

class EvaluateFiles : public testing::Test {
 protected:
  EvaluateFiles() : ring_(MakeRing({}, 1)), segmenter_(ring_.rig.PerfectSegmenter()) {
    for (EvaluationVariant& variant : variants_) {
      variant.options.refine.max_side_points = 300;
    }
    run_.output = folder_ / "evaluation.json";
    run_.program = "1";
    run_.progress = [this](const std::string& line) { lines_.push_back(line); };
  }

  std::vector<EvaluationItem> Items(int count) {
    std::vector<EvaluationItem> items;
    for (int i = 0; i < count; ++i) {
      EvaluationItem item;
      item.rig = "ring";
      item.sensors = "kinect";
      item.seed = static_cast<std::uint64_t>(i);
      item.identity = std::to_string(i);
      item.load = [this, i] {
        if (i == fail_at_) throw IoError("gone");
        ++loaded_;
        return ring_.still;
      };
      items.push_back(item);
    }
    return items;
  }
  std::vector<EvaluatedCase> Run(const std::vector<EvaluationItem>& items) {
    return Evaluate(items, variants_, models_, run_);
  }

  TempFolder folder_;
  Ring ring_;
  StoredSegmenter segmenter_;
  std::vector<EvaluationModel> models_{{{"model.pt", "abc"}, &segmenter_, &ring_.still.structure}};
  EvaluateRun run_;
  std::vector<EvaluationVariant> variants_ = TwoVariants();
  std::vector<std::string> lines_;
  int loaded_ = 0, fail_at_ = -1;
};

TEST_F(EvaluateFiles, AKilledRunContinues) {
  fail_at_ = 2;
  ExpectError<IoError>([&] { Run(Items(3)); }, {"gone"});
  EXPECT_EQ(loaded_, 2);
  EXPECT_EQ(ReadEvaluation(run_.output).size(), 4u);
  fail_at_ = -1;
  const std::vector<EvaluatedCase> cases = Run(Items(3));
  EXPECT_EQ(loaded_, 3);
  ASSERT_EQ(cases.size(), 6u);
  EXPECT_EQ(cases[5].seed, 2u);
  EXPECT_EQ(lines_.size(), 2u + 3u);

  const std::string written = ReadFile(run_.output);
  Run(Items(3));
  EXPECT_EQ(loaded_, 3);
  EXPECT_EQ(ReadFile(run_.output), written);

  // Whatever the outcome depends on makes it new.
  run_.program = "2";
  Run(Items(3));
  EXPECT_EQ(loaded_, 6);
  variants_[1].options.refine.box_sigma_m = 0.006;
  Run(Items(3));
  EXPECT_EQ(loaded_, 9);
  std::vector<EvaluationItem> items = Items(3);
  items[1].identity = "another";
  Run(items);
  EXPECT_EQ(loaded_, 10);
}

TEST_F(EvaluateFiles, ReadsBackWhatItWrote) {
  const std::vector<EvaluatedCase> cases = Run(Items(1)), read = ReadEvaluation(run_.output);
  ASSERT_EQ(read.size(), cases.size());
  for (std::size_t i = 0; i < cases.size(); ++i) {
    EXPECT_EQ(read[i].fingerprint, cases[i].fingerprint);
    EXPECT_EQ(read[i].rig, cases[i].rig);
    EXPECT_EQ(read[i].sensors, cases[i].sensors);
    EXPECT_EQ(read[i].variant, cases[i].variant);
    EXPECT_EQ(read[i].seed, cases[i].seed);
    EXPECT_EQ(read[i].timings_s, cases[i].timings_s);
    for (std::size_t j = 0; j < cases[i].results.size(); ++j) {
      const EvaluatedSensor &a = cases[i].results[j], &b = read[i].results[j];
      EXPECT_EQ(a.status, b.status);
      EXPECT_EQ(a.sides, b.sides);
      EXPECT_EQ(a.sides_fix_pose, b.sides_fix_pose);
      EXPECT_EQ(a.rms_to_structure_m, b.rms_to_structure_m);
      EXPECT_EQ(a.sigma, b.sigma);
      ASSERT_TRUE(a.nominal && b.nominal && a.built && b.built);
      EXPECT_EQ(a.nominal->delta, b.nominal->delta);
      EXPECT_EQ(a.built->refined.translation_m, b.built->refined.translation_m);
      EXPECT_EQ(a.nominal->initial.rotation_deg, b.nominal->initial.rotation_deg);
    }
  }
  EXPECT_EQ(FormatEvaluation(read), FormatEvaluation(cases));
}

TEST_F(EvaluateFiles, ReadsBackHowManyPlacements) {
  std::vector<EvaluatedCase> cases = Run(Items(1));
  cases[1].placements = 4;
  WriteEvaluation(run_.output, cases, {{"m", "s"}});
  const std::vector<EvaluatedCase> read = ReadEvaluation(run_.output);
  EXPECT_EQ(read.at(0).placements, 1);
  EXPECT_EQ(read.at(1).placements, 4);
}

/// Each model under each variant; one more model costs only what it adds.
TEST_F(EvaluateFiles, ComparesModels) {
  for (EvaluationVariant& variant : variants_)
    variant.options.initial.method = PoseMethod::kNetwork;
  Run(Items(2));
  StoredSegmenter blind;
  models_.push_back({{"runs/blind.pt", "def"}, &blind, &ring_.still.structure});
  const std::vector<EvaluatedCase> cases = Run(Items(2));
  ASSERT_EQ(cases.size(), 8u);
  EXPECT_EQ(cases[0].variant, "model, " + variants_[0].name);
  EXPECT_EQ(cases[3].variant, "blind, " + variants_[1].name);
  EXPECT_TRUE(cases[0].results[0].placed());
  EXPECT_FALSE(cases[3].results[0].placed());
  EXPECT_EQ(cases[5].seed, 1u);
  variants_.pop_back();
  EXPECT_EQ(Run(Items(1)).at(1).variant, "blind");
  EXPECT_NE(ReadFile(run_.output).find("\"sha256\": \"def\""), std::string::npos);
  models_[1].checkpoint.file = "other/model.pt";
  ExpectError<ConfigError>([&] { Run(Items(1)); }, {"other/model.pt", "called model too"});
}

TEST_F(EvaluateFiles, RejectsAnotherStructure) {
  const Structure one = Structure::FromBoxes(
      "one", {Box::FromMinMax("box", Eigen::Vector3d::Zero(), Eigen::Vector3d::Ones())});
  ExpectError<DataError>(
      [&] {
        Evaluate(Items(1), variants_, {{{"m", "s"}, &segmenter_, &one}}, run_);
      },
      {"ring", "other sides", "\"one\""});
  WriteFileAtomically(run_.output, "{\"cases\": []}");
  ExpectError<DataError>([&] { Run(Items(1)); }, {"evaluation.json", "another folder"});
}

}  // namespace
}  // namespace volalign::evaluate_test
