#include "infer/refine/estimates.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/infer/refine/points_and_observations.h"

namespace volalign::refine_internal::estimates_test {
namespace {

using testing_infer::SomePriors;

/// Two sensors and the paper's four boxes: priors alone, then what measurements add.
struct Handmade {
  Structure structure = testing_infer::PaperStructure();
  Priors priors = SomePriors();
  ParameterLayout layout = LayoutOf(2, 4);
  FreeSet free = AskedFor(ParseEstimate("auto"), priors, 2, 4);
  Eigen::VectorXd sigmas = layout.PriorSigmas(priors, {ErrorsOf(""), ErrorsOf("")});
  NormalEquations normal;

  Handmade() {
    normal.information = sigmas.cwiseAbs2().cwiseInverse().asDiagonal();
    normal.gradient = Eigen::VectorXd::Zero(layout.size());
  }
  /// A measurement of one parameter that is `times` as tight as its prior.
  void Measure(Eigen::Index column, double times) {
    normal.information(column, column) *= 1 + times * times;
  }
  FreeSet Kept() const {
    return Observable(normal, layout, structure, priors, {LensChange::Zero()},
                      layout.Constant(free), sigmas, free);
  }
};

TEST(Observable, PriorsAloneTellNothing) {
  const FreeSet kept = Handmade().Kept();
  EXPECT_FALSE(kept.size);
  EXPECT_EQ(kept.boxes, (std::vector<char>{0, 0, 0, 0}));
  EXPECT_EQ(kept.gain, (std::vector<char>{0, 0}));
  EXPECT_EQ(kept.offset, (std::vector<char>{0, 0}));
}

TEST(Observable, KeepsWhatIsMeasuredTighterThanItsPrior) {
  Handmade made;
  // 1 / sqrt(1 + 1.1^2) = 0.67 of the prior, under the limit of 0.7; 1 / sqrt(1 + 0.9^2) = 0.74.
  made.Measure(made.layout.Size(), 1.1);
  made.Measure(made.layout.Gain(0), 1.1);
  made.Measure(made.layout.Gain(1), 0.9);
  made.Measure(made.layout.Offset(1), 1.1);
  for (const Eigen::Index b : {0, 1, 3}) {
    made.Measure(made.layout.Boxes() + 3 * b, 5);
    if (b != 3) made.Measure(made.layout.Boxes() + 3 * b + 1, 5);
  }
  const FreeSet kept = made.Kept();
  EXPECT_TRUE(kept.size);
  EXPECT_EQ(kept.gain, (std::vector<char>{1, 0}));
  EXPECT_EQ(kept.offset, (std::vector<char>{0, 1}));
  EXPECT_EQ(kept.boxes, (std::vector<char>{1, 1, 0, 0})) << "of the last, only x is known";
  // What is not free is never kept.
  made.free.size = false;
  EXPECT_FALSE(made.Kept().size);
}

TEST(Observable, AnOffsetIsKnownWhereItsGainIsHeld) {
  // Depths at 2.3 m, where a gain moves them as far as the offset does: their sum is measured to
  // half of what each may be. Either is then known to sqrt(1.25 / 2.25) = 0.75 of its prior, over
  // the limit of 0.7; the offset, where the gain is none, to sqrt(0.25 / 1.25) = 0.45 of it.
  Handmade made;
  const Eigen::Index offset = made.layout.Offset(0), gain = made.layout.Gain(0);
  const double depth = made.priors.offset / *made.priors.gain, sigma = made.priors.offset / 2;
  Eigen::VectorXd row = Eigen::VectorXd::Zero(made.layout.size());
  row[offset] = 1 / sigma;
  row[gain] = depth / sigma;
  made.normal.information += row * row.transpose();
  const Eigen::MatrixXd both = made.normal.information.inverse();
  ASSERT_NEAR(std::sqrt(both(offset, offset)) / made.priors.offset, 0.745, 0.001);
  ASSERT_NEAR(std::sqrt(both(gain, gain)) / *made.priors.gain, 0.745, 0.001);
  const FreeSet kept = made.Kept();
  EXPECT_FALSE(kept.gain[0]);
  EXPECT_TRUE(kept.offset[0]);
}

}  // namespace
}  // namespace volalign::refine_internal::estimates_test
