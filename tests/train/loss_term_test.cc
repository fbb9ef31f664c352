#include "train/loss_term.h"

#include <ATen/TensorOperators.h>
#include <ATen/ops/zeros.h>
#include <gtest/gtest.h>

#include "core/base/error.h"
#include "tests/core/base/expect_error.h"

namespace volalign::loss_term_test {
namespace {

/// As many as the structure has classes.
class Classes : public LossTerm {
 public:
  explicit Classes(int count) : count_(count) {}
  at::Tensor operator()(const LossInput& input) const override {
    return input.log_probs.sum() + static_cast<double>(count_);
  }

 private:
  int count_;
};

TEST(LossTerm, IsMadeByTheFactoryOfItsName) {
  const Structure structure = ReadStructure("configs/structure.yaml");
  ExpectError<ConfigError>([&] { MakeLossTerm("classes", structure, at::kCPU); },
                           {"loss.terms", "'classes'"});
  RegisterLossTerm("classes", [](const Structure& of, const at::Device& device) {
    EXPECT_EQ(device, at::Device(at::kCPU));
    return std::make_unique<Classes>(of.num_classes());
  });
  RegisterLossTerm(
      "none", [](const Structure&, const at::Device&) { return std::make_unique<Classes>(0); });
  ExpectError<Error>([] { RegisterLossTerm("classes", nullptr); }, {"'classes'"});
  const at::Tensor zero = at::zeros({1});
  const LossInput input{zero, zero, zero, zero};
  EXPECT_EQ((*MakeLossTerm("classes", structure, at::kCPU))(input).item<double>(), 21);
  EXPECT_EQ((*MakeLossTerm("none", structure, at::kCPU))(input).item<double>(), 0);
}

}  // namespace
}  // namespace volalign::loss_term_test
