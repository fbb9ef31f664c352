#include "render/dataset.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <thread>

#include "core/base/file_util.h"
#include "core/formats/image_io.h"
#include "render/egl/renderers.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"
#include "tests/render/expect_equal.h"

namespace volalign::dataset_test {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kFirst = 5;

SampleConfig SmallConfig() {
  SampleConfig config;
  config.image_sizes = {"40x36", "64x36"};
  return config;
}

std::shared_ptr<const SampleContext> Context(const SampleConfig& config = SmallConfig()) {
  return std::make_shared<const SampleContext>(MakeSampleContext(config, 4));
}

DatasetOptions Options(std::uint64_t count) {
  DatasetOptions options;
  options.seed = 3;
  options.first_index = kFirst;
  options.count = count;
  options.num_threads = 2;
  options.samples_per_folder = 8;
  options.make_renderer = GlRenderers();
  return options;
}

/// Every file below a folder, by its relative path.
std::map<std::string, std::string> Files(const fs::path& dir) {
  std::map<std::string, std::string> files;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(dir)) {
    if (entry.is_regular_file()) {
      files[fs::relative(entry.path(), dir).string()] = ReadFile(entry.path());
    }
  }
  return files;
}

void ExpectSameFiles(const fs::path& a, const fs::path& b) {
  const auto x = Files(a), y = Files(b);
  for (const auto& [name, bytes] : x) {
    ASSERT_EQ(y.count(name), 1u) << name;
    EXPECT_TRUE(bytes == y.at(name)) << name;
  }
  EXPECT_EQ(x.size(), y.size());
}

TEST(Dataset, ReadsTheSamplesThatWereDrawn) {
  const TempFolder folder;
  const DatasetResult result = WriteDataset(folder.path(), Context(), Options(21));
  EXPECT_EQ(result.found, 0u);
  EXPECT_EQ(result.written, 21u);
  const Dataset dataset(folder.path());
  const std::vector<Sample> samples = dataset.Read(kFirst, 21);
  ASSERT_EQ(samples.size(), 21u);
  const std::unique_ptr<DepthRenderer> owned = GlRenderers()();
  DepthRenderer& renderer = *owned;
  const auto context = Context();
  for (std::uint64_t i = 0; i < 21; ++i)
    ExpectEqual(samples[i], Synthesize(*context, renderer, 3, kFirst + i));
  EXPECT_EQ(dataset.Read(14, 3)[2].index, 16u);  // across a folder's end
  ExpectError<Error>([&] { dataset.Read(20, 7); }, {"20 to 26", "5 to 25"});
  ExpectError<Error>([&] { dataset.Read(4, 1); }, {"4 to 4"});
}

TEST(Dataset, DepthIsKeptToHalfAMillimetre) {
  const TempFolder folder;
  SampleConfig config = SmallConfig();
  config.noise.models = {"none"};
  WriteDataset(folder.path(), Context(config), Options(2));
  const std::unique_ptr<DepthRenderer> owned = GlRenderers()();
  DepthRenderer& renderer = *owned;
  const Sample truth = Synthesize(*Context(config), renderer, 3, kFirst);
  const Sample read = Dataset(folder.path()).Read(kFirst, 1)[0];
  for (std::size_t k = 0; k < truth.depth.size(); ++k) {
    ASSERT_LE(std::abs(read.depth[k] - truth.depth[k]), 0.000501F) << k;
    ASSERT_EQ(read.depth[k] > 0, truth.depth[k] > 0) << k;
  }
}

TEST(Dataset, FilesDoNotDependOnThreadsOrInterruptions) {
  const TempFolder one, many, parts;
  DatasetOptions options = Options(30);
  options.num_threads = 1;
  WriteDataset(one.path(), Context(), options);
  options.num_threads = 3;
  WriteDataset(many.path(), Context(), options);
  ExpectSameFiles(one.path(), many.path());
  for (const std::uint64_t count : {2u, 11u, 27u, 30u})
    WriteDataset(parts.path(), Context(), Options(count));
  ExpectSameFiles(one.path(), parts.path());
  EXPECT_EQ(WriteDataset(parts.path(), Context(), Options(30)).written, 0u);
  fs::remove_all(parts / "000002");
  EXPECT_EQ(WriteDataset(parts.path(), Context(), Options(30)).found, 11u);
  ExpectSameFiles(one.path(), parts.path());
}

