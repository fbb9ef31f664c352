#include "core/nn/checkpoint.h"

#include <ATen/TensorOperators.h>
#include <ATen/core/ivalue.h>
#include <ATen/ops/rand.h>
#include <ATen/ops/zeros.h>
#include <c10/core/GradMode.h>
#include <gtest/gtest.h>
#include <torch/csrc/jit/serialization/pickle.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/base/file_util.h"
#include "core/base/provenance.h"
#include "core/nn/safetensors.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/nn/run_check.h"

namespace volalign::checkpoint_test {
namespace {

namespace fs = std::filesystem;

class CheckpointTest : public testing::Test {
 protected:
  void SetUp() override {
    meta_.network.base_channels = 2;
    meta_.network.residual_blocks = 1;
    meta_.network.normalization = Normalization::kBatch;
    meta_.network.input = InputEncoding::kDepthMask;
    meta_.structure = ReadStructure("configs/structure.yaml");
    meta_.focal_px = {117.9, 126.3};
    meta_.image_sizes = {{160, 144}, {160, 90}};
    meta_.roll_offsets_deg = {90};
    meta_.intrinsics = {{"realsense_d415", {{1280, 720, 943.5726318359375, 939, 636.6, 353, {}}}}};
    meta_.samples = 4321;
    meta_.config_yaml = "run:\n  samples: 1\n";
    net_ = StructureNet(meta_.network);
    c10::NoGradGuard no_grad;
    for (at::Tensor& b : net_->buffers()) b.uniform_(0.5, 1.5);
  }
  template <class E>
  std::string ExpectLoadError(const fs::path& path, const std::string& part = "") {
    return ExpectError<E>([&] { LoadCheckpoint(path); }, {path.filename().string(), part});
  }
  TensorFile Saved() {
    SaveCheckpoint(folder_ / "a.safetensors", net_, meta_, false);
    return ReadTensorFile(folder_ / "a.safetensors", kCheckpointFormat);
  }
  std::string ExpectRefused(const TensorFile& file, const std::string& part) {
    WriteTensorFile(folder_ / "a.safetensors", file);
    return ExpectLoadError<DataError>(folder_ / "a.safetensors", part);
  }

