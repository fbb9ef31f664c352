#pragma once

#include <string>

namespace volalign {

struct EglContextOptions {
  /// Index into EGL's list of hardware devices (EGL_EXT_device_enumeration); -1 takes the first one
  /// on which a context can be made, and software rendering (Mesa, surfaceless) where there is
  /// none.
  int device = -1;
};

/// Keeps Mesa's software rendering on the thread that draws, which is best where worker threads
/// have a context each: sets LP_NUM_THREADS=0 unless the environment has a value. Mesa has no other
/// switch, and setting the environment races with every thread that reads it, so no other function
/// of this library does: a program calls this at the start of main, before it starts a thread, or
/// is started with the variable. What is drawn does not depend on it.
void KeepSoftwareRenderingOnOneThread();

/// An off-screen OpenGL 4.5 core context, current on the thread that made it until it is destroyed
/// there. Contexts of one process share one EGL display a device, which is never terminated; each
/// worker thread has a context of its own. Mesa's software rendering starts threads of its own for
/// each context unless LP_NUM_THREADS=0: see KeepSoftwareRenderingOnOneThread.
class EglContext {
 public:
  /// Throws IoError: no EGL display or context (names the Debian packages), or a device that does
  /// not exist.
  explicit EglContext(const EglContextOptions& options = {});
  ~EglContext();
  EglContext(const EglContext&) = delete;
  EglContext& operator=(const EglContext&) = delete;

  /// GL_RENDERER, GL_VERSION and the platform, for people.
  std::string Describe() const;

  /// Whether Mesa draws on the processor.
  bool IsSoftware() const;

 private:
  void* display_ = nullptr;  ///< EGLDisplay
  void* context_ = nullptr;  ///< EGLContext
  std::string platform_;
};

}  // namespace volalign