// The process is killed in the middle, as a cluster does it; the rows that it leaves name complete
// files only, and the next run makes the folder what an uninterrupted one would have been.
TEST(Dataset, AKilledRunIsContinued) {
  constexpr char kFolder[] = "VOLALIGN_DATASET_TEST_FOLDER";
  testing::FLAGS_gtest_death_test_style = "threadsafe";  // the child is a fresh process
  std::optional<TempFolder> own;
  if (!std::getenv(kFolder)) {
    own.emplace();
    ::setenv(kFolder, own->path().c_str(), 1);
  }
  const fs::path killed = fs::path(std::getenv(kFolder)) / "killed";
  EXPECT_EXIT(
      {
        std::thread([&] {
          while (!fs::exists(killed / "000003" / "samples.jsonl")) std::this_thread::yield();
          ::kill(::getpid(), SIGKILL);
        }).detach();
        WriteDataset(killed, Context(), Options(100000));
      },
      testing::KilledBySignal(SIGKILL), "");
  if (!own) return;
  ::unsetenv(kFolder);
  ExpectError<DataError>([&] { Dataset dataset(killed); },
                         {killed.string(), "100000", "incomplete"});
  std::uint64_t rows = 0;
  for (const auto& [name, bytes] : Files(killed)) {
    if (fs::path(name).filename() != "samples.jsonl") continue;
    std::istringstream lines(bytes);
    for (std::string line; std::getline(lines, line); ++rows) {
      const auto row = nlohmann::json::parse(line);
      const fs::path at = (killed / name).parent_path();
      EXPECT_NO_THROW(ReadDepthFile(at / row.at("depth").get<std::string>()));
      EXPECT_NO_THROW(ReadPng8(at / row.at("labels").get<std::string>()));
    }
  }
  EXPECT_GE(rows, 24u);
  // The rest of 100,000 would take too long: the header alone knows the number.
  auto header = nlohmann::ordered_json::parse(ReadFile(killed / "index.json"));
  header["count"] = rows + 13;
  WriteFileAtomically(killed / "index.json", header.dump());
  const fs::path half =
      killed / fmt::format("{:06}", (kFirst + rows) / 8) / "00000099_depth.png.tmp-1";
  WriteFileAtomically(half, "half");
  EXPECT_EQ(WriteDataset(killed, Context(), Options(rows + 13)).found, rows);
  EXPECT_FALSE(fs::exists(half));
  WriteDataset(*own / "whole", Context(), Options(rows + 13));
  // Files of samples past the end may have been written before the kill.
  auto whole = Files(*own / "whole"), continued = Files(killed);
  for (const auto& [name, bytes] : whole) EXPECT_TRUE(bytes == continued[name]) << name;
}

TEST(Dataset, AnImageThatCannotBeWrittenGetsNoRow) {
  const TempFolder folder;
  const fs::path dir = folder / "set", blocked = dir / "000003" / "00000025_labels.png";
  fs::create_directories(blocked);
  ExpectError<IoError>([&] { WriteDataset(dir, Context(), Options(21)); }, {blocked.string()});
  EXPECT_TRUE(fs::exists(dir / "000002" / "samples.jsonl"));
  EXPECT_FALSE(fs::exists(dir / "000003" / "samples.jsonl"));
  fs::remove(blocked);
  EXPECT_EQ(WriteDataset(dir, Context(), Options(21)).found, 19u);
  EXPECT_EQ(Dataset(dir).Read(25, 1)[0].index, 25u);
}

