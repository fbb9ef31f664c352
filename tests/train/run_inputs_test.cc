#include "train/run_inputs.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "core/base/file_util.h"
#include "core/geometry/camera.h"
#include "core/geometry/structure.h"
#include "render/sample.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/geometry/mesh_shapes.h"
#include "tests/train/synthetic_source.h"
#include "train/checkpoint_validation.h"
#include "train/trainer.h"

namespace volalign::run_inputs_test {
namespace {

namespace fs = std::filesystem;

std::string Replaced(std::string text, const std::string& part, const std::string& by) {
  const std::size_t at = text.find(part);
  if (at == std::string::npos) throw Error("there is no " + part);
  return text.replace(at, part.size(), by);
}

/// A run folder `run`, and a stack and intrinsics beside it.
class RunInputs : public testing::Test {
 protected:
  RunInputs() {
    config_.data.structure = folder_.Write("stack.yaml", stack_).string();
    config_.data.intrinsics = folder_.Write("pool.yaml", pool_).string();
    config_.data.sensors = {"realsense_d415"};
    fs::create_directory(run_);
  }

  Structure Read() const { return ReadStructure(config_.data.structure); }
  void Keep() { KeepInputs(run_, config_, Read()); }
  void Require() { RequireSameInputs(run_, config_, Read()); }

  const std::string stack_ = ReadFile("configs/structure.yaml");
  const std::string pool_ = ReadFile("configs/intrinsics.yaml");
  const std::string longer_ = Replaced(stack_, "[ 405,  810]", "[ 405,  870]");
  TempFolder folder_;
  fs::path run_ = folder_ / "run";
  TrainConfig config_;
};

TEST_F(RunInputs, AreKeptAsTheyWereAndOnce) {
  Keep();
  EXPECT_EQ(ReadFile(run_ / "structure.yaml"), stack_);
  EXPECT_EQ(ReadFile(run_ / "intrinsics.yaml"), pool_);
  EXPECT_EQ(KeptIntrinsics(run_), (run_ / "intrinsics.yaml").string());
  folder_.Write("stack.yaml", longer_);
  Keep();
  EXPECT_EQ(ReadFile(run_ / "structure.yaml"), stack_);
}

TEST_F(RunInputs, OfSamplesFromElsewhereHaveTheirStructure) {
  const Structure one =
      Structure::FromBoxes("one", {Box::FromMinMax("box", {-0.2, -0.4, -0.2}, {0.2, 0, 0.2})});
  KeepInputs(run_, config_, one);
  EXPECT_EQ(ReadStructure(run_ / "structure.yaml").Hash(), one.Hash());
}

TEST_F(RunInputs, OfAMeshAreKeptWithoutItsFile) {
  const fs::path mesh = mesh_shapes::WriteObj(folder_, mesh_shapes::Ell());
  for (const fs::path& file :
       {mesh, folder_.Write("named.yaml", "meshes: [{file: ell.obj, scale: 0.5}]\n")}) {
    fs::remove(run_ / "structure.yaml");
    config_.data.structure = file.string();
    Keep();
    Require();
    const Structure kept = ReadStructure(run_ / "structure.yaml");
    EXPECT_EQ(kept.Hash(), Read().Hash());
    EXPECT_EQ(kept.SideNames(), Read().SideNames());
    EXPECT_TRUE(kept.boxes()[0].mesh);
  }
}

TEST_F(RunInputs, OfOtherContentAreRefusedByName) {
  Keep();
  Require();
  folder_.Write("stack.yaml", "# another comment\n" + stack_);
  folder_.Write("pool.yaml", Replaced(pool_, "582.023188", "600"));  // of a sensor without use
  Require();
  folder_.Write("stack.yaml", longer_);
  ExpectError<ConfigError>([&] { Require(); },
                           {"data.structure = " + config_.data.structure, "boxes",
                            "--set data.structure=" + (run_ / "structure.yaml").string()});
  folder_.Write("stack.yaml", stack_);
  folder_.Write("pool.yaml", Replaced(pool_, "943.5726318359375", "950"));
  ExpectError<ConfigError>([&] { Require(); }, {"data.intrinsics = " + config_.data.intrinsics,
                                                (run_ / "intrinsics.yaml").string()});
}

TEST_F(RunInputs, StandInForFilesThatAreGone) {
  Keep();
  fs::remove(config_.data.structure);
  fs::remove(config_.data.intrinsics);
  EXPECT_TRUE(UseKeptInputs(run_, &config_.data).empty()) << "no run folder, but configs/ or so";
  WriteFileAtomically(run_ / "config.yaml", "");
  const std::vector<std::string> said = UseKeptInputs(run_, &config_.data);
  ASSERT_EQ(said.size(), 2u);
  EXPECT_TRUE(Has(said[0], "stack.yaml is not there"));
  EXPECT_EQ(config_.data.structure, (run_ / "structure.yaml").string());
  EXPECT_EQ(config_.data.intrinsics, (run_ / "intrinsics.yaml").string());
  Require();
}

/// A run of four samples, of which two were drawn.
class Resumed : public RunInputs {
 protected:
  Resumed() {
    config_.model.base_channels = 1;
    config_.model.residual_blocks = 1;
    config_.loss.procrustes = false;
    config_.run.samples = 4;
    config_.run.batch_size = 2;
    config_.run.validation_samples = 0;
    config_.run.tensorboard = false;
    Train();
    options_ = QuietRun(run_, 0, true);
  }

