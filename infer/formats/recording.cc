#include "infer/formats/recording.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <fstream>
#include <utility>

#include "core/base/error.h"
#include "core/base/text.h"

namespace volalign {

namespace {

/// A kind of recording: what its files begin with, and its reader.
struct Kind {
  const char* magic;
  formats_internal::Recording (*read)(const std::filesystem::path& path, int max_frames);
};
formats_internal::Recording ReadRos2(const std::filesystem::path& path, int max_frames) {
  // Of a bag of a million messages and a hundred topics.
  constexpr std::int64_t kMostSteps = 1'000'000'000;
  return formats_internal::ReadRos2Recording(path, max_frames, kMostSteps);
}

constexpr std::size_t kMostContents = 12;  // that a message lists
constexpr Kind kKinds[] = {{"#ROSBAG V", formats_internal::ReadBagRecording},
                           {"SQLite format 3", ReadRos2},
                           {"\x89MCAP0\r\n", formats_internal::ReadMcapRecording},
                           {"\x1a\x45\xdf\xa3", formats_internal::ReadMkvRecording}};

std::string FirstBytes(const std::filesystem::path& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return "";
  std::ifstream stream(path, std::ios::binary);
  std::string bytes(16, '\0');
  stream.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(stream.gcount()));
  return bytes;
}

/// Null for a file of another kind.
const Kind* KindOf(const std::string& bytes) {
  for (const Kind& kind : kKinds) {
    if (bytes.rfind(kind.magic, 0) == 0) return &kind;
  }
  return nullptr;
}

}  // namespace

bool IsRecording(const std::filesystem::path& path) { return KindOf(FirstBytes(path)) != nullptr; }

std::vector<RecordedDepth> ReadRecording(const std::filesystem::path& path, int max_frames) {
  const std::string bytes = FirstBytes(path);
  if (bytes.empty()) throw IoError(path.string() + ": cannot be read, or is no file");
  const Kind* const kind = KindOf(bytes);
  if (!kind) {
    throw DataError(
        fmt::format("{}: neither a bag of ROS 1 or 2 (.bag, .db3, .mcap) nor a Matroska file; "
                    "expected a recording of "
                    "these",
                    path.string()));
  }
  formats_internal::Recording recording = kind->read(path, max_frames);
  std::vector<RecordedDepth>& streams = recording.streams;
  if (streams.empty()) {
    std::vector<std::string> contents;
    for (const std::string& content : recording.contents) {
      if (contents.size() == kMostContents) break;
      contents.push_back(Shortened(content));
    }
    throw DataError(fmt::format(
        "{}: the recording has no depth stream with a frame; in it {} {}{}", path.string(),
        contents.size() == 1 ? "is" : "are",
        contents.empty() ? "no images or messages" : fmt::format("{}", fmt::join(contents, ", ")),
        recording.contents.size() > contents.size() ? ", ..." : ""));
  }
  // They are printed.
  for (RecordedDepth& stream : streams) {
    for (std::string* text : {&stream.stream, &stream.device, &stream.serial})
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
                                                            {"femto mega", "orbbec_femto_mega"}};
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
