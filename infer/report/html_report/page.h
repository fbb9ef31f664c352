#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace volalign {

/// The report as one HTML file that needs no other. It has the page's files beside this header and
/// three.js, embedded when the program was built, around the payload (ReportPayload).
std::string ReportPage(const nlohmann::ordered_json& payload);

}  // namespace volalign
