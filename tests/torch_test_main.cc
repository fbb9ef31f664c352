#include <torch/utils.h>

#include "tests/run_tests.h"

namespace {

/// Reseeds LibTorch before each test, so that no test depends on which ones ran before it.
class Reseed : public testing::EmptyTestEventListener {
  void OnTestStart(const testing::TestInfo&) override { torch::manual_seed(20200322); }
};

}  // namespace

int main(int argc, char** argv) {
  testing::UnitTest::GetInstance()->listeners().Append(new Reseed);
  torch::set_num_threads(1);  // ctest runs as many tests as there are cores
  return volalign::RunTests(argc, argv);
}
