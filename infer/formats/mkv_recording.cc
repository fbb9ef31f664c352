// Depth of a Matroska file of the Azure Kinect's recorder: a track of 16-bit big-endian images, the
// device's raw calibration as an attachment, its serial number as a tag. Read by FFmpeg's demuxer.

extern "C" {
#include <libavcodec/packet.h>
#include <libavformat/avformat.h>
#include <libavutil/dict.h>
#include <libavutil/log.h>
}
#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <map>
#include <memory>

#include "core/base/error.h"
#include "core/base/text.h"
#include "infer/formats/intrinsics_file.h"
#include "infer/formats/kinect_calibration.h"
#include "infer/formats/recording.h"
#include "infer/formats/ros_depth.h"

namespace volalign::formats_internal {

namespace {

constexpr double kKinectUnit = 0.001;  // m

/// FFmpeg prints what it dislikes, whatever it returns.
class SilentFfmpeg {
 public:
  SilentFfmpeg() { av_log_set_level(AV_LOG_QUIET); }
  ~SilentFfmpeg() { av_log_set_level(level_); }
  SilentFfmpeg(const SilentFfmpeg&) = delete;
  SilentFfmpeg& operator=(const SilentFfmpeg&) = delete;

 private:
  int level_ = av_log_get_level();
};

std::string Tag(const AVDictionary* tags, const char* key) {
  const AVDictionaryEntry* const tag = av_dict_get(tags, key, nullptr, 0);
  return tag ? tag->value : "";
}

struct File {
  const std::string& name;  ///< begins every message
  std::unique_ptr<AVFormatContext, void (*)(AVFormatContext*)> context;

