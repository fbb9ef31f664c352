#include "train/distributed/rendezvous.h"

#include <gtest/gtest.h>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"

namespace volalign::rendezvous_test {
namespace {

World At(const std::string& address) {
  World world;
  world.address = address;
  world.port = 29500;
  return world;
}

TEST(AddressTowards, IsTheOneThatTheOtherMachineReaches) {
  EXPECT_EQ(AddressTowards(At("127.0.0.1")), "127.0.0.1");
  // The whole network of a loopback device answers, and is reached from its first address.
  EXPECT_EQ(AddressTowards(At("127.0.0.2")), "127.0.0.1");
  // Broadcasts are not allowed, so that no way leads there.
  ExpectError<IoError>([] { AddressTowards(At("255.255.255.255")); },
                       {"no way", "255.255.255.255"});
}

}  // namespace
}  // namespace volalign::rendezvous_test
