#include "render/lens_picture.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "render/depth_renderer.h"
#include "tests/core/base/pixels.h"

namespace volalign::lens_picture_test {
namespace {

Intrinsics Barrel() { return {40, 30, 30, 30, 19.2, 14.7, {-0.15, 0.02, 0, 0}}; }

Eigen::Vector2d RayOf(const Intrinsics& pinhole, int u, int v) {
  return {(u - pinhole.cx) / pinhole.fx, (v - pinhole.cy) / pinhole.fy};
}

TEST(PlanLensPicture, ThePinholePictureHasAllRaysWithTheirNeighbours) {
  const LensPicture picture = PlanLensPicture(Barrel());
  const Intrinsics& pinhole = picture.pinhole;
  EXPECT_TRUE(pinhole.distortion.empty());
  EXPECT_EQ(pinhole.fx, 60);  // finer than the middle of the lens's picture
  double left = 1e9, right = -1e9;
  for (const Eigen::Vector2f& ray : picture.rays.rays) {
    const double u = pinhole.fx * ray.x() + pinhole.cx, v = pinhole.fy * ray.y() + pinhole.cy;
    EXPECT_GE(u, 0);
    EXPECT_LT(u, pinhole.width - 1);
    EXPECT_GE(v, 0);
    EXPECT_LT(v, pinhole.height - 1);
    left = std::min(left, u);
    right = std::max(right, u);
  }
  // Not much more than these.
  EXPECT_LT(left, 4);
  EXPECT_GT(right, pinhole.width - 6);
}

/// A near wall to the right of x = 0 and a far one to the left of it, both 0.2 high each metre off.
class TwoWalls : public testing::Test {
 protected:
  static constexpr std::uint32_t kFar = 3 << 16 | 1, kNear = 5 << 16 | 2;

  TwoWalls() {
    Append(kFar, 2, -10, 0);
    Append(kNear, 1, 0, 10);
    const Intrinsics& pinhole = picture_.pinhole;
    for (const auto [u, v] : Pixels(pinhole.width, pinhole.height))
      ids_.push_back(IdAt(RayOf(pinhole, u, v)));
    view_.depth = DepthImage(40, 30, 9.0F);
    view_.labels = LabelImage(40, 30, 9);
    view_.faces = Image16(40, 30, 9);
  }
  void Append(std::uint32_t id, float z, float from, float to) {
    first_corner_.push_back(static_cast<std::uint32_t>(corners_.size()));
    const std::array<Eigen::Vector2f, 4> around = {
        Eigen::Vector2f(from, -0.2F * z), {to, -0.2F * z}, {to, 0.2F * z}, {from, 0.2F * z}};
    for (const Eigen::Vector2f& corner : around)
      corners_.push_back({{corner.x(), corner.y(), z}, {0, 0, 1 / z}, z, z, id});
  }
  static std::uint32_t IdAt(const Eigen::Vector2d& ray) {
    if (std::abs(ray.y()) > 0.2) return 0;
    return ray.x() < 0 ? kFar : kNear;
  }

  LensPicture picture_ = PlanLensPicture(Barrel());
  std::vector<std::uint32_t> ids_, first_corner_;
  std::vector<FaceCorner> corners_;
  RenderedView view_;
};

TEST_F(TwoWalls, EachPixelShowsWhatItsOwnRayMeets) {
  DrawThroughLens(picture_, ids_, corners_, first_corner_, &view_);
  int far = 0, near = 0, nothing = 0;
  for (const auto [u, v] : Pixels(40, 30)) {
    SCOPED_TRACE(testing::Message() << u << " " << v);
    const Eigen::Vector2d ray = picture_.rays.at(u, v).cast<double>();
    if (std::abs(ray.x()) < 1e-4 || std::abs(std::abs(ray.y()) - 0.2) < 1e-4) continue;
    const std::uint32_t id = IdAt(ray);
    EXPECT_NEAR(view_.depth(u, v), id == 0 ? 0 : id == kFar ? 2 : 1, 1e-6);
    EXPECT_EQ(view_.labels(u, v), id >> 16);
    EXPECT_EQ(view_.faces(u, v), id & 0xFFFFU);
    EXPECT_EQ(view_.rays->at(u, v), picture_.rays.at(u, v));
    (id == 0 ? nothing : id == kFar ? far : near) += 1;
  }
  EXPECT_GT(far, 100);
  EXPECT_GT(near, 100);
  EXPECT_GT(nothing, 100);
}

TEST_F(TwoWalls, AnInclinedFaceHasTheDepthOfItsPlane) {
  // The far wall turned about the vertical: z = 2 + x / 2, hence n / h = (-1/4, 0, 1/2).
  for (FaceCorner& corner : corners_) {
    corner.inverse_plane = {-0.25F, 0, 0.5F};
    corner.z_min = 0.1F;
    corner.z_max = 100;
  }
  for (std::uint32_t& id : ids_) id = kFar;
  DrawThroughLens(picture_, ids_, corners_, first_corner_, &view_);
  for (const auto [u, v] : Pixels(40, 30)) {
    const double x = picture_.rays.at(u, v).x();
    EXPECT_NEAR(view_.depth(u, v), 2 / (1 - x / 2), 1e-4);
  }
}

TEST_F(TwoWalls, WhereThereIsNoRayNothingIsSeen) {
  picture_.rays.rays[0].setConstant(std::nanf(""));
  picture_.view_rays = ViewRays(picture_.rays);
  for (std::uint32_t& id : ids_) id = kFar;
  DrawThroughLens(picture_, ids_, corners_, first_corner_, &view_);
  EXPECT_EQ(view_.depth(0, 0), 0);
  EXPECT_EQ(view_.labels(0, 0), 0);
  EXPECT_EQ(view_.rays->at(0, 0), Eigen::Vector2f(0, 0));
  EXPECT_EQ(view_.depth(1, 0), 2);
}

}  // namespace
}  // namespace volalign::lens_picture_test
