#include <gtest/gtest.h>
#include <torch/utils.h>

namespace {

/// Reseeds LibTorch before each test, so that no test depends on which ones ran before it.
class Reseed : public testing::EmptyTestEventListener {
  void OnTestStart(const testing::TestInfo&) override { torch::manual_seed(20200322); }
};

}  // namespace

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  testing::UnitTest::GetInstance()->listeners().Append(new Reseed);
  torch::set_num_threads(2);
  return RUN_ALL_TESTS();
}