TEST(Dataset, RefusesToMixSamples) {
  const TempFolder folder;
  WriteDataset(folder.path(), Context(), Options(3));
  const auto before = Files(folder.path());
  const auto refused = [&](const std::shared_ptr<const SampleContext>& context,
                           const DatasetOptions& options,
                           std::initializer_list<std::string> parts) {
    ExpectError<ConfigError>([&] { WriteDataset(folder.path(), context, options); }, parts);
  };
  SampleConfig config = SmallConfig();
  config.noise.models = {"paper"};
  refused(Context(config), Options(5),
          {folder.path().string(), "data.noise.models = paper (dataset: sensor)"});
  config = SmallConfig();
  config.renderer = RendererKind::kCpu;
  EXPECT_TRUE(DifferencesFrom(Dataset(folder.path()).header(), *Context(config)).empty());
  DatasetOptions options = Options(5);
  options.seed = 4;
  refused(Context(), options, {"seed = 4 (dataset: 3)"});
  options = Options(5);
  options.first_index = 6;
  refused(Context(), options, {"first index = 6 (dataset: 5)"});
  refused(Context(), Options(2), {"begun for 3", "2 asked for"});
  auto other = std::make_shared<SampleContext>(MakeSampleContext(SmallConfig(), 8));
  refused(other, Options(5), {"batch size = 8 (dataset: 4)"});
  other->batch_size = 4;
  other->pool[0].intrinsics[0].fx += 1e-9;
  refused(other, Options(5), {"data.intrinsics"});
  other = std::make_shared<SampleContext>(*Context());
  other->structure = other->structure.Displaced(
      std::vector<Pose>(other->structure.boxes().size(), Pose::Identity()), 1.01);
  refused(other, Options(5), {"data.structure"});
  const int held = ::open(folder.path().c_str(), O_RDONLY | O_DIRECTORY);
  ASSERT_EQ(::flock(held, LOCK_EX), 0);
  ExpectError<IoError>([&] { WriteDataset(folder.path(), Context(), Options(5)); },
                       {folder.path().string(), "another volalign"});
  ::close(held);
  EXPECT_TRUE(before == Files(folder.path()));
  folder.Write("index.json", "{\"format\": \"volalign.samples/1\"}");
  ExpectError<DataError>([&] { WriteDataset(folder.path(), Context(), Options(5)); },
                         {"index.json", "volalign.samples/1", "empty folder"});
}

TEST(Dataset, SaysWhatIsWrongWithAFolder) {
  const TempFolder folder;
  const fs::path dir = folder / "set";
  ExpectError<IoError>([&] { Dataset dataset(dir); },
                       {(dir / "index.json").string(), "volalign render"});
  WriteDataset(dir, Context(), Options(12));
  const Dataset dataset(dir);
  const fs::path depth = dir / "000001" / "00000009_depth.png";
  const fs::path labels = dir / "000001" / "00000009_labels.png";
  const fs::path rows = dir / "000001" / "samples.jsonl";
  const std::string good_depth = ReadFile(depth), good_labels = ReadFile(labels),
                    good_rows = ReadFile(rows);
  const auto expect = [&](const fs::path& path, const std::string& bytes,
                          std::initializer_list<std::string> parts) {
    const std::string good = ReadFile(path);
    WriteFileAtomically(path, bytes);
    ExpectError<DataError>([&] { dataset.Read(8, 4); }, parts);
    WriteFileAtomically(path, good);
  };
  std::string flipped = good_depth;
  flipped[flipped.size() / 2] = static_cast<char>(flipped[flipped.size() / 2] ^ 0x10);
  expect(depth, flipped, {depth.string(), "PNG"});
  expect(depth, good_depth.substr(0, good_depth.size() / 2), {depth.string(), "truncated"});
  expect(labels, good_depth, {labels.string(), "8 bits"});
  expect(depth, EncodePng(Image16(40, 30)), {depth.string(), "40x30", rows.string()});
  const LabelImage seen = ReadPng8(labels);
  expect(labels, EncodePng(LabelImage(seen.width(), seen.height(), 21)), {"sample 9", "label 21"});
  expect(rows, good_rows.substr(0, good_rows.find('\n') + 1),
         {rows.string(), "sample 9 is missing"});
  expect(rows, good_rows.substr(good_rows.find('\n') + 1), {rows.string(), "sample 9, not 8"});
  for (const fs::path& elsewhere :
       {fs::absolute(depth), fs::path("..") / "000001" / depth.filename()}) {
    std::string changed = good_rows;
    const std::string name = depth.filename().string();
    changed.replace(changed.find(name), name.size(), elsewhere.string());
    expect(rows, changed, {rows.string() + ":2", "not in the row's folder"});
  }
  expect(rows, "{\n" + good_rows, {rows.string() + ":1", "not valid JSON"});
  EXPECT_EQ(dataset.Read(8, 4).size(), 4u);
  fs::remove(labels);
  ExpectError<IoError>([&] { dataset.Read(9, 1); }, {labels.string()});
  fs::remove(rows);
  ExpectError<DataError>([&] { Dataset again(dir); }, {dir.string(), rows.string(), "incomplete"});
}

}  // namespace
}  // namespace volalign::dataset_test
