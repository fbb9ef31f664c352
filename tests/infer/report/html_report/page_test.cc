#include "infer/report/html_report/page.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "infer/report/html_report/payload.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::page_test {
namespace {

using testing_infer::PaperStructure;

/// What stands between the script element's tags.
std::string PayloadText(const std::string& page) {
  const std::string begin = "<script type=\"application/json\" id=\"payload\">";
  const std::size_t at = page.find(begin) + begin.size();
  return page.substr(at, page.find("</script>", at) - at);
}

TEST(ReportPage, CarriesThePayloadWhateverItSays) {
  const nlohmann::ordered_json payload = {
      {"text", "</script><script>alert(1)</script><!-- {{scripts}} {{payload}} \" ' & é"},
      {"number", 1.5}};
  const std::string page = ReportPage(payload);
  EXPECT_EQ(nlohmann::ordered_json::parse(PayloadText(page)), payload);
  EXPECT_EQ(page.find("alert(1)</script>"), std::string::npos);
}

TEST(ReportPage, NeedsNothingElse) {
  const std::string page = ReportPage({{"a", 1}});
  for (const char* mark : {"{{style}}", "{{three}}", "{{payload}}", "{{scripts}}"})
    EXPECT_EQ(page.find(mark), std::string::npos) << mark;
  EXPECT_NE(page.find("default-src 'none'"), std::string::npos);
  EXPECT_EQ(page.find("<link rel=\"stylesheet\""), std::string::npos);
  EXPECT_EQ(page.find("src=\""), std::string::npos);
  // three.js, its controls, and its licence.
  for (const char* part : {"REVISION", "OrbitControls", "Permission is hereby granted"})
    EXPECT_NE(page.find(part), std::string::npos) << part;
}

TEST(ReportPayload, HasTheStructureAsItIs) {
  const Structure structure = PaperStructure();
  const nlohmann::ordered_json payload = ReportPayload(
      Extrinsics(), {{"", structure, {}}}, {"one\n\ntwo\n", {"do this"}, "<svg/>", {}},
      {"volalign x", "verdict: {weak_rms_m: 0.03}\n"});
  EXPECT_EQ(payload["notes"], nlohmann::ordered_json({"one", "two"}));
  EXPECT_EQ(payload["command"], "volalign x");
  EXPECT_EQ(payload["advice"][0], "do this");
  EXPECT_EQ(payload["limits"]["rms_m"], 0.03) << "as the calibration had it";
  EXPECT_EQ(payload["limits"]["inlier_share"], VerdictOptions().weak_inlier_share);
  ASSERT_EQ(payload["labels"].size(), 20u);
  EXPECT_EQ(payload["labels"][4]["id"], 5);
  EXPECT_EQ(payload["labels"][4]["name"], structure.SideOfLabel(5).name);
  const auto& boxes = payload["stills"][0]["boxes"];
  ASSERT_EQ(boxes.size(), 4u);
  // Centre plus both half axes is a corner: as far from the centre as half the diagonal.
  for (const auto& side : boxes[2]["sides"]) {
    double u2 = 0, v2 = 0, uv = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      u2 += side["u"][i].get<double>() * side["u"][i].get<double>();
      v2 += side["v"][i].get<double>() * side["v"][i].get<double>();
      uv += side["u"][i].get<double>() * side["v"][i].get<double>();
    }
    EXPECT_NEAR(uv, 0, 1e-12);
    EXPECT_GT(u2 * v2, 0);
  }
  EXPECT_EQ(payload["extrinsics"]["format"], "volalign.extrinsics/1");
}

}  // namespace
}  // namespace volalign::page_test
