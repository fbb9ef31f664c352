#include "core/base/interrupt.h"

#include <fmt/format.h>
#include <semaphore.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <set>
#include <string>
#include <system_error>
#include <thread>

namespace volalign {
namespace {

namespace fs = std::filesystem;

std::atomic<int> g_signal{0};  // since the outermost guard began
std::atomic<int> g_guards{0};
std::atomic<int> g_last{0};  // wherever it came
static_assert(std::atomic<int>::is_always_lock_free);
sem_t g_came;

/// Paths that are being written. Never destroyed: threads may outlive main.
struct Begun {
  std::mutex mutex;
  std::set<fs::path> paths;
};

Begun& TheBegun() {
  static Begun* const begun = new Begun;
  return *begun;
}

void Remove(const fs::path& path) {
  std::error_code ignored;
  fs::remove_all(path, ignored);
}

[[noreturn]] void End(int number) {
  Begun& begun = TheBegun();
  begun.mutex.lock();  // for good: nothing else begins
  for (const fs::path& path : begun.paths) Remove(path);
  const std::string sentence =
      fmt::format("{}stopped by {}\n", ::isatty(STDERR_FILENO) == 1 ? "\r\x1b[K" : "",
                  number == SIGINT ? "Ctrl-C (SIGINT)" : "SIGTERM");
  const ssize_t written = ::write(STDERR_FILENO, sentence.data(), sentence.size());
  (void)written;  // there is nobody else to tell
  ::_exit(StatusOfSignal(number));
}

}  // namespace

InterruptGuard::InterruptGuard() {
  if (g_guards++ > 0) return;
  g_signal = 0;
  struct sigaction action {};
  action.sa_handler = [](int number) { g_signal = number; };
  sigaction(SIGINT, &action, &old_int_);
  sigaction(SIGTERM, &action, &old_term_);
  action.sa_handler = SIG_DFL;
  sigaction(SIGCHLD, &action, &old_child_);
}

InterruptGuard::~InterruptGuard() {
  if (--g_guards > 0) return;
  sigaction(SIGINT, &old_int_, nullptr);
  sigaction(SIGTERM, &old_term_, nullptr);
  sigaction(SIGCHLD, &old_child_, nullptr);
}

int InterruptGuard::Signal() const { return g_signal; }

int InterruptGuard::Take() { return g_signal.exchange(0); }

void EndOnInterrupt() {
  ::sem_init(&g_came, 0, 0);
  // A handler may do next to nothing; the thread may remove files.
  std::thread([] {
    while (::sem_wait(&g_came) != 0) {
    }
    End(g_last);
  }).detach();
  struct sigaction action {};
  action.sa_flags = SA_RESTART;
  action.sa_handler = [](int number) {
    const int before = errno;
    g_last = number;
    ::sem_post(&g_came);
    errno = before;
  };
  for (const int number : {SIGINT, SIGTERM}) {
    struct sigaction old {};
    sigaction(number, nullptr, &old);
    if (old.sa_handler != SIG_IGN) sigaction(number, &action, nullptr);
  }
}

std::unique_lock<std::mutex> HoldInterrupts() {
  return std::unique_lock<std::mutex>(TheBegun().mutex);
}

Unfinished::Unfinished(const std::function<fs::path()>& create) {
  const std::unique_lock<std::mutex> lock = HoldInterrupts();
  path_ = create();
  TheBegun().paths.insert(path_);
}

Unfinished::~Unfinished() {
  if (!complete_) Remove(path_);
  const std::unique_lock<std::mutex> lock = HoldInterrupts();
  TheBegun().paths.erase(path_);
}

void Unfinished::Complete() { complete_ = true; }

}  // namespace volalign
