#include "core/base/stop.h"

namespace volalign {

namespace {

thread_local const std::atomic<bool>* t_asked = nullptr;

}  // namespace

StopScope::StopScope(const std::atomic<bool>* asked) : outer_(t_asked) { t_asked = asked; }

StopScope::~StopScope() { t_asked = outer_; }

const std::atomic<bool>* StopScope::Current() { return t_asked; }

bool IsStopAsked() { return t_asked && *t_asked; }

void ThrowIfStopped() {
  if (IsStopAsked()) throw Stopped();
}

}  // namespace volalign
