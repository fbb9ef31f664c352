#pragma once

#include <string>

#include "train/distributed/world.h"

namespace volalign {

/// This machine's numeric address on the way to rank 0, at which other machines reach it. Throws
/// IoError if rank 0's name has no address or no route leads there.
std::string AddressTowards(const World& world);

}  // namespace volalign
