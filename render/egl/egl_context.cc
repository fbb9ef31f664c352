#include "render/egl/egl_context.h"

#include <dlfcn.h>
#include <epoxy/egl.h>
#include <epoxy/gl.h>
#include <fmt/format.h>
#include <link.h>

#include <cstdlib>
#include <filesystem>
#include <map>
#include <mutex>
#include <tuple>
#include <vector>

#include "core/base/error.h"

namespace volalign {
namespace {

/// One of the 200 functions of LLVM that Debian 13's libtorch_cpu exports.
constexpr char kForeignLlvm[] = "LLVMAddSymbol";

struct Display {
  EGLDisplay handle = EGL_NO_DISPLAY;
  std::string platform;
};

bool HasExtension(const char* list, const std::string& name) {
  if (list == nullptr) return false;
  const std::string padded = " " + std::string(list) + " ";
  return padded.find(" " + name + " ") != std::string::npos;
}

std::vector<EGLDeviceEXT> HardwareDevices() {
  const char* client = eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
  if (!HasExtension(client, "EGL_EXT_platform_device") ||
      !(HasExtension(client, "EGL_EXT_device_enumeration") ||
        HasExtension(client, "EGL_EXT_device_base"))) {
    return {};
  }
  EGLint count = 0;
  if (!eglQueryDevicesEXT(0, nullptr, &count) || count <= 0) return {};
  std::vector<EGLDeviceEXT> all(static_cast<std::size_t>(count));
  if (!eglQueryDevicesEXT(count, all.data(), &count)) return {};
  all.resize(static_cast<std::size_t>(count));
  std::vector<EGLDeviceEXT> hardware;
  for (EGLDeviceEXT device : all) {
    const char* extensions = eglQueryDeviceStringEXT(device, EGL_EXTENSIONS);
    if (!HasExtension(extensions, "EGL_MESA_device_software")) hardware.push_back(device);
  }
  return hardware;
}

EGLDisplay Initialised(EGLDisplay display) {
  EGLint major = 0, minor = 0;
  if (display == EGL_NO_DISPLAY || !eglInitialize(display, &major, &minor) ||
      !eglBindAPI(EGL_OPENGL_API)) {
    return EGL_NO_DISPLAY;
  }
  return display;
}

EGLContext TryContext(EGLDisplay display) {
  static const EGLint kConfig[] = {EGL_SURFACE_TYPE, EGL_PBUFFER_BIT, EGL_RENDERABLE_TYPE,
                                   EGL_OPENGL_BIT, EGL_NONE};
  EGLConfig config = nullptr;
  EGLint count = 0;
  if (!eglChooseConfig(display, kConfig, &config, 1, &count) || count < 1) {
    config = EGL_NO_CONFIG_KHR;
  }
  static const EGLint kContext[] = {EGL_CONTEXT_OPENGL_RESET_NOTIFICATION_STRATEGY,
                                    EGL_LOSE_CONTEXT_ON_RESET,
                                    EGL_CONTEXT_MAJOR_VERSION,
                                    4,
                                    EGL_CONTEXT_MINOR_VERSION,
                                    5,
                                    EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                    EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                    EGL_NONE};
  eglBindAPI(EGL_OPENGL_API);
  // A device's driver reports its reset. Mesa's software driver has no reset and refuses the
  // attribute.
  const EGLContext context = eglCreateContext(display, config, EGL_NO_CONTEXT, kContext);
  if (context != EGL_NO_CONTEXT) return context;
  return eglCreateContext(display, config, EGL_NO_CONTEXT, kContext + 2);
}

/// Mesa's software driver compiles shaders with libLLVM. Debian 13's LibTorch exports functions of
/// another LLVM under the same names, which would crash the driver. Opened like this, Mesa searches
/// its own libraries first. It stays open.
void KeepMesaFromForeignLlvm() {
  if (!::dlsym(RTLD_DEFAULT, kForeignLlvm)) return;
  constexpr int kOwnFirst = RTLD_LAZY | RTLD_LOCAL | RTLD_DEEPBIND;
  void* mesa = ::dlopen("libEGL_mesa.so.0", kOwnFirst);
  link_map* map = nullptr;
  if (!mesa || ::dlinfo(mesa, RTLD_DI_LINKMAP, &map) != 0) return;
  // Until 24.2, Mesa has its drivers in separate files.
  const auto driver = std::filesystem::path(map->l_name).parent_path() / "dri" / "swrast_dri.so";
  ::dlopen(driver.c_str(), kOwnFirst);
}

constexpr char kWithout[] = "or render without OpenGL: --renderer cpu, renderer=cpu in a recipe";

/// The reason why the surfaceless display, the last one to be tried, gives no OpenGL 4.5.
std::string Cause(const Display& display) {
  constexpr char kPackages[] =
      "EGL finds no driver: install the Debian packages libegl-mesa0 and libgl1-mesa-dri, whose "
      "file /usr/share/glvnd/egl_vendor.d/50_mesa.json names it";
  if (display.handle == EGL_NO_DISPLAY) return kPackages;
  const EGLContext plain =
      eglCreateContext(display.handle, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, nullptr);
  const EGLint error = eglGetError();
  if (plain == EGL_NO_CONTEXT)
    return fmt::format("the driver makes no context at all (EGL error {:#x})", error);
  std::string cause = "the driver makes no OpenGL 4.5 context";
  if (eglMakeCurrent(display.handle, EGL_NO_SURFACE, EGL_NO_SURFACE, plain)) {
    cause = fmt::format("the driver, {}, gives OpenGL {}",
                        reinterpret_cast<const char*>(glGetString(GL_RENDERER)),
                        reinterpret_cast<const char*>(glGetString(GL_VERSION)));
    eglMakeCurrent(display.handle, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
  }
  eglDestroyContext(display.handle, plain);
  return cause;
}

/// libepoxy ends the process if it cannot open one of these.
void RequireLibraries() {
  for (const auto& [name, other, package] : {std::tuple("libEGL.so.1", "libEGL.so.1", "libegl1"),
                                             {"libOpenGL.so.0", "libGL.so.1", "libopengl0"}}) {
    if (::dlopen(name, RTLD_LAZY | RTLD_LOCAL) || ::dlopen(other, RTLD_LAZY | RTLD_LOCAL)) continue;
    const char* why = ::dlerror();
    throw IoError(fmt::format("EGL: {} cannot be opened ({}); install the Debian package {}, {}",
                              name, why ? why : "no reason", package, kWithout));
  }
}

/// Displays that were initialised by this process; guarded by `mutex`.
struct DisplayTable {
  std::mutex mutex;
  std::map<EGLDeviceEXT, Display> displays;  // key nullptr: surfaceless Mesa
};

DisplayTable& Displays() {
  static auto* const table = [] {
    RequireLibraries();
    KeepMesaFromForeignLlvm();  // before EGL is used for the first time
    return new DisplayTable;    // outlives every thread
  }();
  return *table;
}

/// `device` null: the surfaceless display.
Display DisplayOf(DisplayTable& table, EGLDeviceEXT device) {
  auto [it, is_new] = table.displays.try_emplace(device);
  Display& display = it->second;
  if (!is_new) return display;
  display.platform = device ? "EGL device platform" : "EGL surfaceless platform";
  if (device) {
    display.handle =
        Initialised(eglGetPlatformDisplayEXT(EGL_PLATFORM_DEVICE_EXT, device, nullptr));
  } else if (HasExtension(eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS),
                          "EGL_MESA_platform_surfaceless")) {
    display.handle = Initialised(
        eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr));
  }
  return display;
}

}  // namespace

