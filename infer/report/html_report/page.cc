#include "infer/report/html_report/page.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/text.h"
#include "infer/report/html_report/assets.h"

namespace volalign {

namespace {

/// JSON for a script element: without "</script>" and "<!--".
std::string ForScript(const nlohmann::ordered_json& payload) {
  const std::string text =
      payload.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
  return fmt::format("{}", fmt::join(Split(text, '<'), "\\u003c"));
}

}  // namespace

std::string ReportPage(const nlohmann::ordered_json& payload) {
  namespace assets = report_assets;
  const std::vector<std::pair<std::string, std::string>> parts = {
      {"{{style}}", assets::kStyle},
      {"{{three}}", std::string(assets::kThree) + "\n" + assets::kOrbitControls},
      {"{{payload}}", ForScript(payload)},
      {"{{scripts}}", std::string(assets::kFormatScript) + assets::kTablesScript +
                          assets::kFramesScript + assets::kSceneScript + assets::kViewerScript +
                          assets::kMainScript}};
  // From left to right, so that inserted text is not searched.
  const std::string page = assets::kPage;
  std::string filled;
  std::size_t at = 0;
  for (const auto& [mark, text] : parts) {
    const std::size_t found = page.find(mark, at);
    if (found == std::string::npos) throw Error("report.html has no " + mark);
    filled.append(page, at, found - at);
    filled += text;
    at = found + mark.size();
  }
  return filled.append(page, at, std::string::npos);
}

}  // namespace volalign
