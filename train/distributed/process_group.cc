#include "train/distributed/process_group.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/empty.h>
#include <ATen/ops/zeros.h>
#include <arpa/inet.h>
#include <fmt/format.h>
#include <netdb.h>
#include <sys/socket.h>
#include <torch/version.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <utility>

#include "core/base/interrupt.h"
#include "core/base/text.h"
#ifdef VOLALIGN_HAS_GLOO
#include <torch/csrc/distributed/c10d/FileStore.hpp>
#include <torch/csrc/distributed/c10d/PrefixStore.hpp>
#include <torch/csrc/distributed/c10d/ProcessGroupGloo.hpp>
#include <torch/csrc/distributed/c10d/TCPStore.hpp>
#endif
#ifdef VOLALIGN_HAS_NCCL
#include <torch/csrc/distributed/c10d/ProcessGroupNCCL.hpp>
#endif

namespace volalign {

std::string AddressTowards(const World& world) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  const int failed =
      ::getaddrinfo(world.address.c_str(), std::to_string(world.port).c_str(), &hints, &found);
  if (failed != 0) {
    throw IoError(fmt::format("MASTER_ADDR = '{}' has no address: {}", world.address,
                              ::gai_strerror(failed)));
  }
  const std::unique_ptr<addrinfo, void (*)(addrinfo*)> addresses(found, ::freeaddrinfo);
  std::string why;
  for (const addrinfo* a = found; a != nullptr; a = a->ai_next) {
    const int socket = ::socket(a->ai_family, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_storage own{};
    socklen_t size = sizeof(own);
    std::array<char, NI_MAXHOST> text{};
    // Nothing is sent: connecting a datagram socket only chooses the way.
    const bool leads = socket >= 0 && ::connect(socket, a->ai_addr, a->ai_addrlen) == 0 &&
                       ::getsockname(socket, reinterpret_cast<sockaddr*>(&own), &size) == 0 &&
                       ::getnameinfo(reinterpret_cast<sockaddr*>(&own), size, text.data(),
                                     text.size(), nullptr, 0, NI_NUMERICHOST) == 0;
    if (!leads) why = std::strerror(errno);
    if (socket >= 0) ::close(socket);
    if (leads) return text.data();
  }
  throw IoError(fmt::format("no way leads to MASTER_ADDR = '{}': {}", world.address, why));
}

#ifdef VOLALIGN_HAS_GLOO

namespace {

using std::chrono::milliseconds;
using Store = c10::intrusive_ptr<c10d::Store>;
// The base class of ProcessGroupGloo and ProcessGroupNCCL has changed its name.
#if TORCH_VERSION_MAJOR >= 2
using Backend = c10d::Backend;
#else
using Backend = c10d::ProcessGroup;
#endif

Store OpenStore(const World& world, milliseconds timeout) {
  if (!world.store.empty()) {
    Store store = c10::make_intrusive<c10d::FileStore>(world.store, world.size);
    store->setTimeout(timeout);
    return store;
  }
  c10d::TCPStoreOptions options;
  options.port = static_cast<std::uint16_t>(world.port);
  options.isServer = world.rank == 0;
  options.numWorkers = static_cast<std::size_t>(world.size);
  options.waitWorkers = false;  // Gloo's own meeting waits, with its own message
  options.timeout = timeout;
#if TORCH_VERSION_MAJOR * 100 + TORCH_VERSION_MINOR >= 204
  options.useLibUV = false;  // Debian's LibTorch is built without it
#endif
  // Threads of the store read everything that arrives there, and trust it.
  ExplainUncaught(
      fmt::format("rank {} talks to {}:{}: is rank 0 of this run there, and no other program?",
                  world.rank, world.address, world.port));
  try {
    return c10::make_intrusive<c10d::TCPStore>(world.address, options);
  } catch (const std::exception& e) {
    throw IoError(fmt::format("rank {} {} {}:{}: {} ({})", world.rank,
                              world.rank == 0 ? "cannot listen on" : "does not reach rank 0 at",
                              world.address, world.port,
                              world.rank == 0
                                  ? "is another program there? VOLALIGN_PORT names another port"
                                  : "has it started, and is the port open?",
                              Shortened(FirstLine(e.what()))));
  }
}

std::shared_ptr<::gloo::transport::Device> OpenDevice(const World& world) {
  if (!world.store.empty()) return c10d::ProcessGroupGloo::createDeviceForHostname("127.0.0.1");
  if (const char* interface = std::getenv("GLOO_SOCKET_IFNAME")) {
    return c10d::ProcessGroupGloo::createDeviceForInterface(interface);
  }
  return c10d::ProcessGroupGloo::createDeviceForHostname(AddressTowards(world));
}

c10::intrusive_ptr<Backend> OpenGloo(const World& world, const Store& store, milliseconds timeout) {
  auto options = c10d::ProcessGroupGloo::Options::create(timeout);
  try {
    options->devices.push_back(OpenDevice(world));
    return c10::make_intrusive<c10d::ProcessGroupGloo>(
        c10::make_intrusive<c10d::PrefixStore>("gloo", store), world.rank, world.size, options);
  } catch (const std::exception& e) {
    throw IoError(fmt::format(
        "rank {} of {} has not met all others within {} s: have they started, with this build and "
        "the same WORLD_SIZE, and do they reach each other? ({})",
        world.rank, world.size, timeout.count() / 1000, Shortened(FirstLine(e.what()))));
  }
}

}  // namespace

struct ProcessGroup::Connection {
  Store store;
  c10::intrusive_ptr<Backend> host;    ///< for tensors in memory
  c10::intrusive_ptr<Backend> device;  ///< for tensors on the run's device

