#include "infer/refine/ceres_version.h"

#include <ceres/version.h>

namespace volalign {

std::string CeresVersion() { return CERES_VERSION_STRING; }

}  // namespace volalign