  TrainResult Train() {
    TrainingData data = SyntheticData(2, 16, 8);
    data.structure = Read();
    data.intrinsics = EntriesOf(config_.data.sensors, ReadIntrinsicsPool(config_.data.intrinsics));
    return TrainOn(data, config_, options_);
  }

  TrainOptions options_ = QuietRun(run_, 2);
};

TEST_F(Resumed, ARunDoesNotGoOnWithAnotherStack) {
  folder_.Write("stack.yaml", longer_);
  ExpectError<ConfigError>([&] { Train(); }, {"data.structure = ", "stack.yaml"});
  // Whatever its file is called.
  folder_.Write("stack.yaml", stack_);
  config_.data.structure = folder_.Write("renamed.yaml", stack_).string();
  EXPECT_TRUE(Train().finished);
}

TEST_F(Resumed, ARunOfAnEarlierVersionHasItsModelsStack) {
  fs::remove(run_ / "structure.yaml");
  folder_.Write("stack.yaml", longer_);
  ExpectError<ConfigError>([&] { Train(); }, {"data.structure = ", "model.safetensors"});
  folder_.Write("stack.yaml", stack_);
  EXPECT_TRUE(Train().finished);
  EXPECT_TRUE(fs::exists(run_ / "structure.yaml"));
}

TEST_F(Resumed, SaysThatItBeginsBeforeItWritesTheRecipe) {
  const fs::path config = run_ / "config.yaml";
  int begun = 0;
  options_.begun = [&] {
    ++begun;
    EXPECT_FALSE(fs::exists(config));
  };
  options_.resume = false;
  EXPECT_THROW(Train(), Error);  // there is a run
  EXPECT_EQ(begun, 0);
  options_.resume = true;
  fs::remove(config);
  Train();
  EXPECT_EQ(begun, 1);
}

TEST_F(Resumed, ACheckpointIsValidatedOnItsOwnStackAndIntrinsics) {
  LoadedModel model = LoadCheckpoint(run_ / "model.safetensors");
  config_.data.image_sizes = {"64x36"};
  config_.data.renderer = RendererKind::kCpu;
  config_.run.batch_size = 1;
  const ValidationResult own = ValidateCheckpoint(model, config_, 1);
  folder_.Write("stack.yaml", longer_);
  EXPECT_EQ(ValidateCheckpoint(model, config_, 1).means, own.means);
  const Structure longer = Read();
  EXPECT_NE(ValidateCheckpoint(model, config_, 1, nullptr, &longer).means, own.means);
  fs::remove(config_.data.structure);
  EXPECT_EQ(ValidateCheckpoint(model, config_, 1).means, own.means);
  const std::string wider = Replaced(pool_, "943.5726318359375", "700");
  folder_.Write("pool.yaml", Replaced(wider, "939.235107421875", "700"));
  EXPECT_EQ(ValidateCheckpoint(model, config_, 1).means, own.means);
  config_.data.sensors.push_back("realsense_d435");  // not of the training
  EXPECT_NO_THROW(ValidateCheckpoint(model, config_, 1));
  config_.data.sensors.pop_back();
  model.meta.intrinsics.clear();
  EXPECT_NE(ValidateCheckpoint(model, config_, 1).means, own.means);
}

}  // namespace
}  // namespace volalign::run_inputs_test
