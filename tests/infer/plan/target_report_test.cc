#include "infer/plan/target_report.h"

#include <gtest/gtest.h>

#include "tests/core/base/expect_error.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::target_report_test {
namespace {

Structure OneBox() {
  return Structure::FromBoxes("crate", {Box::FromMinMax("box", {-0.2, -0.3, -0.2}, {0.2, 0, 0.2})});
}

/// Four views from 1 m: one that is good, one that fixes no pose, and two like those of symmetries,
/// of which the floor tells the second.
TargetQuality Mixed() {
  TargetQuality quality;
  quality.options.directions = 4;
  quality.options.heights_m = {1};
  quality.symmetries = {{"turned by 180 deg", 2, true, false}, {"upside down", 1, false, true}};
  for (int i = 0; i < 4; ++i) {
    TargetView view;
    view.phi_deg = 90 * i;
    view.height_m = 1;
    view.sides = 3 + i;
    view.sides_fix_pose = i != 1;
    view.weakest_m = i == 0 ? 0.002 : i == 3 ? 0.005 : 0.004;
    if (i >= 2) view.look_alike = {i - 2};
    quality.views.push_back(view);
  }
  return quality;
}

TargetQuality Good() {
  TargetQuality quality = Mixed();
  quality.symmetries.clear();
  for (TargetView& view : quality.views) {
    view.sides_fix_pose = true;
    view.look_alike.clear();
  }
  return quality;
}

TEST(FormatTarget, SaysWhatSpeaksAgainstTheStack) {
  const std::string text = FormatTarget(OneBox(), Mixed());
  for (const char* part :
       {"crate: 1 box, 300 mm high; the origin is 300 mm above the floor",
        "Turned by 180 deg, the stack looks the same from 25 % of the directions.\n",
        ("Upside down, 1 of its 1 boxes lie where boxes lay, and the stack looks the same from 25 "
         "% of the directions; only the floor tells the two apart.\n"),
        // Height; poses that are fixed, unique with the floor, and without it, %; sides; sigmas in
        // mm.
        "    1.00          75        75          50           3   6         4.0       5.0\n",
        "poor: from 25 % of the places another pose looks the same, with or without the floor",
        "poor: 25 % of the views do not determine a pose",
        "without it, 50 % of the views look like"}) {
    EXPECT_TRUE(Has(text, part)) << "\nis not in\n";
  }
  EXPECT_FALSE(Has(text, "good:"));
}

TEST(FormatTarget, SaysThatAStackIsGood) {
  const std::string text = FormatTarget(OneBox(), Good());
  EXPECT_TRUE(Has(text, "The stack has no symmetries.", "good: every view fits one pose"));
  EXPECT_FALSE(Has(text, "poor:"));
}

}  // namespace
}  // namespace volalign::target_report_test
