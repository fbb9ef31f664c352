#pragma once

#include <string>

namespace volalign {

struct EglContextOptions {
  /// Index into EGL's list of hardware devices (EGL_EXT_device_enumeration). -1 takes the first one
  /// that gives a context, or else software rendering (Mesa, surfaceless).
  int device = -1;
};

/// Keeps Mesa's software rendering on the drawing thread, which is best if each worker thread has a
/// context. Sets LP_NUM_THREADS=0 unless the environment has a value, as Mesa has no other switch.
/// Setting the environment races with every thread that reads it. So a program calls this at the
/// start of main, before it starts a thread, and no other function of this library does so.
/// Pictures do not depend on it.
void KeepSoftwareRenderingOnOneThread();

/// An off-screen OpenGL 4.5 core context, current on the thread that made it until it is destroyed
/// there. Each worker thread has its own. Contexts of one process share one EGL display per device,
/// which is never terminated. Mesa's software rendering starts threads for each context unless
/// LP_NUM_THREADS=0: see KeepSoftwareRenderingOnOneThread.
class EglContext {
 public:
  /// Throws IoError without an EGL display or context (with the Debian packages), or for a device
  /// that does not exist.
  explicit EglContext(const EglContextOptions& options = {});
  ~EglContext();
  EglContext(const EglContext&) = delete;
  EglContext& operator=(const EglContext&) = delete;

  /// GL_RENDERER, GL_VERSION and the platform, for people.
  std::string Describe() const;

  /// Does Mesa draw on the processor?
  bool IsSoftware() const;

 private:
  void* display_ = nullptr;  ///< EGLDisplay
  void* context_ = nullptr;  ///< EGLContext
  std::string platform_;
};

}  // namespace volalign