EglContext::EglContext(const EglContextOptions& options) {
  const auto open = [this](const Display& display) {
    if (display.handle == EGL_NO_DISPLAY) return;
    EGLContext context = TryContext(display.handle);
    if (context == EGL_NO_CONTEXT) return;
    if (!eglMakeCurrent(display.handle, EGL_NO_SURFACE, EGL_NO_SURFACE, context)) {
      eglDestroyContext(display.handle, context);
      return;
    }
    display_ = display.handle;
    context_ = context;
    platform_ = display.platform;
  };
  DisplayTable& table = Displays();
  const std::lock_guard<std::mutex> lock(table.mutex);
  const std::vector<EGLDeviceEXT> devices = HardwareDevices();
  if (options.device >= static_cast<int>(devices.size())) {
    throw IoError(fmt::format("EGL: device {} does not exist; there are {} hardware devices",
                              options.device, devices.size()));
  }
  for (std::size_t i = 0; i < devices.size() && context_ == EGL_NO_CONTEXT; ++i) {
    if (options.device >= 0 && static_cast<int>(i) != options.device) continue;
    open(DisplayOf(table, devices[i]));
  }
  if (context_ == EGL_NO_CONTEXT && options.device >= 0) {
    throw IoError(
        fmt::format("EGL: no OpenGL 4.5 context on device {}; use the default device, or check its "
                    "driver, {}",
                    options.device, kWithout));
  }
  if (context_ != EGL_NO_CONTEXT) return;
  const Display surfaceless = DisplayOf(table, nullptr);
  open(surfaceless);
  if (context_ == EGL_NO_CONTEXT) {
    throw IoError(
        fmt::format("EGL: OpenGL 4.5 is needed, and {}; {}", Cause(surfaceless), kWithout));
  }
}

EglContext::~EglContext() {
  eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
  eglDestroyContext(display_, context_);
  eglReleaseThread();
}

void KeepSoftwareRenderingOnOneThread() { setenv("LP_NUM_THREADS", "0", /*overwrite=*/0); }

bool EglContext::IsSoftware() const {
  const std::string renderer = reinterpret_cast<const char*>(glGetString(GL_RENDERER));
  return renderer.find("llvmpipe") != std::string::npos ||
         renderer.find("softpipe") != std::string::npos;
}

std::string EglContext::Describe() const {
  return fmt::format("{}, OpenGL {}, {}", reinterpret_cast<const char*>(glGetString(GL_RENDERER)),
                     reinterpret_cast<const char*>(glGetString(GL_VERSION)), platform_);
}

}  // namespace volalign
