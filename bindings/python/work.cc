#include "bindings/python/work.h"

#include <atomic>
#include <chrono>
#include <csignal>
#include <exception>
#include <future>
#include <mutex>
#include <utility>
#include <vector>

#include "core/base/stop.h"

namespace volalign::python {

namespace {

/// How often Python is asked whether a signal has come.
constexpr std::chrono::milliseconds kInterval(50);

/// Threads that start while it lives get no signals: those go to Python's own.
class SignalsBlocked {
 public:
  SignalsBlocked() {
    sigset_t all;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before_);
  }
  ~SignalsBlocked() { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }
  SignalsBlocked(const SignalsBlocked&) = delete;
  SignalsBlocked& operator=(const SignalsBlocked&) = delete;

 private:
  sigset_t before_;
};

}  // namespace

void RunWork(const py::object& progress, const std::function<void(const Tell&)>& work) {
  std::mutex mutex;
  std::vector<std::string> told;
  std::atomic<bool> stop{false};
  const auto begin = [&] {
    const SignalsBlocked blocked;
    return std::async(std::launch::async, [&] {
      const StopScope scope(&stop);
      work([&](const std::string& stage) {
        ThrowIfStopped();
        const std::lock_guard<std::mutex> lock(mutex);
        told.push_back(stage);
      });
    });
  };
  std::future<void> end = begin();
  std::exception_ptr raised;
  for (bool ended = false; !ended;) {
    {
      const py::gil_scoped_release released;
      ended = end.wait_for(kInterval) == std::future_status::ready;
    }
    if (stop) continue;
    std::unique_lock<std::mutex> lock(mutex);
    const std::vector<std::string> stages = std::exchange(told, {});
    lock.unlock();
    try {
      if (PyErr_CheckSignals() != 0) throw py::error_already_set();
      for (const std::string& stage : stages)
        if (!progress.is_none()) progress(stage);
    } catch (...) {
      raised = std::current_exception();
      stop = true;
    }
  }
  if (raised) std::rethrow_exception(raised);
  end.get();
}

}  // namespace volalign::python
