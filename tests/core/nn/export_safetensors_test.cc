#include "core/nn/export_safetensors.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "core/base/error.h"
#include "core/nn/checkpoint.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/core/nn/run_check.h"

namespace volalign::export_safetensors_test {
namespace {

/// `options`: of export_safetensors_check.py, a blank before each.
void ExpectThatOthersReadIt(const std::string& options) {
  const TempFolder folder;
  CheckpointMeta meta;
  meta.structure = ReadStructure("configs/structure.yaml");
  meta.network.base_channels = 2;
  meta.network.normalization = Normalization::kBatch;
  meta.network.attention = false;  // whose bias of one element would shift what follows it
  meta.roll_offsets_deg = {90};
  SaveCheckpoint(folder / "model.pt", StructureNet(meta.network), meta, false);
  ExportSafetensors(folder / "model.pt", folder / "model.fp32.safetensors", false);
  ExportSafetensors(folder / "model.pt", folder / "model.fp16.safetensors", true);
  const std::string check = "tests/core/nn/export_safetensors_check.py" + options;
  EXPECT_EQ(testing_nn::RunCheck(VOLALIGN_PYTHON, check, folder.path()), 0);
}

TEST(ExportSafetensors, IsReadByOthers) { ExpectThatOthersReadIt(""); }

TEST(ExportSafetensors, IsReadBySafetensors) { ExpectThatOthersReadIt(" --safetensors"); }

TEST(ExportSafetensors, WritesNothingWhereItFails) {
  const TempFolder folder;
  ExpectError<IoError>(
      [&] { ExportSafetensors(folder / "missing.pt", folder / "x.safetensors", false); },
      {"missing.pt"});
  EXPECT_FALSE(std::filesystem::exists(folder / "x.safetensors"));
}

}  // namespace
}  // namespace volalign::export_safetensors_test
