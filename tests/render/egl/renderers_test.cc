#include "render/egl/renderers.h"

#include <gtest/gtest.h>

#include "core/base/error.h"
#include "render/egl/gl_depth_renderer.h"
#include "render/sample.h"
#include "render/tiles/tile_renderer.h"
#include "tests/core/base/expect_error.h"
#include "tests/render/both_renderers.h"
#include "tests/render/test_scene.h"

namespace volalign::renderers_test {
namespace {

TEST(ChooseRenderersTest, DecidesAuto) {
  EXPECT_EQ(ChooseRenderers("egl").name, "egl");
  EXPECT_EQ(ChooseRenderers("cpu").name, "cpu");
  EXPECT_EQ(ChooseRenderers("auto").name, EglContext().IsSoftware() ? "cpu" : "egl");
  EXPECT_EQ(ChooseRenderers("auto", {}, /*cuda_trains=*/true).name, "cpu");
  EXPECT_TRUE(Has(ChooseRenderers("auto", {}, true).description, "GPU"));
  EXPECT_THROW(ChooseRenderers("gl"), Error);
}

TEST(ChooseRenderersTest, AutoDoesWithoutOpenGl) {
  const EglContextOptions none{/*device=*/1000};
  EXPECT_EQ(ChooseRenderers("auto", none).name, "cpu");
  EXPECT_THROW(ChooseRenderers("egl", none), IoError);
}

/// Training samples of furnished rooms: of every sensor of the pool, with its lens.
class SampleScenes : public testing::TestWithParam<std::pair<const char*, const char*>> {};

TEST_P(SampleScenes, LookTheSame) {
  const EglContext egl;
  GlDepthRenderer gl;
  TileRenderer tiles;
  BothRenderers both(gl, tiles, true);
  const SampleContext context =
      MakeSampleContext(SamplesOf(GetParam().first, GetParam().second, "none"), 16);
  for (std::uint64_t index = 0; index < 24; ++index) Synthesize(context, both, 77, index);
  // Through a lens, OpenGL loses what is smaller than a pixel of the picture that it is cut from.
  both.ExpectTheSame(context.image_sizes[0].first < 100 ? 5e-3 : 5e-4);
}

INSTANTIATE_TEST_SUITE_P(Sensors, SampleScenes,
                         testing::Values(std::pair("realsense_d415", "320x180"),
                                         std::pair("realsense_d415", "73x41"),
                                         std::pair("azure_kinect_nfov_binned", "320x288"),
                                         std::pair("azure_kinect_nfov_binned", "51x46")));

}  // namespace
}  // namespace volalign::renderers_test
