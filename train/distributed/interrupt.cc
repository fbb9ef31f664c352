#include "train/distributed/interrupt.h"

#include <atomic>

namespace volalign {
namespace {

std::atomic<int> g_signal{0};
static_assert(std::atomic<int>::is_always_lock_free);

}  // namespace

InterruptGuard::InterruptGuard() {
  g_signal = 0;
  struct sigaction action {};
  action.sa_handler = [](int number) { g_signal = number; };
  sigaction(SIGINT, &action, &old_int_);
  sigaction(SIGTERM, &action, &old_term_);
  action.sa_handler = SIG_DFL;
  sigaction(SIGCHLD, &action, &old_child_);
}

InterruptGuard::~InterruptGuard() {
  sigaction(SIGINT, &old_int_, nullptr);
  sigaction(SIGTERM, &old_term_, nullptr);
  sigaction(SIGCHLD, &old_child_, nullptr);
}

bool InterruptGuard::Interrupted() const { return g_signal != 0; }

int InterruptGuard::Take() { return g_signal.exchange(0); }

}  // namespace volalign
