#include "infer/segment_onnx/onnx_runtime.h"

#include <dlfcn.h>
#include <gnu/libc-version.h>
#include <gtest/gtest.h>

#include <string>

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::onnx_runtime_test {
namespace {

// With ONNX Runtime itself: parity_test.cc, and tests/bindings/c/c_library.py.
TEST(OnnxRuntimeTest, RefusesLibrariesThatAreNotIt) {
  Dl_info of_libc;  // by a function that no sanitizer has in its place
  ASSERT_NE(dladdr(reinterpret_cast<void*>(&gnu_get_libc_version), &of_libc), 0);
  const std::string libc = of_libc.dli_fname;
  const std::string bytes = ReadFile(libc);
  const TempFolder folder;
  const auto expect_refused = [](const std::string& library, const std::string& why) {
    ExpectError<ConfigError>([&] { StartOnnxRuntime(library, "", 21, 1); },
                             {library, why, "opencv"});
  };
  expect_refused(libc, "is not ONNX Runtime");
  expect_refused(folder / "missing.so", "is no library");
  expect_refused(folder.Write("empty.so", ""), "is no library");
  expect_refused(folder.Write("text.so", std::string(1000, 'a')), "is no library");
  expect_refused(folder.Write("half.so", bytes.substr(0, bytes.size() / 2)), "not the whole");
  // Whole by its header, but no library.
  expect_refused(folder.Write("zero.so", bytes.substr(0, 4) + std::string(1000, '\0')), "zero.so");
}

}  // namespace
}  // namespace volalign::onnx_runtime_test
