#include "train/distributed/rendezvous.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

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

TEST(FreePort, CanBeListenedOn) {
  const int port = FreePort();
  EXPECT_GT(port, 0);
  const int listener = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  EXPECT_EQ(::bind(listener, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
  EXPECT_EQ(::listen(listener, 1), 0);
  EXPECT_NE(FreePort(), port);  // which is taken now
  ::close(listener);
}

}  // namespace
}  // namespace volalign::rendezvous_test
