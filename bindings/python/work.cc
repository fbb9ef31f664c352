#include "bindings/python/work.h"

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <csignal>
#include <exception>
#include <mutex>
#include <thread>
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

/// What the two threads share.
struct Shared {
  std::mutex mutex;
  std::condition_variable changed;
  std::vector<std::string> stages;
  bool done = false;
  std::exception_ptr failure;
  std::atomic<bool> stop{false};
};

std::thread Start(const std::function<void(const Tell&)>& work, Shared* shared) {
  const SignalsBlocked blocked;
  return std::thread([&work, shared] {
    const StopScope scope(&shared->stop);
    std::exception_ptr failure;
    try {
      work([shared](const std::string& stage) {
        ThrowIfStopped();
        const std::lock_guard<std::mutex> lock(shared->mutex);
        shared->stages.push_back(stage);
        shared->changed.notify_one();
      });
    } catch (...) {
      failure = std::current_exception();
    }
    const std::lock_guard<std::mutex> lock(shared->mutex);
    shared->failure = failure;
    shared->done = true;
    shared->changed.notify_one();
  });
}

}  // namespace

void RunWork(const py::object& progress, const std::function<void(const Tell&)>& work) {
  Shared shared;
  std::thread thread = Start(work, &shared);
  std::exception_ptr raised;
  {
    const py::gil_scoped_release released;
    std::unique_lock<std::mutex> lock(shared.mutex);
    while (!shared.done || !shared.stages.empty()) {
      shared.changed.wait_for(lock, kInterval,
                              [&] { return shared.done || !shared.stages.empty(); });
      const std::vector<std::string> stages = std::exchange(shared.stages, {});
      if (shared.stop) continue;
      lock.unlock();
      try {
        const py::gil_scoped_acquire acquired;
        if (PyErr_CheckSignals() != 0) throw py::error_already_set();
        if (!progress.is_none()) {
          for (const std::string& stage : stages) progress(stage);
        }
      } catch (...) {
        raised = std::current_exception();
        shared.stop = true;
      }
      lock.lock();
    }
  }
  thread.join();
  if (raised) std::rethrow_exception(raised);
  if (shared.failure) std::rethrow_exception(shared.failure);
}

}  // namespace volalign::python
