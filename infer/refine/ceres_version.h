#pragma once

#include <string>

namespace volalign {

/// Of the Ceres that this library was built with, and what it was built with: "2.1.0-eigen-...".
std::string CeresVersion();

}  // namespace volalign
