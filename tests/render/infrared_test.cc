#include "render/infrared.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "render/egl/renderers.h"

namespace volalign::infrared_test {
namespace {

/// A cube seen from 1 m before its front, a pixel for each centimetre of it.
class Infrared : public testing::Test {
 protected:
  Infrared() {
    structure_ =
        Structure::FromBoxes("one", {Box::FromMinMax("box", {-0.2, -0.2, -0.2}, {0.2, 0.2, 0.2})});
    front_ = structure_.SideOfLabel(1);
    mesh_.BeginObject({0.6F, 1.0F, true});
    const Eigen::Vector3d u = front_.half_u * front_.axis_u, v = front_.half_v * front_.axis_v;
    mesh_.AppendQuad({front_.centre - u - v, front_.centre + u - v, front_.centre + u + v,
                      front_.centre - u + v},
                     front_.normal, front_.label);
    intrinsics_.width = intrinsics_.height = 80;
    intrinsics_.fx = intrinsics_.fy = 100;
    intrinsics_.cx = intrinsics_.cy = 39.5;
    pose_ = LookAt(front_.centre + front_.normal, front_.centre, 0);
    plain_.supersampling = 1;
    plain_.blur_px = 0;
    plain_.full_well_electrons = 0;
    plain_.black = 0.3;
    plain_.white = 0.9;
  }
  GreyImage Picture(const std::vector<MarkerPrint>& prints, const InfraredConfig& config,
                    std::uint64_t index = 0) {
    return RenderInfrared(mesh_, structure_, prints, intrinsics_, pose_, config, *renderer_, 1,
                          index);
  }
  /// Grey value where the picture shows the front's centre moved along its axes, m.
  int At(const GreyImage& picture, double along_u, double along_v) const {
    const Eigen::Vector3d p =
        pose_.inverse() * (front_.centre + along_u * front_.axis_u + along_v * front_.axis_v);
    return picture(static_cast<int>(std::lround(100 * p.x() / p.z() + 39.5)),
                   static_cast<int>(std::lround(100 * p.y() / p.z() + 39.5)));
  }

  Structure structure_;
  Side front_;
  SceneMesh mesh_;
  Intrinsics intrinsics_;
  Pose pose_;
  InfraredConfig plain_;
  const std::unique_ptr<DepthRenderer> renderer_ = ChooseRenderers(RendererKind::kCpu).make();
};

TEST_F(Infrared, PrintsReflectTheirShareWhereTheirCellsAre) {
  MarkerPrint print{front_.label, GreyImage(2, 2)};
  print.cells(0, 0) = 255;  // the first column along axis_u, the first row at the end of axis_v
  const GreyImage bare = Picture({}, plain_), printed = Picture({print}, plain_);
  // Of the bare side, whose object reflects 0.6; exposures differ by what the corner beyond the
  // paper shows.
  const double exposures = static_cast<double>(At(printed, 0.15, 0.15)) / At(bare, 0.15, 0.15);
  const auto reflectivity = [&](double along_u, double along_v) {
    return 0.6 * At(printed, along_u, along_v) / At(bare, along_u, along_v) / exposures;
  };
  EXPECT_NEAR(reflectivity(-0.04, 0.04), 0.9, 0.03);
  EXPECT_NEAR(reflectivity(0.04, 0.04), 0.3, 0.03);
  EXPECT_NEAR(reflectivity(-0.04, -0.04), 0.3, 0.03);
  EXPECT_NEAR(reflectivity(0.04, -0.04), 0.3, 0.03);
  EXPECT_NEAR(reflectivity(0.0925, 0), 0.9, 0.03);  // paper around them
  EXPECT_NEAR(reflectivity(0, -0.0925), 0.9, 0.03);
  EXPECT_EQ(printed(0, 0), 0);  // nothing is there
}

TEST_F(Infrared, TheLampShowsWhatIsNearInFullAndExposureFollowsTheBrightest) {
  const GreyImage bare = Picture({}, plain_);
  const int middle = At(bare, 0, 0), corner = At(bare, 0.19, 0.19);
  // Room light, and a lamp that falls with the cosine and with the square of the range.
  const double range2 = 1 + 2 * 0.19 * 0.19;
  EXPECT_NEAR(static_cast<double>(corner) / middle,
              (0.5 + 0.5 * 4 / (range2 * std::sqrt(range2))) / (0.5 + 0.5 * 4), 0.02);
  std::vector<std::uint8_t> sorted(bare.begin(), bare.end());
  std::sort(sorted.begin(), sorted.end());
  EXPECT_NEAR(sorted[static_cast<std::size_t>(0.9 * static_cast<double>(sorted.size()))],
              255 * plain_.exposure, 2);
}

TEST_F(Infrared, APixelIsTheMeanOfItsRays) {
  InfraredConfig fine = plain_;
  fine.supersampling = 2;
  const GreyImage one = Picture({}, plain_), four = Picture({}, fine);
  for (const double u : {-0.15, 0.0, 0.15}) {
    for (const double v : {-0.15, 0.0, 0.15}) EXPECT_NEAR(At(four, u, v), At(one, u, v), 2);
  }
}

TEST_F(Infrared, BlurSpreadsEdgesAndNoiseIsThatOfTheFrame) {
  const GreyImage sharp = Picture({}, plain_);
  InfraredConfig blurred = plain_, noisy = plain_;
  blurred.blur_px = 1.5;
  noisy.full_well_electrons = 5000;
  const GreyImage soft = Picture({}, blurred);
  // The side's edge is between the pixels 19 and 20 of a row.
  EXPECT_EQ(sharp(19, 40), 0);
  EXPECT_GT(sharp(20, 40), 100);
  EXPECT_NEAR(soft(19, 40) + soft(20, 40), sharp(20, 40), 3);
  EXPECT_GT(soft(18, 40), 10);
  const GreyImage grainy = Picture({}, noisy);
  EXPECT_FALSE(grainy == sharp);
  EXPECT_EQ(Picture({}, noisy), grainy);
  EXPECT_FALSE(Picture({}, noisy, 1) == grainy);
}

}  // namespace
}  // namespace volalign::infrared_test