  std::string TitleOf(int stream) const { return Tag(context->streams[stream]->metadata, "title"); }
  const AVCodecParameters& ParametersOf(int stream) const {
    return *context->streams[stream]->codecpar;
  }
};

File Open(const std::filesystem::path& path, const std::string& name) {
  AVFormatContext* context = nullptr;
  const int status = avformat_open_input(&context, ("file:" + path.string()).c_str(),
                                         av_find_input_format("matroska"), nullptr);
  if (status < 0) {
    char text[AV_ERROR_MAX_STRING_SIZE] = {};
    throw DataError(fmt::format("{}: damaged: not a readable Matroska file: {}", name,
                                av_make_error_string(text, sizeof(text), status)));
  }
  return {name, {context, [](AVFormatContext* open) { avformat_close_input(&open); }}};
}

std::string FourCc(const AVCodecParameters& parameters) {
  char text[AV_FOURCC_MAX_STRING_SIZE] = {};
  return av_fourcc_make_string(text, parameters.codec_tag);
}

/// Those of 16-bit grey: DEPTH alone if a track has that name, else all but IR. The others are
/// passed over.
std::vector<int> DepthTracks(const File& file) {
  std::vector<int> grey;
  for (int i = 0; i < static_cast<int>(file.context->nb_streams); ++i) {
    const std::string fourcc = FourCc(file.ParametersOf(i));
    if (fourcc == "b16g" || fourcc == "Y16 ") grey.push_back(i);
    file.context->streams[i]->discard = AVDISCARD_ALL;
  }
  const auto is_depth = [&](int track) { return file.TitleOf(track) == "DEPTH"; };
  const bool named = std::any_of(grey.begin(), grey.end(), is_depth);
  std::vector<int> tracks;
  std::copy_if(grey.begin(), grey.end(), std::back_inserter(tracks),
               [&](int track) { return named ? is_depth(track) : file.TitleOf(track) != "IR"; });
  for (const int track : tracks) file.context->streams[track]->discard = AVDISCARD_DEFAULT;
  return tracks;
}

StoredDepth Decode(const AVCodecParameters& track, const AVPacket& packet,
                   const std::string& name) {
  RosImage image;
  image.width = static_cast<std::uint32_t>(track.width);
  image.height = static_cast<std::uint32_t>(track.height);
  image.step = 2 * image.width;
  image.encoding = "16UC1";
  image.big_endian = FourCc(track) == "b16g";
  image.data = std::string_view(reinterpret_cast<const char*>(packet.data),
                                static_cast<std::size_t>(packet.size));
  return DecodeImage(image, name);
}

/// The first frames of each of the tracks.
std::map<int, std::vector<StoredDepth>> ReadFrames(const File& file, const std::vector<int>& tracks,
                                                   int max_frames, ReadBudget* budget) {
  std::map<int, std::vector<StoredDepth>> frames;
  const auto is_full = [&](int track) {
    return static_cast<int>(frames[track].size()) >= max_frames;
  };
  const std::unique_ptr<AVPacket, void (*)(AVPacket*)> packet(
      av_packet_alloc(), [](AVPacket* used) { av_packet_free(&used); });
  while (!std::all_of(tracks.begin(), tracks.end(), is_full) &&
         av_read_frame(file.context.get(), packet.get()) >= 0) {
    const int track = packet->stream_index;
    const bool wanted = std::find(tracks.begin(), tracks.end(), track) != tracks.end();
    if (wanted && !is_full(track)) {
      frames[track].push_back(Decode(file.ParametersOf(track), *packet, file.name));
      budget->Keep(BytesOf(frames[track].back()), file.name);
    }
    av_packet_unref(packet.get());
  }
  return frames;
}

/// The attached calibration.json. The recorder attaches the device's memory, with the zero that
/// ends it.
std::string Calibration(const File& file) {
  for (unsigned int i = 0; i < file.context->nb_streams; ++i) {
    const AVStream& stream = *file.context->streams[i];
    if (Tag(stream.metadata, "filename") != "calibration.json") continue;
    const std::string text(reinterpret_cast<const char*>(stream.codecpar->extradata),
                           static_cast<std::size_t>(stream.codecpar->extradata_size));
    return text.substr(0, text.find('\0'));
  }
  return "";
}

/// None if the calibration does not have the colour camera's pose, because depth does not need it.
std::optional<ColourCamera> Colour(const File& file, const std::string& calibration,
                                   const std::string& place) {
  std::optional<ImageSize> picture;
  for (int i = 0; i < static_cast<int>(file.context->nb_streams); ++i) {
    if (file.TitleOf(i) == "COLOR")
      picture = ImageSize{file.ParametersOf(i).width, file.ParametersOf(i).height};
  }
  try {
    return ParseKinectColour(calibration, place, picture);
  } catch (const DataError&) {
    return std::nullopt;
  }
}

RecordedDepth Describe(const File& file, int track, const std::string& calibration) {
  const ImageSize size{file.ParametersOf(track).width, file.ParametersOf(track).height};
  const std::string title = file.TitleOf(track);
  RecordedDepth depth;
  depth.stream = title.empty() ? fmt::format("track {}", track + 1) : title;
  if (title == "DEPTH" || !calibration.empty() ||
      av_dict_get(file.context->metadata, "K4A_", nullptr, AV_DICT_IGNORE_SUFFIX)) {
    depth.device = "Azure Kinect";
    depth.kind = KinectKind(size);
    depth.StateScale(kKinectUnit, "the Azure Kinect's unit");
  }
  depth.serial = Tag(file.context->metadata, "K4A_DEVICE_SERIAL_NUMBER");
  if (calibration.empty()) return depth;
  const std::string place = file.name + ": calibration.json";
  depth.StateIntrinsics("the attached calibration.json",
                        [&] { return ParseIntrinsicsText(calibration, place, size); });
  depth.colour = Colour(file, calibration, place);
  return depth;
}

}  // namespace

Recording ReadMkvRecording(const std::filesystem::path& path, const std::string& name,
                           int max_frames, ReadBudget* budget) {
  const SilentFfmpeg silent;
  const File file = Open(path, name);
  Recording recording;
  for (int i = 0; i < static_cast<int>(file.context->nb_streams); ++i) {
    const AVCodecParameters& track = file.ParametersOf(i);
    if (track.codec_type != AVMEDIA_TYPE_VIDEO) continue;
    recording.contents.push_back(fmt::format("track {} {} of {}x{} ({})", i + 1, file.TitleOf(i),
                                             track.width, track.height, FourCc(track)));
  }
  const std::string calibration = Calibration(file);
  for (auto& [track, frames] : ReadFrames(file, DepthTracks(file), max_frames, budget)) {
    if (frames.empty()) continue;
    recording.streams.push_back(Describe(file, track, calibration));
    recording.streams.back().frames = std::move(frames);
  }
  return recording;
}

}  // namespace volalign::formats_internal
