#include "infer/evaluate/suite/suite_items.h"

#include <gtest/gtest.h>

#include <set>

#include "core/base/error.h"
#include "render/tiles/tile_renderer.h"
#include "tests/core/base/temp_folder.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::suite_items_test {
namespace {

class SuiteItemsTest : public testing::Test {
 protected:
  SuiteItemsTest() {
    dataset_.name = "toy";
    dataset_.rigs = {folder_
                         .Write("ring.yaml",
                                "room: false\nnoise: none\nseed: 3\nturns_deg: [0, 10, 20, 30]\n"
                                "sensors:\n"
                                "  - {name: A, sensor: azure_kinect_nfov_binned, phi_deg: 10}\n"
                                "  - {name: B, sensor: azure_kinect_nfov_binned, phi_deg: 70}\n")
                         .string()};
  }
  std::string CapturesOf(int most) const {
    std::string names;
    for (const SuiteItem& item : SuiteItems(dataset_, structure_, false, most))
      names += item.capture + " ";
    return names;
  }

  TempFolder folder_;
  Structure structure_ = testing_infer::PaperStructure();
  SuiteDataset dataset_;
};

TEST_F(SuiteItemsTest, AreTheTurnsOfARigOrSomeOfThemEvenlyTaken) {
  EXPECT_EQ(CapturesOf(0), "ring_turn_1 ring_turn_2 ring_turn_3 ring_turn_4 ");
  EXPECT_EQ(CapturesOf(9), CapturesOf(0));
  EXPECT_EQ(CapturesOf(2), "ring_turn_1 ring_turn_3 ");
  const std::vector<SuiteItem> items = SuiteItems(dataset_, structure_, true, 0);
  std::set<std::string> identities;
  for (const SuiteItem& item : items) {
    EXPECT_EQ(item.dataset, "toy");
    EXPECT_EQ(item.set_up, "ring");
    EXPECT_TRUE(item.rig);
    EXPECT_TRUE(item.infrared);
    identities.insert(item.identity);
  }
  EXPECT_EQ(identities.size(), 4u);
  // The same rig has the same identity, so that its results serve again.
  EXPECT_EQ(SuiteItems(dataset_, structure_, true, 0)[2].identity, items[2].identity);
  dataset_.captures = {(folder_ / "none.json").string()};
  EXPECT_THROW(SuiteItems(dataset_, structure_, false, 0), IoError);
}

TEST_F(SuiteItemsTest, AreRenderedWithViewsOfTheirFrames) {
  const std::vector<SuiteItem> items = SuiteItems(dataset_, structure_, false, 0);
  WorkerRenderer renderer(TileRenderers());
  const SuiteStill first = LoadSuiteStill(items[0], SuiteConfig(), renderer);
  ASSERT_EQ(first.still.frames.size(), 2u);
  ASSERT_EQ(first.views.size(), 2u);
  EXPECT_TRUE(first.infrared.empty());
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(first.views[i].depth, first.still.frames[i].depth);
    EXPECT_TRUE(first.still.frames[i].ground_truth);
  }
  const SuiteStill third = LoadSuiteStill(items[2], SuiteConfig(), renderer);
  EXPECT_FALSE(third.views[0].depth == first.views[0].depth);
}

}  // namespace
}  // namespace volalign::suite_items_test