  TempFolder folder_;
  CheckpointMeta meta_;
  StructureNet net_{nullptr};
};

TEST_F(CheckpointTest, RoundTripsNetworkAndMetadata) {
  const fs::path path = folder_ / "a.safetensors";
  meta_.renderer = "a renderer";
  SaveCheckpoint(path, net_, meta_, /*half=*/false);
  LoadedModel model = LoadCheckpoint(path);
  meta_.tool = Tool();
  meta_.date = UtcNow();
  meta_.libraries = model.meta.libraries;
  EXPECT_EQ(MetaToJson(model.meta), MetaToJson(meta_));
  EXPECT_EQ(model.meta.renderer, "a renderer");
  EXPECT_EQ(model.meta.intrinsics.at(0).sensor, "realsense_d415");
  EXPECT_EQ(model.meta.intrinsics[0].intrinsics, meta_.intrinsics[0].intrinsics);
  EXPECT_EQ(model.meta.libraries.rfind("LibTorch ", 0), 0u) << model.meta.libraries;
  EXPECT_FALSE(model.net->is_training());
  c10::NoGradGuard no_grad;
  net_->eval();
  const at::Tensor x = EncodeDepth(at::rand({1, 1, 40, 56}) * 3, meta_.network.input);
  EXPECT_TRUE(model.net->forward(x).equal(net_->forward(x)));
}

TEST_F(CheckpointTest, HalfHalvesTheWeightsAndKeepsTheStatistics) {
  SaveCheckpoint(folder_ / "full.safetensors", net_, meta_, false);
  SaveCheckpoint(folder_ / "half.safetensors", net_, meta_, true);
  EXPECT_LT(fs::file_size(folder_ / "half.safetensors"),
            0.75 * fs::file_size(folder_ / "full.safetensors"));
  const LoadedModel model = LoadCheckpoint(folder_ / "half.safetensors");
  const auto saved = net_->named_parameters();
  for (const auto& item : model.net->named_parameters()) {
    ASSERT_EQ(item.value().scalar_type(), at::kFloat);
    const at::Tensor& exact = saved[item.key()];
    // float16 has 11 significant bits, and a step of 2^-24 near zero.
    EXPECT_TRUE(
        ((item.value() - exact).abs() <= exact.abs() * 0x1p-11 + 0x1p-24).all().item<bool>())
        << item.key();
  }
  const auto buffers = net_->named_buffers();
  for (const auto& item : model.net->named_buffers())
    EXPECT_TRUE(item.value().equal(buffers[item.key()])) << item.key();
}

TEST_F(CheckpointTest, RefusesChangedAndForeignFiles) {
  const fs::path good = folder_ / "good.safetensors";
  SaveCheckpoint(good, net_, meta_, false);
  const std::string bytes = ReadFile(good);

  const fs::path bad = folder_ / "bad.safetensors";
  // A flipped bit every 97 bytes or so apart, one at a time, over the whole file.
  for (std::size_t at = 40; at < bytes.size(); at += bytes.size() / 61) {
    std::string changed = bytes;
    changed[at] = static_cast<char>(changed[at] ^ 0x10);
    WriteFileAtomically(bad, changed);
    try {
      const LoadedModel model = LoadCheckpoint(bad);
      // Padding behind the header carries nothing: then the network must be the saved one.
      const auto saved = net_->named_parameters();
      for (const auto& item : model.net->named_parameters()) {
        ASSERT_TRUE(item.value().equal(saved[item.key()])) << at;
      }
    } catch (const DataError&) {
    }
  }
  std::string noise(5000, '\0');
  for (std::size_t i = 0; i < noise.size(); ++i) noise[i] = static_cast<char>((i * 7919) >> 3);
  WriteFileAtomically(bad, noise);
  ExpectLoadError<DataError>(bad);
  ExpectLoadError<IoError>(folder_ / "missing.safetensors");
}

TEST_F(CheckpointTest, RefusesOtherFormats) {
  ExpectRefused({"volalign.checkpoint/999", "{}", {}}, "volalign.checkpoint/999");
  ExpectRefused({kCheckpointFormat, "{}", {}}, "metadata");
  const fs::path bad = folder_ / "bad.safetensors";
  WriteFileAtomically(bad, WriteSafetensors({{{"format", "pt"}}, {{"a", at::zeros({2})}}}));
  ExpectLoadError<DataError>(bad, "it has no volalign.json");
}

/// A file as earlier versions wrote it.
void WritePickle(const fs::path& path, const TensorFile& file, const std::string& digest) {
  c10::Dict<std::string, at::Tensor> tensors;
  for (const auto& [name, tensor] : file.tensors) tensors.insert(name, tensor);
  c10::impl::GenericDict dict(c10::StringType::get(), c10::AnyType::get());
  dict.insert("format", file.format);
  dict.insert("meta", file.meta);
  dict.insert("digest", digest);
  dict.insert("tensors", tensors);
  const std::vector<char> bytes = torch::jit::pickle_save(dict);
  WriteFileAtomically(path, std::string_view(bytes.data(), bytes.size()));
}

int Convert(const fs::path& from, const fs::path& to) {
  return testing_nn::RunCheck(VOLALIGN_PYTHON, "packaging/convert_checkpoint.py " + from.string(),
                              to);
}

TEST_F(CheckpointTest, ConvertsThePicklesOfEarlierVersions) {
  const fs::path old = folder_ / "old.pt", converted = folder_ / "new.safetensors",
                 saved = folder_ / "saved.safetensors";
  SaveCheckpoint(saved, net_, meta_, /*half=*/true);
  const TensorFile file = ReadTensorFile(saved, kCheckpointFormat);
  const std::string digest = ReadSafetensors(ReadFile(saved)).texts.at("digest");
  WritePickle(old, {"volalign.checkpoint/1", file.meta, file.tensors}, digest);
  ExpectLoadError<DataError>(old, "packaging/convert_checkpoint.py");
  ASSERT_EQ(Convert(old, converted), 0);
  EXPECT_TRUE(ReadFile(converted) == ReadFile(saved));

  // A state, over itself.
  const fs::path state = folder_ / "0.state", written = folder_ / "1.state";
  WriteTensorFile(written, {"volalign.training/2", R"({"best": {"since": 1, "value": 2}})", {}});
  WritePickle(state, {"volalign.training/2", R"({"best": {"since": 1, "value": 2}})", {}},
              ReadSafetensors(ReadFile(written)).texts.at("digest"));
  ASSERT_EQ(Convert(state, state), 0);
  EXPECT_EQ(ReadTensorFile(state, "volalign.training/3").meta, R"({"best": {"value": 2}})");

  WritePickle(old, {"volalign.checkpoint/1", file.meta, {}}, digest);
  EXPECT_NE(Convert(old, folder_ / "damaged.safetensors"), 0);
  EXPECT_FALSE(fs::exists(folder_ / "damaged.safetensors"));
}

// The shipped models' metadata were written field by field: the same keys and values come back.
TEST_F(CheckpointTest, WritesTheMetadataThatItReads) {
  std::vector<fs::path> paths = {"models/m05-lite.safetensors"};
  for (const fs::directory_entry& entry : fs::directory_iterator("models/paper-lite")) {
    if (entry.path().extension() == ".safetensors") paths.push_back(entry.path());
  }
  EXPECT_EQ(paths.size(), 9u);
  for (const fs::path& path : paths) {
    const std::string stored = ReadTensorFile(path, kCheckpointFormat).meta;
    EXPECT_EQ(nlohmann::json::parse(MetaToJson(LoadCheckpoint(path).meta)),
              nlohmann::json::parse(stored))
        << path;
  }
}

// Metadata may not ask for more memory than the file's tensors are.
TEST_F(CheckpointTest, ComparesTheMetadataBeforeItBuildsTheNetwork) {
  const TensorFile good = Saved();
  const auto expect = [&](int channels, int blocks, const std::string& part) {
    nlohmann::ordered_json meta = nlohmann::ordered_json::parse(good.meta);
    meta["network"]["base_channels"] = channels;
    meta["network"]["residual_blocks"] = blocks;
    return ExpectRefused({good.format, meta.dump(), good.tensors}, part);
  };
  expect(1200, 1, "base_channels in [1, 1024]");
  expect(2, 2000000, "residual_blocks in [0, 64]");
  expect(1024, 64, "instead of [");
  expect(2, 2, "'residual2_1.norm_bias' is missing");
  EXPECT_FALSE(Has(expect(2, 0, ""), "not a whole one"));
}

// A structure of two boxes of 200 km, and metadata of lists in lists.
TEST_F(CheckpointTest, LimitsTheMetadata) {
  const TensorFile good = Saved();
  nlohmann::ordered_json meta = nlohmann::ordered_json::parse(good.meta);
  meta["structure"]["boxes"][0]["size"] = {2e5, 2e5, 2e5};
  ExpectRefused({good.format, meta.dump(), good.tensors}, "10 mm to 100 m");
  meta = nlohmann::ordered_json::parse(good.meta);
  meta["intrinsics"][0]["intrinsics"] = nlohmann::json::array();
  ExpectRefused({good.format, meta.dump(), good.tensors}, "realsense_d415 has no intrinsics");
  ExpectRefused({good.format, std::string(200000, '[') + std::string(200000, ']'), {}},
                "64 levels");
}

TEST_F(CheckpointTest, NamesTheTensorThatDoesNotFit) {
  const TensorFile good = Saved();
  TensorFile file = good;
  file.tensors.erase("merge2.weight");
  ExpectRefused(file, "'merge2.weight' is missing");
  file = good;
  file.tensors["another.weight"] = at::zeros({2});
  ExpectRefused(file, "'another.weight'");
  file = good;  // torch::load would take a [4,..] into a [5,..] without a word
  file.tensors["classifier.bias"] = at::zeros({20});
  ExpectRefused(file, "'classifier.bias' has the shape [20] instead of [21]");
  file.tensors["classifier.bias"] = at::zeros({21}).to(at::kDouble);
  ExpectRefused(file, "type");
}

TEST_F(CheckpointTest, RefusesToSaveWhatDoesNotBelongTogether) {
  CheckpointMeta other = meta_;
  other.network.base_channels = 3;
  EXPECT_THROW(SaveCheckpoint(folder_ / "a.safetensors", net_, other, false), Error);
  other = meta_;
  other.structure = Structure::FromBoxes(
      "one", {Box::FromMinMax("a", Eigen::Vector3d::Zero(), Eigen::Vector3d::Ones())});
  EXPECT_THROW(SaveCheckpoint(folder_ / "a.safetensors", net_, other, false), DataError);
  EXPECT_FALSE(fs::exists(folder_ / "a.safetensors"));
}

TEST_F(CheckpointTest, StructureMayChangeDimensionsOnly) {
  std::vector<Box> boxes = meta_.structure.boxes();
  for (Box& b : boxes) b.size *= 1.07;
  EXPECT_NO_THROW(
      CheckStructure(meta_, Structure::FromBoxes("larger", boxes, meta_.structure.SideNames())));
  std::vector<std::string> names = meta_.structure.SideNames();
  std::swap(names[0], names[7]);
  const Structure permuted = Structure::FromBoxes("permuted", boxes, names);
  ExpectError<DataError>([&] { CheckStructure(meta_, permuted); }, {"label 1"});
  boxes.pop_back();
  EXPECT_THROW(CheckStructure(meta_, Structure::FromBoxes("three", boxes)), DataError);
}

}  // namespace
}  // namespace volalign::checkpoint_test
