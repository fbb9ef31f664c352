#include "infer/report/pictures.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "core/plot/picture.h"
#include "core/plot/picture_text.h"

namespace volalign::pictures_test {
namespace {

constexpr Rgb kDepth{200, 1, 1}, kLabels{1, 200, 1}, kModel{1, 1, 200}, kResidual{200, 200, 1};

int Count(const RgbImage& picture, Rgb colour) {
  return static_cast<int>(std::count(picture.begin(), picture.end(), colour));
}

/// A square of a legend is 8 pixels wide within its frame.
constexpr int kSwatchPixels = 64;

class Pictures : public testing::Test {
 protected:
  Pictures() {
    panels_.depth = RgbImage(80, 30, kDepth);
    panels_.labels = RgbImage(80, 30, kLabels);
    panels_.far_m = 1;
    panels_.shown_labels = {2, 20};
    sensor_.name = "S0";
  }

  Structure structure_ = ReadStructure("configs/structure.yaml");
  SensorOutcome sensor_;
  FramePanels panels_;
};

TEST(ConfidenceImage, HasAllOfItsRange) {
  Image<float> confidence(5, 1);
  const float values[] = {0, 0.5F, 1, -0.5F, 1.5F};
  std::copy(std::begin(values), std::end(values), confidence.begin());
  const LabelImage image = ConfidenceImage(confidence);
  EXPECT_EQ(std::vector<int>(image.begin(), image.end()), (std::vector<int>{0, 128, 255, 0, 255}));
}

TEST_F(Pictures, ASensorsPanelsStandSideBySide) {
  const RgbImage two = SensorPicture(sensor_, panels_, structure_, false);
  EXPECT_EQ(Count(two, kDepth), 80 * 30);
  EXPECT_EQ(Count(two, kLabels), 80 * 30);
  panels_.edges = RgbImage(80, 30, kModel);
  panels_.residual = RgbImage(80, 30, kResidual);
  const RgbImage four = SensorPicture(sensor_, panels_, structure_, false);
  EXPECT_EQ(four.height(), two.height());
  EXPECT_EQ(four.width(), two.width() + 2 * (80 + 2));
  // From left to right in one row.
  const auto left = [&](Rgb colour) {
    for (int u = 0; u < four.width(); ++u) {
      for (int v = 0; v < four.height(); ++v) {
        if (four(u, v) == colour) return u;
      }
    }
    return -1;
  };
  EXPECT_EQ(left(kLabels), left(kDepth) + 82);
  EXPECT_EQ(left(kModel), left(kLabels) + 82);
  EXPECT_EQ(left(kResidual), left(kModel) + 82);
  for (const Rgb colour : {kDepth, kLabels, kModel, kResidual})
    EXPECT_EQ(Count(four, colour), 2400);
}

/// The title and the first panel's heading are the words that DrawText writes there.
TEST_F(Pictures, TheTitleNamesTheSensorAndItsStatus) {
  panels_.depth = panels_.labels = RgbImage(200, 30, kDepth);
  sensor_.status = SensorStatus::kWeak;
  const RgbImage picture = SensorPicture(sensor_, panels_, structure_, false);
  for (const std::string words : {"S0: weak", "measured depth, m"}) {
    RgbImage text(kTextWidth * CountCharacters(words), kTextHeight);
    DrawText(&text, 0, 0, words, {1, 1, 1});
    // Somewhere above the panels at the left margin, where all of its ink is of one colour.
    bool found = false;
    for (int top = 0; top < 60 && !found; ++top) {
      for (int left = 0; left < 20 && !found; ++left) {
        found = true;
        for (int v = 0; v < text.height(); ++v) {
          for (int u = 0; u < text.width(); ++u)
            found = found && (text(u, v).r > 0) != (picture(left + u, top + v) == picture(0, 0));
        }
      }
    }
    EXPECT_TRUE(found) << words;
  }
}

TEST_F(Pictures, LegendsHaveTheLabelsThatAreShown) {
  const RgbImage bare = SensorPicture(sensor_, panels_, structure_, false);
  const RgbImage with = SensorPicture(sensor_, panels_, structure_, true);
  EXPECT_GT(with.height(), bare.height());
  for (int label = 1; label <= 20; ++label) {
    const int more = Count(with, LabelColour(label)) - Count(bare, LabelColour(label));
    EXPECT_EQ(more, label == 2 || label == 20 ? kSwatchPixels : 0) << label;
  }
  const RgbImage overview = OverviewPicture({bare, bare, bare, bare}, structure_);
  for (int label = 1; label <= 20; ++label)
    EXPECT_EQ(Count(overview, LabelColour(label)) - 4 * Count(bare, LabelColour(label)),
              kSwatchPixels);
  EXPECT_EQ(Count(overview, kDepth), 4 * 80 * 30);
  EXPECT_GT(overview.height(), 2 * bare.height());  // two rows
}

}  // namespace
}  // namespace volalign::pictures_test
