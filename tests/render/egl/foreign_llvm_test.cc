// This program exports functions under the names of LLVM's, as Debian 13's libtorch_cpu does.
// Mesa's software driver must not call them: they end the process.

#include <dlfcn.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "render/egl/renderers.h"

#define FOREIGN(name) \
  extern "C" __attribute__((visibility("default"))) void name() { std::abort(); }
FOREIGN(LLVMAddSymbol)
FOREIGN(LLVMContextCreate)
FOREIGN(LLVMModuleCreateWithNameInContext)
FOREIGN(LLVMCreateBuilderInContext)
FOREIGN(LLVMVoidTypeInContext)

namespace volalign {
namespace {

TEST(EglContext, MesaCallsItsOwnLlvm) {
  ASSERT_EQ(::dlsym(RTLD_DEFAULT, "LLVMAddSymbol"), reinterpret_cast<void*>(&LLVMAddSymbol));
  RenderedView view;
  ChooseRenderers(RendererKind::kEgl)
      .make()
      ->Render(SceneMesh(), {8, 4, 5, 5, 3.5, 1.5, {}}, Pose::Identity(), &view);
  EXPECT_EQ(view.depth.width(), 8);
}

}  // namespace
}  // namespace volalign
