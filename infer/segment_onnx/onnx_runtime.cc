#include "infer/segment_onnx/onnx_runtime.h"

#include <dlfcn.h>
#include <fmt/format.h>
#include <link.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <utility>

#include "core/base/error.h"

namespace volalign {

namespace {

/// An object of ONNX Runtime.
using Handle = void*;
/// Null where all went well; else to be released.
using Status = void*;

/// The functions that are used of version 1 of OrtApi (onnxruntime_c_api.h), at their places in
/// that table, which no later version changes. The library needs not be there to compile this.
struct OrtApi {
  void* unused_0[2];
  const char* (*GetErrorMessage)(Status status);
  Status (*CreateEnv)(int log_level, const char* log_name, Handle* env);
  void* unused_4[4];
  Status (*CreateSessionFromArray)(Handle env, const void* bytes, std::size_t size, Handle options,
                                   Handle* session);
  Status (*Run)(Handle session, Handle run_options, const char* const* input_names,
                const Handle* inputs, std::size_t input_count, const char* const* output_names,
                std::size_t output_count, Handle* outputs);
  Status (*CreateSessionOptions)(Handle* options);
  void* unused_11[13];
  Status (*SetIntraOpNumThreads)(Handle options, int threads);
  Status (*SetInterOpNumThreads)(Handle options, int threads);
  void* unused_26[23];
  Status (*CreateTensorWithDataAsOrtValue)(Handle memory_info, void* data, std::size_t size,
                                           const std::int64_t* shape, std::size_t dims, int type,
                                           Handle* value);
  void* unused_50[19];
  Status (*CreateCpuMemoryInfo)(int allocator, int memory, Handle* memory_info);
  void* unused_70[23];
  void (*ReleaseStatus)(Handle status);
  void (*ReleaseMemoryInfo)(Handle memory_info);
  void (*ReleaseSession)(Handle session);
  void (*ReleaseValue)(Handle value);
  void* unused_97[3];
  void (*ReleaseSessionOptions)(Handle options);
};
static_assert(offsetof(OrtApi, ReleaseSessionOptions) == 100 * sizeof(void*));

struct OrtApiBase {
  const OrtApi* (*GetApi)(std::uint32_t version);
  const char* (*GetVersionString)();
};

// Of the enumerations there.
constexpr std::uint32_t kApiVersion = 1;
constexpr int kLogFatal = 4, kArenaAllocator = 1, kDefaultMemory = 0, kFloat = 1;

/// As ONNX Runtime's releases name it. Debian 13's package has another name, and prints a thousand
/// lines when it starts: who wants it gives its path.
constexpr char kSystemName[] = "libonnxruntime.so.1";
constexpr char kWayOut[] =
    "install a release of ONNX Runtime (github.com/microsoft/onnxruntime), or give the path of its "
    "library, or take runtime = opencv";

using Owned = std::unique_ptr<void, void (*)(Handle)>;

/// Whether the file has all of its parts; the loader of one that lacks its end would crash.
bool IsWhole(const std::string& library) {
  ElfW(Ehdr) header;
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(library, error);
  if (!std::ifstream(library, std::ios::binary)
           .read(reinterpret_cast<char*>(&header), sizeof header))
    return false;
  return std::memcmp(header.e_ident, ELFMAG, SELFMAG) == 0 && header.e_shoff <= size &&
         header.e_shoff + std::uintmax_t{header.e_shnum} * header.e_shentsize <= size;
}

/// Never closed: threads of it and what it registered for the program's end may be left.
void* Open(const std::string& library) {
  if (library != kSystemName && !IsWhole(library)) {
    throw ConfigError(
        fmt::format("{} is no library, or not the whole of one; {}", library, kWayOut));
  }
  void* opened = dlopen(library.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!opened) throw ConfigError(fmt::format("{}; {}", dlerror(), kWayOut));
  return opened;
}

/// A network that ONNX Runtime runs.
class Session {
 public:
  Session(const std::string& library, const std::string& bytes, int classes, int threads)
      : classes_(classes) {
    const auto get_base =
        reinterpret_cast<const OrtApiBase* (*)()>(dlsym(Open(library), "OrtGetApiBase"));
    const OrtApiBase* base = get_base ? get_base() : nullptr;
    api_ = base ? base->GetApi(kApiVersion) : nullptr;
    if (!api_) throw ConfigError(fmt::format("{} is not ONNX Runtime; {}", library, kWayOut));
    name_ = fmt::format("ONNX Runtime {}", base->GetVersionString());
    try {
      // One for the process, kept as the library is.
      Handle env = nullptr;
      Check(api_->CreateEnv(kLogFatal, "volalign", &env));
      Handle options = nullptr;
      Check(api_->CreateSessionOptions(&options));
      const Owned owned(options, api_->ReleaseSessionOptions);
      Check(api_->SetIntraOpNumThreads(options, threads));
      Check(api_->SetInterOpNumThreads(options, 1));
      Handle made = nullptr;
      Check(api_->CreateCpuMemoryInfo(kArenaAllocator, kDefaultMemory, &made));
      memory_info_ = Owned(made, api_->ReleaseMemoryInfo);
      Check(api_->CreateSessionFromArray(env, bytes.data(), bytes.size(), options, &made));
      session_ = Owned(made, api_->ReleaseSession);
    } catch (const Error& error) {
      throw ConfigError(fmt::format("{}; {}", error.what(), kWayOut));
    }
  }

  const std::string& name() const { return name_; }

  std::vector<float> LogProbabilities(const DepthImage& depth) {
    std::vector<float> result(static_cast<std::size_t>(classes_) * depth.size());
    const Owned input = Tensor(const_cast<float*>(depth.data()), 1, depth);
    const Owned output = Tensor(result.data(), classes_, depth);
    const char* const input_name = "depth";
    const char* const output_name = "log_probabilities";
    const Handle in = input.get();
    Handle out = output.get();
    // An error where the output has another shape.
    Check(api_->Run(session_.get(), nullptr, &input_name, &in, 1, &output_name, 1, &out));
    return result;
  }

 private:
  void Check(Status status) const {
    if (!status) return;
    const std::string message = api_->GetErrorMessage(status);
    api_->ReleaseStatus(status);
    throw Error(fmt::format("{}: {}", name_, message));
  }

  /// `channels` planes of the depth map's size, which stay where they are.
  Owned Tensor(float* values, int channels, const DepthImage& depth) const {
    const std::int64_t shape[] = {1, channels, depth.height(), depth.width()};
    Handle made = nullptr;
    Check(api_->CreateTensorWithDataAsOrtValue(
        memory_info_.get(), values,
        static_cast<std::size_t>(channels) * depth.size() * sizeof(float), shape, 4, kFloat,
        &made));
    return Owned(made, api_->ReleaseValue);
  }

  const int classes_;
  const OrtApi* api_ = nullptr;
  std::string name_;
  Owned memory_info_{nullptr, nullptr}, session_{nullptr, nullptr};
};

}  // namespace

OnnxRuntime StartOnnxRuntime(const std::string& library, const std::string& bytes, int classes,
                             int threads) {
  const auto session =
      std::make_shared<Session>(library.empty() ? kSystemName : library, bytes, classes, threads);
  return {session->name(),
          [session](const DepthImage& depth) { return session->LogProbabilities(depth); }};
}

}  // namespace volalign
