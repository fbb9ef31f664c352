#include "infer/initial/sides_fix_pose.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "core/geometry/procrustes.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::sides_fix_pose_test {
namespace {

using testing_infer::LabelOf;
using testing_infer::PaperStructure;

std::vector<int> LabelsOf(const Structure& structure, const std::vector<std::string>& names) {
  std::vector<int> labels;
  labels.reserve(names.size());
  for (const std::string& name : names) labels.push_back(LabelOf(structure, name));
  return labels;
}

TEST(SidesFixPose, KnowsTheStructuresCollinearKeypoints) {
  const Structure structure = PaperStructure();
  const auto fixes = [&](const std::vector<std::string>& names) {
    return SidesFixPose(structure, LabelsOf(structure, names));
  };
  // Exactly collinear centres, of parallel sides.
  EXPECT_FALSE(fixes({"mid_bottom/front", "mid_top/front", "top/front"}));
  EXPECT_FALSE(fixes({"bottom/right", "mid_bottom/right", "mid_top/right"}));
  EXPECT_FALSE(fixes({"mid_bottom/front"}));
  EXPECT_FALSE(fixes({"mid_bottom/front", "mid_top/right"}));
  EXPECT_FALSE(fixes({}));
  // One side off the line.
  EXPECT_TRUE(fixes({"mid_bottom/front", "mid_top/front", "top/front", "bottom/front"}));
  EXPECT_TRUE(fixes({"mid_bottom/front", "mid_top/front", "top/right"}));
  EXPECT_TRUE(fixes({"bottom/right", "mid_bottom/front", "mid_top/up"}));
}

TEST(SidesFixPose, PlanesFixWhatKeypointsInALineDoNot) {
  const auto box = [](const char* name, const Eigen::Vector3d& min, const Eigen::Vector3d& max) {
    return Box::FromMinMax(name, min, max);
  };
  // Faces of three directions whose centres are (0, 0, 0), (0, 1, 0) and (0, 2, 0).
  const Structure mixed =
      Structure::FromBoxes("mixed", {box("a", {-0.5, -0.25, -0.25}, {0, 0.25, 0.25}),
                                     box("b", {-0.25, 0.75, -0.5}, {0.25, 1.25, 0}),
                                     box("c", {-0.25, 1.5, -0.25}, {0.25, 2, 0.25})});
  const std::vector<int> labels = LabelsOf(mixed, {"a/front", "b/right", "c/up"});
  std::vector<Eigen::Vector3d> centres;
  centres.reserve(labels.size());
  for (const int label : labels) centres.push_back(mixed.SideOfLabel(label).centre);
  ASSERT_LT((centres[1] - Eigen::Vector3d(0, 1, 0)).norm(), 1e-12);
  ASSERT_LT(SecondSingularValue(centres), 1e-9);
  EXPECT_TRUE(SidesFixPose(mixed, labels));
  EXPECT_FALSE(SidesFixPose(mixed, LabelsOf(mixed, {"a/front", "b/right"})));
}

}  // namespace
}  // namespace volalign::sides_fix_pose_test
