#include "infer/formats/recording.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <fstream>
#include <utility>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/text.h"
#include "core/config/archive.h"
#include "core/config/bounded_yaml.h"
#include "infer/formats/unpack.h"

namespace volalign {

namespace {

/// A kind of recording: the first bytes of its files, and its reader.
struct Kind {
  const char* magic;
  formats_internal::Recording (*read)(const std::filesystem::path& path, const std::string& name,
                                      int max_frames, ReadBudget* budget);
};

constexpr Kind kKinds[] = {{"#ROSBAG V", formats_internal::ReadBagRecording},
                           {"SQLite format 3", formats_internal::ReadRos2Recording},
                           {"\x89MCAP0\r\n", formats_internal::ReadMcapRecording},
                           {"\x1a\x45\xdf\xa3", formats_internal::ReadMkvRecording}};

/// The first bytes of a file, unpacked if zstd packed it as a whole.
std::string FirstBytes(const std::filesystem::path& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return "";
  std::ifstream stream(path, std::ios::binary);
  std::string bytes(16, '\0');
  stream.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(stream.gcount()));
  return formats_internal::IsZstd(bytes) ? formats_internal::FrontOfZstd(path, bytes.size())
                                         : bytes;
}

/// Null for a file of another kind.
const Kind* KindOf(const std::string& bytes) {
  for (const Kind& kind : kKinds) {
    if (bytes.rfind(kind.magic, 0) == 0) return &kind;
  }
  return nullptr;
}

bool IsPacked(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  std::string bytes(4, '\0');
  stream.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  return formats_internal::IsZstd(bytes);
}

}  // namespace

std::vector<std::string> PartsOfRecording(const std::filesystem::path& folder) {
  try {
    const std::string name = "metadata.yaml";
    const nlohmann::json tree = YamlTree(ReadFile(folder / name, kMaxTextBytes), name);
    return ObjectReader(tree, name)
        .Child("rosbag2_bagfile_information")
        .Read<std::vector<std::string>>("relative_file_paths");
  } catch (const Error&) {
    return {};
  }
}

bool IsRecording(const std::filesystem::path& path) { return KindOf(FirstBytes(path)) != nullptr; }

std::vector<RecordedDepth> ReadRecording(const std::filesystem::path& path, int max_frames,
                                         ReadBudget* budget) {
  ReadBudget own;
  if (!budget) budget = &own;
  const std::string name = path.string();
  const std::string bytes = FirstBytes(path);
  if (bytes.empty() && IsPacked(path))
    throw DataError(name + ": damaged: what zstd packed cannot be unpacked");
  if (bytes.empty()) throw IoError(name + ": cannot be read, or is no file");
  const Kind* const kind = KindOf(bytes);
  if (!kind) {
    throw DataError(
        fmt::format("{}: neither a bag of ROS 1 or 2 (.bag, .db3, .mcap) nor a Matroska file; "
                    "expected a recording of "
                    "these",
                    name));
  }
  budget->Open(path);
  std::optional<formats_internal::UnpackedFile> unpacked;
  if (IsPacked(path)) unpacked.emplace(path, name, budget);
  formats_internal::Recording recording =
      kind->read(unpacked ? unpacked->path() : path, name, max_frames, budget);
  std::vector<RecordedDepth>& streams = recording.streams;
  const auto readable = [](const RecordedDepth& stream) { return stream.problem.empty(); };
  if (!streams.empty() && std::none_of(streams.begin(), streams.end(), readable)) {
    throw DataError(
        fmt::format("{}: {}: {}", name, Shortened(streams[0].stream), streams[0].problem));
  }
  if (streams.empty()) {
    const std::string contents = Shortened(fmt::format("{}", fmt::join(recording.contents, ", ")));
    throw DataError(fmt::format("{}: the recording has no depth stream with a frame; in it {} {}",
                                name, recording.contents.size() == 1 ? "is" : "are",
                                contents.empty() ? "no images or messages" : contents));
  }
  // These texts are printed.
  for (RecordedDepth& stream : streams) {
    for (std::string* text :
         {&stream.stream, &stream.device, &stream.serial, &stream.intrinsics_source})
      *text = Shortened(*text);
  }
  return streams;
}

namespace formats_internal {

std::string KindOfDevice(const std::string& device) {
  constexpr std::pair<const char*, const char*> kKinds[] = {{"realsense d415", "realsense_d415"},
                                                            {"realsense d435", "realsense_d435"},
                                                            {"realsense d455", "realsense_d455"},
                                                            {"femto bolt", "orbbec_femto_bolt"},
                                                            {"femto mega", "orbbec_femto_mega"},
                                                            {"xtion", "asus_xtion"},
                                                            {"carmine", "primesense_carmine"},
                                                            {"primesense", "primesense"},
                                                            {"ps1080", "primesense"}};
  const std::string name = Lower(device);
  for (const auto& [words, kind] : kKinds) {
    if (name.find(words) != std::string::npos) return kind;
  }
  // Not the Gemini 335L, whose baseline is another one.
  const std::string gemini = "gemini 335";
  const std::size_t at = name.find(gemini);
  const bool is_335 = at != std::string::npos && name.compare(at + gemini.size(), 1, "l") != 0;
  return is_335 ? "orbbec_gemini_335" : "";
}

}  // namespace formats_internal

}  // namespace volalign
