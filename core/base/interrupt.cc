#include "core/base/interrupt.h"

#include <fmt/format.h>
#include <semaphore.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <exception>
#include <set>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "core/base/parallel_for.h"
#include "core/base/text.h"

namespace volalign {
namespace {

namespace fs = std::filesystem;

std::atomic<int> g_signal{0};  // since the outermost guard began
std::atomic<int> g_guards{0};
std::atomic<int> g_last{0};  // outside of any guard
static_assert(std::atomic<int>::is_always_lock_free);
sem_t g_came;

/// Paths that are being written. Never destroyed: threads may outlive main.
struct Begun {
  std::mutex mutex;
  std::set<fs::path> paths;
  std::string explanation;  ///< for exceptions that nothing can catch
};

Begun& UnfinishedPaths() {
  static Begun* const begun = new Begun;
  return *begun;
}

void Remove(const fs::path& path) {
  std::error_code ignored;
  fs::remove_all(path, ignored);
}

/// Writes the sentence and ends the program without unfinished files. The caller keeps the lock of
/// UnfinishedPaths, so nothing else begins.
[[noreturn]] void EndWith(const std::string& sentence, int status) {
  for (const fs::path& path : UnfinishedPaths().paths) Remove(path);
  const std::string line =
      fmt::format("{}{}\n", ::isatty(STDERR_FILENO) == 1 ? "\r\x1b[K" : "", sentence);
  const ssize_t written = ::write(STDERR_FILENO, line.data(), line.size());
  (void)written;  // there is nobody else to tell
  ::_exit(status);
}

[[noreturn]] void End(int number) {
  UnfinishedPaths().mutex.lock();
  EndWith(fmt::format("stopped by {}", number == SIGINT ? "Ctrl-C (SIGINT)" : "SIGTERM"),
          StatusOfSignal(number));
}

/// For an exception in a destructor, or in a thread of a library, where nothing can catch it.
[[noreturn]] void EndOnUncaught() {
  std::string what = "an exception of an unknown kind";
  try {
    if (const std::exception_ptr thrown = std::current_exception()) std::rethrow_exception(thrown);
  } catch (const std::exception& error) {
    what = SentenceOf(error);
  } catch (...) {
  }
  if (!UnfinishedPaths().mutex.try_lock()) std::abort();  // the thrower has it
  EndWith(fmt::format("error: a library failed where nothing can go on: {}{}", what,
                      UnfinishedPaths().explanation),
          1);
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
  std::set_terminate(EndOnUncaught);
  ::sem_init(&g_came, 0, 0);
  // A signal handler may do nearly nothing; the thread may remove files.
  std::vector<std::thread> threads;
  const auto wait = [] {
    while (::sem_wait(&g_came) != 0) {
    }
    End(g_last);
  };
  if (StartThreads(1, wait, &threads) == 0) return;  // signals end the program without a word
  threads.front().detach();
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

void ExplainUncaught(const std::string& sentence) {
  const std::unique_lock<std::mutex> lock = HoldInterrupts();
  UnfinishedPaths().explanation = "; " + sentence;
}

std::unique_lock<std::mutex> HoldInterrupts() {
  return std::unique_lock<std::mutex>(UnfinishedPaths().mutex);
}

TemporaryPath::TemporaryPath(const std::function<fs::path()>& create) {
  const std::unique_lock<std::mutex> lock = HoldInterrupts();
  path_ = create();
  UnfinishedPaths().paths.insert(path_);
}

TemporaryPath::~TemporaryPath() {
  if (!complete_) Remove(path_);
  const std::unique_lock<std::mutex> lock = HoldInterrupts();
  UnfinishedPaths().paths.erase(path_);
}

void TemporaryPath::Complete() { complete_ = true; }

}  // namespace volalign
