#include "infer/calib/look.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "infer/initial/aliases.h"
#include "infer/initial/pose_sources.h"
#include "infer/initial/same_pose.h"
#include "tests/infer/checks/seen_with_labels.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::look_test {
namespace {

using testing_infer::Certain;
using testing_infer::Rig;
using testing_infer::RingPose;
using testing_infer::StoredSegmenter;

/// S0, S1 and S2, of which S0 was located, S1 was not and S2 has no depth that could be.
class LookAgain : public testing::Test {
 protected:
  LookAgain() : capture_({{"", TheRig().frames}}, TheRig().structure) {
    seen_ = testing_infer::SeenWithLabels(capture_, TheRig().labels);
    for (const std::size_t i : {std::size_t{1}, std::size_t{2}}) seen_.labelled[{0, i}] = {};
    seen_.depths[{0, 2}].failure = Finding{SensorCode::kWrongUnits, "", ""};
    results_ = PerFrame<LocateResult>({{LocatedFrame(), Finding(), Finding()}});
    for (std::size_t i = 0; i < 3; ++i)
      segmenter_.Store(TheRig().frames[i].depth, Certain(TheRig().labels[i]));
  }
  static const Rig& TheRig() {
    static const Rig rig = [] {
      Rig made{testing_infer::PaperStructure(), {}, {}};
      for (int i = 0; i < 3; ++i) made.Add("S" + std::to_string(i), RingPose(40 + 100 * i));
      return made;
    }();
    return rig;
  }

  CaptureSet capture_;
  Seen seen_;
  PerFrame<LocateResult> results_;
  StoredSegmenter segmenter_;
  StageClock clock_;
};

TEST_F(LookAgain, AFrameThatHadNoPoseIsLabelledAnew) {
  const PerFrame<Labelled> again = LabelAgain(seen_, results_, &segmenter_, {}, &clock_);
  const Labelled& anew = again[{0, 1}];
  ASSERT_TRUE(anew.initial.found);
  const PoseError error =
      ComparePoses(anew.initial.structure_from_sensor, *TheRig().frames[1].ground_truth);
  EXPECT_LT(error.translation_m, 0.02);
  EXPECT_FALSE((again[{0, 2}].initial.found)) << "nothing can be seen in it";
}

TEST_F(LookAgain, ALocatedFrameKeepsItsLabels) {
  const LabelImage before = seen_.labelled[{0, 0}].segmentation.labels;
  segmenter_ = StoredSegmenter();  // which labels nothing
  const PerFrame<Labelled> again = LabelAgain(seen_, results_, &segmenter_, {}, &clock_);
  EXPECT_TRUE((again[{0, 0}].segmentation.labels == before));
  EXPECT_TRUE((again[{0, 0}].initial.found));
}

// Nothing tells up from down but the pose that the other sensor has already.
TEST(LabelAgain, WhatIsLabelledAnewSuitsThePosesThatStay) {
  Rig rig{testing_infer::PaperStructure(), {}, {}};
  for (int i = 0; i < 2; ++i) rig.Add("S" + std::to_string(i), RingPose(40 + 60 * i), {false, 0});
  const Pose over = FindAliases(rig.structure).front().motion;
  const CaptureSet capture({{"", rig.frames}}, rig.structure);
  Seen seen = testing_infer::SeenWithLabels(capture, rig.labels);
  Labelled& first = seen.labelled[{0, 0}];
  const Pose turned = over * *rig.frames[0].ground_truth;
  first = {};
  LabelledPose by_pose = LabelByPose(seen.views[{0, 0}], rig.structure, turned, {});
  ASSERT_TRUE(by_pose.initial.found);
  first.segmentation = std::move(by_pose.segmentation);
  first.initial = std::move(by_pose.initial);
  first.source = PoseSource::kGeometry;
  seen.labelled[{0, 1}] = {};
  StageClock clock;
  const PerFrame<Labelled> again =
      LabelAgain(seen, PerFrame<LocateResult>({{LocatedFrame(), Finding()}}), nullptr, {}, &clock);
  ASSERT_TRUE((again[{0, 1}].initial.found));
  EXPECT_TRUE(SamePose(rig.structure, again[{0, 1}].initial.structure_from_sensor,
                       over * *rig.frames[1].ground_truth));
}

}  // namespace
}  // namespace volalign::look_test