  Backend& Of(const at::Tensor& tensor) { return tensor.is_cuda() ? *device : *host; }

  template <class Function>
  static auto Call(const Function& function) {
    try {
      return function();
    } catch (const std::exception& e) {
      throw LostProcess(fmt::format("lost another process ({})", Shortened(FirstLine(e.what()))));
    }
  }
};

bool ProcessGroup::IsBuilt() { return true; }

void ProcessGroup::Connect(const World& world, const at::Device& device, double timeout_s) {
  // When Gloo writes to a process that has ended, it gets an error with a message, and this process
  // goes on.
  std::signal(SIGPIPE, SIG_IGN);
  rank_ = world.rank;
  size_ = world.size;
  connection_ = std::make_unique<Connection>();
  constexpr double kLongest = 1e9;  // s, which 64 bits hold in ms
  const milliseconds timeout(static_cast<std::int64_t>(1000 * std::min(timeout_s, kLongest)));
  Connection& c = *connection_;
  c.store = OpenStore(world, timeout);
  c.host = OpenGloo(world, c.store, timeout);
  c.device = c.host;
#ifdef VOLALIGN_HAS_NCCL
  if (device.is_cuda()) {
    auto options = c10d::ProcessGroupNCCL::Options::create();
    options->timeout = timeout;
    c.device = c10::make_intrusive<c10d::ProcessGroupNCCL>(
        c10::make_intrusive<c10d::PrefixStore>("nccl", c.store), rank_, size_, options);
  }
#else
  (void)device;
#endif
}

void ProcessGroup::Sum(const at::Tensor& tensor) {
  if (size_ == 1) return;
  connection_->Call([&] {
    std::vector<at::Tensor> tensors = {tensor};
    connection_->Of(tensor).allreduce(tensors)->wait();
  });
}

void ProcessGroup::Broadcast(const at::Tensor& tensor) {
  if (size_ == 1) return;
  connection_->Call([&] {
    std::vector<at::Tensor> tensors = {tensor};
    connection_->Of(tensor).broadcast(tensors)->wait();
  });
}

std::vector<std::string> ProcessGroup::Gather(const std::string& own) {
  if (size_ == 1) return {own};
  const auto gather = [&](at::Tensor tensor) {
    std::vector<std::vector<at::Tensor>> all(1);
    for (int r = 0; r < size_; ++r) all[0].push_back(at::zeros_like(tensor));
    std::vector<at::Tensor> input = {std::move(tensor)};
    connection_->Call([&] { connection_->host->allgather(all, input)->wait(); });
    return all[0];
  };
  at::Tensor length = at::zeros({1}, at::kLong);
  length.data_ptr<std::int64_t>()[0] = static_cast<std::int64_t>(own.size());
  const std::vector<at::Tensor> lengths = gather(length);
  std::int64_t longest = 1;
  for (const at::Tensor& l : lengths) longest = std::max(longest, l.item<std::int64_t>());
  at::Tensor bytes = at::zeros({longest}, at::kByte);
  std::memcpy(bytes.data_ptr(), own.data(), own.size());
  const std::vector<at::Tensor> texts = gather(bytes);
  std::vector<std::string> result;
  for (std::size_t r = 0; r < texts.size(); ++r) {
    result.emplace_back(static_cast<const char*>(texts[r].data_ptr()),
                        static_cast<std::size_t>(lengths[r].item<std::int64_t>()));
  }
  return result;
}

#else  // without c10d

struct ProcessGroup::Connection {};

bool ProcessGroup::IsBuilt() { return false; }

void ProcessGroup::Connect(const World&, const at::Device&, double) {
  throw ConfigError(
      "this build trains in one process only: its LibTorch has no Gloo, or Gloo's headers (Debian "
      "package libgloo-dev) were missing when it was built");
}

void ProcessGroup::Sum(const at::Tensor&) {}
void ProcessGroup::Broadcast(const at::Tensor&) {}
std::vector<std::string> ProcessGroup::Gather(const std::string& own) { return {own}; }

#endif

ProcessGroup::ProcessGroup() = default;
ProcessGroup::~ProcessGroup() = default;

std::string ProcessGroup::BroadcastFromRankZero(const std::function<std::string()>& make) {
  if (size_ == 1) return make();
  if (!leads()) {
    const std::string said = Gather("").at(0);
    if (said.at(0) == '!') throw Error("rank 0: " + said.substr(1));
    return said.substr(1);
  }
  std::string made;
  try {
    made = make();
  } catch (const std::exception& e) {
    Gather(std::string("!") + e.what());
    throw;
  }
  Gather("=" + made);
  return made;
}

}  // namespace volalign
