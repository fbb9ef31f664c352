#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace volalign {

/// The report as one HTML file that needs nothing else: the page's own files beside this header and
/// three.js, as they were when the program was built, around the payload (ReportPayload).
std::string ReportPage(const nlohmann::ordered_json& payload);

}  // namespace volalign
