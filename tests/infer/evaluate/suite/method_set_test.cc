#include "infer/evaluate/suite/method_set.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "core/base/input_file.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::method_set_test {
namespace {

/// A network's, of which the file alone counts, markers, and one whose model is missing.
class Methods : public testing::Test {
 protected:
  Methods() {
    SuiteMethod net, markers, missing;
    net.name = "net";
    net.model = folder_.Write("net.pt", "weights").string();
    net.datasets = {"arc"};
    missing = net;
    missing.name = "missing";
    missing.model = (folder_ / "none.pt").string();
    markers.name = "markers";
    markers.kind = MethodKind::kMarkers;
    suite_.methods = {missing, net, markers};
    rendered_.dataset = recorded_.dataset = "arc";
    rendered_.identity = "1";
    recorded_.identity = "2";
    rendered_.rig.emplace();
  }
  std::string Fingerprint(std::size_t i, const std::string& program = "program") const {
    return MethodSet(suite_, program).Fingerprint(i, rendered_);
  }

  TempFolder folder_;
  SuiteConfig suite_;
  SuiteItem rendered_, recorded_;
};

TEST_F(Methods, AreThoseThatHaveTheirModel) {
  const MethodSet set(suite_, "program");
  ASSERT_EQ(set.size(), 2u);
  EXPECT_EQ(set.at(0).name, "net");
  EXPECT_EQ(set.at(1).name, "markers");
  EXPECT_TRUE(set.HasMarkers());
  EXPECT_FALSE(HasModel(suite_.methods[0]));
  suite_.methods.pop_back();
  EXPECT_FALSE(MethodSet(suite_, "program").HasMarkers());
}

TEST_F(Methods, HaveModelsInTheDataFolderToo) {
  suite_.methods[0].model = "models/of_the_suite.pt";
  EXPECT_FALSE(HasModel(suite_.methods[0]));
  std::filesystem::create_directory(folder_ / "models");
  folder_.Write("models/of_the_suite.pt", "weights");
  const std::string before = DataFolder();
  SetDataFolder(folder_.path().string());
  EXPECT_TRUE(HasModel(suite_.methods[0]));
  EXPECT_EQ(MethodSet(suite_, "program").size(), 3u);
  SetDataFolder(before);
}

TEST_F(Methods, ApplyToTheirDatasetsAndMarkersToRenderedCaptures) {
  const MethodSet set(suite_, "program");
  EXPECT_TRUE(set.Applies(0, rendered_));
  EXPECT_TRUE(set.Applies(0, recorded_));
  EXPECT_TRUE(set.Applies(1, rendered_));
  EXPECT_FALSE(set.Applies(1, recorded_));
  rendered_.dataset = "ring";
  EXPECT_FALSE(set.Applies(0, rendered_));
  EXPECT_TRUE(set.Applies(1, rendered_));
}

TEST_F(Methods, AFingerprintChangesWithAllThatTheResultDependsOn) {
  const std::string net = Fingerprint(0), markers = Fingerprint(1);
  EXPECT_EQ(Fingerprint(0), net);
  EXPECT_NE(net, markers);
  EXPECT_NE(Fingerprint(0, "another"), net);
  EXPECT_NE(MethodSet(suite_, "program").Fingerprint(0, recorded_), net);
  const SuiteConfig before = suite_;
  const auto expect = [&](bool of_net, bool of_markers) {
    EXPECT_EQ(Fingerprint(0) != net, of_net);
    EXPECT_EQ(Fingerprint(1) != markers, of_markers);
    suite_ = before;
  };
  suite_.min_side_pixels += 1;
  expect(true, true);
  suite_.graph.iterations += 1;
  expect(true, true);
  suite_.infrared.blur_px += 1;  // which markers alone see
  expect(false, true);
  suite_.methods[1].statistical = true;
  expect(true, false);
  suite_.tables.emplace_back();  // results do not depend on what is made of them
  expect(false, false);
  folder_.Write("net.pt", "other weights");
  expect(true, false);
}

}  // namespace
}  // namespace volalign::method_set_test
