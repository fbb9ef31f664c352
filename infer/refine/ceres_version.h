#pragma once

#include <string>

namespace volalign {

/// The version of the Ceres that this library was built with, and its build options:
/// "2.1.0-eigen-...".
std::string CeresVersion();

}  // namespace volalign
