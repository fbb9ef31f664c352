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

#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/base/provenance.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/nn/zip.h"

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
    meta_.samples = 4321;
    meta_.config_yaml = "run:\n  samples: 1\n";
    net_ = StructureNet(meta_.network);
    c10::NoGradGuard no_grad;
    for (at::Tensor& b : net_->buffers()) b.uniform_(0.5, 1.5);
  }
  /// The message of the error of that type that loading throws; it is one line and names the file.
  template <class E>
  std::string LoadError(const fs::path& path) {
    try {
      LoadCheckpoint(path);
    } catch (const E& e) {
      std::string message = e.what();
      EXPECT_EQ(message.find('\n'), std::string::npos) << message;
      EXPECT_NE(message.find(path.filename().string()), std::string::npos) << message;
      return message;
    } catch (const std::exception& e) {
      ADD_FAILURE() << "another exception: " << e.what();
    }
    ADD_FAILURE() << "nothing thrown for " << path;
    return "";
  }

  TempFolder folder_;
  CheckpointMeta meta_;
  StructureNet net_{nullptr};
};

TEST_F(CheckpointTest, RoundTripsNetworkAndMetadata) {
  const fs::path path = folder_ / "a.pt";
  meta_.renderer = "a renderer";
  SaveCheckpoint(path, net_, meta_, /*half=*/false);
  LoadedModel model = LoadCheckpoint(path);
  EXPECT_TRUE(model.meta.network == meta_.network);
  EXPECT_EQ(model.meta.structure.Hash(), meta_.structure.Hash());
  EXPECT_EQ(model.meta.structure.SideNames(), meta_.structure.SideNames());
  EXPECT_EQ(model.meta.focal_px, meta_.focal_px);
  EXPECT_EQ(model.meta.image_sizes, meta_.image_sizes);
  EXPECT_EQ(model.meta.roll_offsets_deg, meta_.roll_offsets_deg);
  EXPECT_EQ(model.meta.samples, 4321);
  EXPECT_EQ(model.meta.config_yaml, meta_.config_yaml);
  EXPECT_EQ(model.meta.renderer, "a renderer");
  EXPECT_EQ(model.meta.tool, Tool());
  EXPECT_EQ(model.meta.date, UtcNow());
  EXPECT_EQ(model.meta.libraries.rfind("LibTorch ", 0), 0u) << model.meta.libraries;
  EXPECT_FALSE(model.net->is_training());
  c10::NoGradGuard no_grad;
  net_->eval();
  const at::Tensor x = EncodeDepth(at::rand({1, 1, 40, 56}) * 3, meta_.network.input);
  EXPECT_TRUE(model.net->forward(x).equal(net_->forward(x)));
}

TEST_F(CheckpointTest, HalfHalvesTheWeightsAndKeepsTheStatistics) {
  SaveCheckpoint(folder_ / "full.pt", net_, meta_, false);
  SaveCheckpoint(folder_ / "half.pt", net_, meta_, true);
  EXPECT_LT(fs::file_size(folder_ / "half.pt"), 0.75 * fs::file_size(folder_ / "full.pt"));
  const LoadedModel model = LoadCheckpoint(folder_ / "half.pt");
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
  for (const auto& item : model.net->named_buffers()) {
    EXPECT_TRUE(item.value().equal(buffers[item.key()])) << item.key();
  }
}

