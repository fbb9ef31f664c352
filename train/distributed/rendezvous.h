#pragma once

#include <string>

#include "train/distributed/world.h"

namespace volalign {

/// This machine's address, as a number, on the way to rank 0: the one that other machines reach it
/// at. Throws IoError where rank 0's name has no address or no way leads there.
std::string AddressTowards(const World& world);

}  // namespace volalign
