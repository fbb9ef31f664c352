#include "train/distributed/process_group.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/full.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <filesystem>
#include <iterator>
#include <set>
#include <sstream>
#include <string>
#include <system_error>
#include <vector>

#include "tests/core/base/temp_folder.h"
#include "tests/train/distributed/in_processes.h"

namespace volalign::process_group_test {
namespace {

void Require(bool holds, const char* what) {
  if (!holds) throw Error(what);
}

TEST(ProcessGroup, AloneDoesNothing) {
  ProcessGroup group;
  EXPECT_TRUE(group.leads());
  EXPECT_EQ(group.size(), 1);
  const at::Tensor tensor = at::full({2}, 3.0);
  group.Sum(tensor);
  group.Broadcast(tensor);
  EXPECT_TRUE(tensor.equal(at::full({2}, 3.0)));
  EXPECT_EQ(group.Gather("own"), std::vector<std::string>{"own"});
  EXPECT_EQ(group.BroadcastFromRankZero([] { return std::string("made"); }), "made");
}

TEST(ConnectedProcesses, SumsBroadcastsAndGathers) {
  const TempFolder folder;
  const auto work = [](const World& world) {
    ProcessGroup group;
    group.Connect(world, at::kCPU, 60);
    Require(group.rank() == world.rank && group.size() == 3, "rank and size");
    Require(group.leads() == (world.rank == 0), "lead");
    const at::Tensor sum = at::full({2}, world.rank + 1.0);
    group.Sum(sum);
    Require(sum.equal(at::full({2}, 6.0)), "sum");
    const at::Tensor same = at::full({2}, world.rank + 7.0);
    group.Broadcast(same);
    Require(same.equal(at::full({2}, 7.0)), "broadcast");
    const std::string own(static_cast<std::size_t>(world.rank), 'x');  // of different lengths
    Require(group.Gather(own) == std::vector<std::string>{"", "x", "xx"}, "gather");
    const std::string made =
        group.BroadcastFromRankZero([&] { return std::to_string(world.rank); });
    Require(made == "0", "from lead");
    group.BroadcastFromRankZero([]() -> std::string { throw Error("the lead failed"); });
  };
  EXPECT_EQ(InProcesses(3, folder.path(), work), std::vector<int>(3, 1));
  EXPECT_EQ(ReadFile(folder / "message0"), "the lead failed");
  for (const char* other : {"message1", "message2"})
    EXPECT_EQ(ReadFile(folder / other), "rank 0: the lead failed");
}

/// A socket that listens at a port that was free.
class Listener {
 public:
  explicit Listener(in_addr_t address) : fd_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in wanted{};
    wanted.sin_family = AF_INET;
    wanted.sin_addr.s_addr = htonl(address);
    Require(::bind(fd_, reinterpret_cast<const sockaddr*>(&wanted), sizeof(wanted)) == 0, "bind");
    Require(::listen(fd_, 1) == 0, "listen");
  }
  ~Listener() { ::close(fd_); }
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;
  int Port() const {
    sockaddr_in address{};
    socklen_t size = sizeof(address);
    ::getsockname(fd_, reinterpret_cast<sockaddr*>(&address), &size);
    return ntohs(address.sin_port);
  }

 private:
  int fd_;
};

/// Local addresses of this process's listening sockets, as /proc/net/tcp and tcp6 have them.
std::set<std::string> ListeningAddresses() {
  std::set<std::string> sockets;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    std::error_code gone;
    sockets.insert(std::filesystem::read_symlink(entry, gone).string());
  }
  std::set<std::string> addresses;
  for (const char* table : {"/proc/self/net/tcp", "/proc/self/net/tcp6"}) {
    std::istringstream lines(ReadFile(table));
    std::string line;
    std::getline(lines, line);
    while (std::getline(lines, line)) {
      std::istringstream words(line);
      const std::vector<std::string> row{std::istream_iterator<std::string>(words), {}};
      constexpr char kListens[] = "0A";
      if (row.at(3) == kListens && sockets.count("socket:[" + row.at(9) + "]") > 0)
        addresses.insert(row.at(1).substr(0, row.at(1).find(':')));
    }
  }
  return addresses;
}

/// What the processes of InProcesses said last.
std::string Messages(const TempFolder& folder) {
  std::string all;
  for (const char* message : {"message0", "message1"}) {
    if (std::filesystem::exists(folder / message)) all += ReadFile(folder / message) + "\n";
  }
  return all;
}

TEST(ConnectedProcesses, OnOneMachineNoOtherMachineReachesIt) {
  const TempFolder folder;
  {
    const Listener open(INADDR_ANY);
    ASSERT_EQ(ListeningAddresses(), std::set<std::string>{"00000000"});
  }
  const auto work = [](const World& world) {
    ProcessGroup group;
    group.Connect(world, at::kCPU, 60);
    const std::string loopback = "0100007F";
    const std::set<std::string> addresses = ListeningAddresses();
    for (const std::string& address : addresses) Require(address == loopback, address.c_str());
  };
  EXPECT_EQ(InProcesses(2, folder.path(), work), std::vector<int>(2, 0)) << Messages(folder);
}

TEST(ConnectedProcesses, MeetsAtAPortToo) {
  const TempFolder folder;
  // Another program may take the port in between.
  std::vector<int> statuses;
  for (int tries = 0; tries < 3 && statuses != std::vector<int>(2, 0); ++tries) {
    const int port = Listener(INADDR_LOOPBACK).Port();
    statuses = InProcesses(2, folder.path(), [port](World world) {
      world.store.clear();
      world.address = "127.0.0.1";
      world.port = port;
      ProcessGroup group;
      group.Connect(world, at::kCPU, 10);
      Require(group.Gather(std::to_string(world.rank)) == std::vector<std::string>{"0", "1"},
              "gather");
    });
  }
  EXPECT_EQ(statuses, std::vector<int>(2, 0)) << Messages(folder);
}

}  // namespace
}  // namespace volalign::process_group_test