TEST_F(CheckpointTest, RefusesTruncatedChangedAndForeignFiles) {
  const fs::path good = folder_ / "good.pt";
  SaveCheckpoint(good, net_, meta_, false);
  const std::string bytes = ReadFile(good);

  const fs::path bad = folder_ / "bad.pt";
  for (std::size_t size :
       {std::size_t{0}, std::size_t{3}, std::size_t{100}, bytes.size() / 2, bytes.size() - 1}) {
    WriteFileAtomically(bad, bytes.substr(0, size));
    LoadError<DataError>(bad);
  }
  // A flipped bit every 97 bytes or so apart, one at a time, over the whole file.
  for (std::size_t at = 40; at < bytes.size(); at += bytes.size() / 61) {
    std::string changed = bytes;
    changed[at] = static_cast<char>(changed[at] ^ 0x10);
    WriteFileAtomically(bad, changed);
    try {
      const LoadedModel model = LoadCheckpoint(bad);
      // Padding between the records carries nothing: then the network must be the saved one.
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
  LoadError<DataError>(bad);
  WriteFileAtomically(bad, "PK\x03\x04" + noise);
  LoadError<DataError>(bad);
  LoadError<IoError>(folder_ / "missing.pt");
}

TEST_F(CheckpointTest, RefusesOtherPicklesWithoutRunningThem) {
  const fs::path bad = folder_ / "list.pt";
  const std::vector<char> list = torch::jit::pickle_save(c10::IValue(std::int64_t{42}));
  WriteFileAtomically(bad, std::string_view(list.data(), list.size()));
  LoadError<DataError>(bad);

  // What makes LibTorch's own unpickler take values from before its stack, or recurse.
  for (const std::string& pickle :
       {std::string(")R."), std::string("\x85."), std::string("R."), std::string("b"),
        std::string("Q."), ")" + std::string(3000000, '\x85') + ".",
        std::string("cos\nsystem\n(X\x04\x00\x00\x00truetR.", 24), std::string("(e."),
        std::string("h\xff.")}) {
    WriteFileAtomically(
        bad, Zip({{"archive/data.pkl", "\x80\x02" + pickle}, {"archive/version", "3\n"}}), false);
    LoadError<DataError>(bad);
  }
  WriteFileAtomically(bad, Zip({{"archive/data.pkl", "\x80\x02}."}}, /*method=*/8), false);
  EXPECT_NE(LoadError<DataError>(bad).find("compressed"), std::string::npos);

  WriteTensorFile(bad, {"volalign.checkpoint/999", "{}", {}});
  EXPECT_NE(LoadError<DataError>(bad).find("volalign.checkpoint/999"), std::string::npos);
  WriteTensorFile(bad, {kCheckpointFormat, "{}", {}});
  EXPECT_NE(LoadError<DataError>(bad).find("metadata"), std::string::npos);
}

// The shipped models' metadata were written field by field: the same keys and values come back.
TEST_F(CheckpointTest, WritesTheMetadataThatItReads) {
  std::vector<fs::path> paths = {"models/m05-lite.pt"};
  for (const fs::directory_entry& entry : fs::directory_iterator("models/paper-lite")) {
    if (entry.path().extension() == ".pt") paths.push_back(entry.path());
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
  const fs::path path = folder_ / "a.pt";
  SaveCheckpoint(path, net_, meta_, false);
  const TensorFile good = ReadTensorFile(path, kCheckpointFormat);
  const auto error_with = [&](int channels, int blocks) {
    nlohmann::ordered_json meta = nlohmann::ordered_json::parse(good.meta);
    meta["network"]["base_channels"] = channels;
    meta["network"]["residual_blocks"] = blocks;
    WriteTensorFile(path, {good.format, meta.dump(), good.tensors});
    return LoadError<DataError>(path);
  };
  EXPECT_NE(error_with(1200, 1).find("base_channels in [1, 1024]"), std::string::npos);
  EXPECT_NE(error_with(2, 2000000).find("residual_blocks in [0, 64]"), std::string::npos);
  EXPECT_NE(error_with(1024, 64).find("instead of ["), std::string::npos);
  EXPECT_NE(error_with(2, 2).find("'residual2_1.norm_bias' is missing"), std::string::npos);
  EXPECT_EQ(error_with(2, 0).find("not a whole one"), std::string::npos);
}

// A structure of two boxes of 200 km, and metadata of lists in lists.
TEST_F(CheckpointTest, LimitsTheMetadata) {
  const fs::path path = folder_ / "a.pt";
  SaveCheckpoint(path, net_, meta_, false);
  const TensorFile good = ReadTensorFile(path, kCheckpointFormat);
  nlohmann::ordered_json meta = nlohmann::ordered_json::parse(good.meta);
  meta["structure"]["boxes"][0]["size"] = {2e5, 2e5, 2e5};
  WriteTensorFile(path, {good.format, meta.dump(), good.tensors});
  EXPECT_NE(LoadError<DataError>(path).find("10 mm to 100 m"), std::string::npos);
  WriteTensorFile(path, {good.format, std::string(200000, '[') + std::string(200000, ']'), {}});
  EXPECT_NE(LoadError<DataError>(path).find("64 levels"), std::string::npos);
}

TEST_F(CheckpointTest, NamesTheTensorThatDoesNotFit) {
  const fs::path path = folder_ / "a.pt";
  SaveCheckpoint(path, net_, meta_, false);
  const TensorFile good = ReadTensorFile(path, kCheckpointFormat);

  TensorFile file = good;
  file.tensors.erase("merge2.weight");
  WriteTensorFile(path, file);
  EXPECT_NE(LoadError<DataError>(path).find("'merge2.weight' is missing"), std::string::npos);

  file = good;
  file.tensors["another.weight"] = at::zeros({2});
  WriteTensorFile(path, file);
  EXPECT_NE(LoadError<DataError>(path).find("'another.weight'"), std::string::npos);

  file = good;  // torch::load would take a [4,..] into a [5,..] without a word
  file.tensors["classifier.bias"] = at::zeros({20});
  WriteTensorFile(path, file);
  const std::string message = LoadError<DataError>(path);
  EXPECT_NE(message.find("'classifier.bias' has the shape [20] instead of [21]"), std::string::npos)
      << message;

  file = good;
  file.tensors["classifier.bias"] = at::zeros({21}).to(at::kDouble);
  WriteTensorFile(path, file);
  EXPECT_NE(LoadError<DataError>(path).find("type"), std::string::npos);
}

TEST_F(CheckpointTest, RefusesToSaveWhatDoesNotBelongTogether) {
  CheckpointMeta other = meta_;
  other.network.base_channels = 3;
  EXPECT_THROW(SaveCheckpoint(folder_ / "a.pt", net_, other, false), Error);
  other = meta_;
  other.structure = Structure::FromBoxes(
      "one", {Box::FromMinMax("a", Eigen::Vector3d::Zero(), Eigen::Vector3d::Ones())});
  EXPECT_THROW(SaveCheckpoint(folder_ / "a.pt", net_, other, false), DataError);
  EXPECT_FALSE(fs::exists(folder_ / "a.pt"));
}

TEST_F(CheckpointTest, StructureMayChangeDimensionsOnly) {
  std::vector<Box> boxes = meta_.structure.boxes();
  for (Box& b : boxes) b.size *= 1.07;
  EXPECT_NO_THROW(
      CheckStructure(meta_, Structure::FromBoxes("larger", boxes, meta_.structure.SideNames())));
  std::vector<std::string> names = meta_.structure.SideNames();
  std::swap(names[0], names[7]);
  try {
    CheckStructure(meta_, Structure::FromBoxes("permuted", boxes, names));
    ADD_FAILURE() << "a permuted label order was accepted";
  } catch (const DataError& e) {
    EXPECT_NE(std::string(e.what()).find("label 1"), std::string::npos) << e.what();
  }
  boxes.pop_back();
  EXPECT_THROW(CheckStructure(meta_, Structure::FromBoxes("three", boxes)), DataError);
}

}  // namespace
}  // namespace volalign::checkpoint_test
