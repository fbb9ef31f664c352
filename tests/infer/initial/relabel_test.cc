#include "infer/initial/relabel.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/infer/view/synthetic.h"

namespace volalign::relabel_test {
namespace {

using testing_infer::Certain;
using testing_infer::Coarse;
using testing_infer::LabelOf;

/// A box whose side z = 1 faces Coarse's left half; its side x = 0 is square to that, next to
/// column 9: there, points at 1.01 m lie 1 cm from the one and 13 mm from the other.
class Reconcile : public ::testing::Test {
 protected:
  Structure box_ = Structure::FromBoxes(
      "box", {Box::FromMinMax("b", Eigen::Vector3d(-1, -1, 1), Eigen::Vector3d(0, 1, 2))});
  std::uint8_t near_ = static_cast<std::uint8_t>(LabelOf(box_, "b/left"));
  std::uint8_t next_ = static_cast<std::uint8_t>(LabelOf(box_, "b/front"));
  std::uint8_t far_ = static_cast<std::uint8_t>(LabelOf(box_, "b/right"));
  DepthImage depth_{20, 10, 1.01f};
  /// In one row, at column 9.
  struct Seen {
    std::uint8_t label;
    float confidence;
  };
  Seen At(const Seen& own, const std::vector<Seen>& others,
          const std::vector<StructureAlias>& aliases = {}) {
    const auto labels = [](const Seen& seen) {
      SegmentationResult result = Certain(LabelImage(20, 10, 0));
      result.labels(9, 5) = seen.label;
      result.confidence(9, 5) = seen.confidence;
      return result;
    };
    std::vector<SegmentationResult> of_others;
    of_others.reserve(others.size());
    for (const Seen& other : others) of_others.push_back(labels(other));
    std::vector<const SegmentationResult*> pointers;
    pointers.reserve(of_others.size());
    for (const SegmentationResult& other : of_others) pointers.push_back(&other);
    SegmentationResult result = labels(own);
    ReconcileLabels(MakeSensorView(depth_, Coarse()), box_, aliases, Pose::Identity(), pointers,
                    0.5, &result);
    return {result.labels(9, 5), result.confidence(9, 5)};
  }
};

TEST_F(Reconcile, TheFixtureIsAsDescribed) {
  ASSERT_GT(near_ * next_ * far_, 0);
  const Eigen::Vector3d p = MakeSensorView(depth_, Coarse()).Point(9, 5);
  ASSERT_NEAR((box_.SideOfLabel(near_).ClosestPoint(p) - p).norm(), 0.01, 1e-6);
  ASSERT_NEAR((box_.SideOfLabel(next_).ClosestPoint(p) - p).norm(), 0.0126, 1e-4);
}

TEST_F(Reconcile, ALabelWhoseSideIsNearStaysThoughAnotherIsNearer) {
  const Seen kept = At({next_, 0.6f}, {{near_, 0.9f}});
  EXPECT_EQ(kept.label, next_);
  EXPECT_EQ(kept.confidence, 0.6f);
}

TEST_F(Reconcile, AnyOtherPixelTakesTheNearestSideThatASourceNames) {
  for (const std::uint8_t own : {far_, std::uint8_t{0}}) {
    const Seen one = At({own, 0.8f}, {{next_, 0.9f}});
    EXPECT_EQ(one.label, next_);
    EXPECT_EQ(one.confidence, 0.9f);
    const Seen nearest = At({own, 0.8f}, {{next_, 0.9f}, {near_, 0.7f}, {far_, 1.0f}});
    EXPECT_EQ(nearest.label, near_);
    EXPECT_EQ(nearest.confidence, 0.7f);
  }
}

TEST_F(Reconcile, SourcesThatAreNotSureHaveNoSay) {
  EXPECT_EQ(At({far_, 0.8f}, {{near_, 0.49f}}).label, far_);
  EXPECT_EQ(At({far_, 0.8f}, {{near_, 0.5f}}).label, near_);
}

TEST_F(Reconcile, AnAliasNamesTheSideThatALabelHasAfterIt) {
  StructureAlias alias;
  alias.label_after.assign(static_cast<std::size_t>(box_.num_classes()), 0);
  alias.label_after[far_] = near_;
  const Seen own = At({far_, 0.8f}, {}, {alias});
  EXPECT_EQ(own.label, near_);
  EXPECT_EQ(own.confidence, 0.8f);
  EXPECT_EQ(At({0, 0.8f}, {{far_, 0.6f}}, {alias}).label, near_);
  EXPECT_EQ(At({far_, 0.4f}, {}, {alias}).label, far_);
}

TEST_F(Reconcile, NothingChangesWithoutDepthOrAwayFromTheStructure) {
  depth_ = DepthImage(20, 10, 0.0f);
  EXPECT_EQ(At({far_, 0.8f}, {{near_, 0.9f}}).label, far_);
  depth_ = DepthImage(20, 10, 0.94f);
  EXPECT_EQ(At({far_, 0.8f}, {{near_, 0.9f}}).label, far_);
}

TEST(Relabelled, SidesThatComeToLieOnNoneAreBackground) {
  StructureAlias alias;
  alias.label_after = {0, 3, 0};
  LabelImage labels(4, 1, 0);
  for (int u = 0; u < 4; ++u) labels(u, 0) = static_cast<std::uint8_t>(u);
  const SegmentationResult after = Relabelled(Certain(labels), alias);
  EXPECT_EQ(after.labels(0, 0), 0);
  EXPECT_EQ(after.labels(1, 0), 3);
  EXPECT_EQ(after.labels(2, 0), 0);
  EXPECT_EQ(after.labels(3, 0), 0);  // beyond the table
}

}  // namespace
}  // namespace volalign::relabel_test
