// Depth of a Matroska file of the Azure Kinect's recorder: a track of 16-bit big-endian images, the
// device's raw calibration as an attachment, its serial number as a tag.

#include <ebml/EbmlHead.h>
#include <ebml/EbmlStream.h>
#include <ebml/EbmlVoid.h>
#include <ebml/StdIOCallback.h>
#include <fmt/format.h>
#include <matroska/KaxAttached.h>
#include <matroska/KaxAttachments.h>
#include <matroska/KaxBlock.h>
#include <matroska/KaxCluster.h>
#include <matroska/KaxClusterData.h>
#include <matroska/KaxSegment.h>
#include <matroska/KaxSemantic.h>
#include <matroska/KaxTags.h>
#include <matroska/KaxTracks.h>

#include <algorithm>
#include <cstdint>
#include <exception>
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

namespace mkv = libmatroska;

constexpr double kKinectUnit = 0.001;  // m
constexpr std::uint64_t kMaxElement = std::uint64_t{1} << 28;
constexpr std::uint64_t kMaxTags = std::uint64_t{1} << 15;  // tags hold tags, read by recursion

constexpr std::size_t kMostContents = 100;

struct Track {
  std::uint64_t number = 0;
  std::string name, codec, fourcc;
  int width = 0, height = 0;
  std::vector<StoredDepth> frames;
};

struct Content {
  const std::string& name;  ///< of the file; begins every message
  std::uint64_t file_size = 0;
  std::vector<Track> tracks;         // those of 16-bit grey
  std::string calibration;           // calibration.json
  std::optional<FrameSize> picture;  // of the track COLOR
  std::vector<std::string> contents;
  std::map<std::string, std::string> tags;
};

/// The master's first child of a type; null without any.
template <class T>
const T* Child(const libebml::EbmlMaster& master) {
  return static_cast<const T*>(master.FindElt(EBML_INFO(T)));
}

/// Calls `use` with each child of a type.
template <class T, class Use>
void ForEach(const libebml::EbmlMaster& master, Use use) {
  for (const libebml::EbmlElement* child : master) {
    if (libebml::EbmlId(*child) == EBML_ID(T)) use(*static_cast<const T*>(child));
  }
}

/// libebml keeps an element's stated size, however few bytes the file has. Throws DataError for an
/// element that ends behind the file.
std::string Bytes(const libebml::EbmlBinary* binary, const Content& content) {
  if (!binary || !binary->GetBuffer()) return "";
  const std::uint64_t end = binary->GetElementPosition() + binary->HeadSize() + binary->GetSize();
  if (end > content.file_size) {
    throw DataError(fmt::format("{}: damaged: an element of {} bytes ends behind the file",
                                content.name, binary->GetSize()));
  }
  return std::string(reinterpret_cast<const char*>(binary->GetBuffer()),
                     static_cast<std::size_t>(binary->GetSize()));
}

/// Four letters: biCompression of a BITMAPINFOHEADER, else ColourSpace.
std::string FourCc(const std::string& codec, const std::string& codec_private,
                   const std::string& colour_space) {
  if (codec == "V_MS/VFW/FOURCC" && codec_private.size() >= 20) return codec_private.substr(16, 4);
  return codec == "V_UNCOMPRESSED" ? colour_space : "";
}

void AddTrack(const mkv::KaxTrackEntry& entry, Content* content) {
  const auto* video = Child<mkv::KaxTrackVideo>(entry);
  const auto* number = Child<mkv::KaxTrackNumber>(entry);
  const auto* codec = Child<mkv::KaxCodecID>(entry);
  if (!video || !number || !codec) return;
  Track track;
  track.number = static_cast<std::uint64_t>(*number);
  // A number belongs to one track, or each frame would be kept several times.
  for (const Track& other : content->tracks) {
    if (other.number == track.number) return;
  }
  track.codec = std::string(*codec);
  track.fourcc = FourCc(track.codec, Bytes(Child<mkv::KaxCodecPrivate>(entry), *content),
                        Bytes(Child<mkv::KaxVideoColourSpace>(*video), *content));
  if (const auto* name = Child<mkv::KaxTrackName>(entry))
    track.name = static_cast<const libebml::UTFstring&>(*name).GetUTF8();
  const auto* width = Child<mkv::KaxVideoPixelWidth>(*video);
  const auto* height = Child<mkv::KaxVideoPixelHeight>(*video);
  if (!width || !height) return;
  track.width = static_cast<int>(std::min<std::uint64_t>(*width, 1 << 20));
  track.height = static_cast<int>(std::min<std::uint64_t>(*height, 1 << 20));
  if (content->contents.size() < kMostContents) {
    content->contents.push_back(fmt::format(
        "track {} of {}x{} ({} {})", track.name.empty() ? std::to_string(track.number) : track.name,
        track.width, track.height, track.codec, track.fourcc));
  }
  if (track.name == "COLOR") content->picture = FrameSize{track.width, track.height};
  if (track.fourcc != "b16g" && track.fourcc != "Y16 ") return;
  content->tracks.push_back(std::move(track));
}

/// Keeps DEPTH of tracks with names; the others (IR) are as grey.
void KeepDepthTracks(Content* content) {
  std::vector<Track>& tracks = content->tracks;
  const auto is_depth = [](const Track& track) { return track.name == "DEPTH"; };
  const bool named = std::any_of(tracks.begin(), tracks.end(), is_depth);
  tracks.erase(std::remove_if(tracks.begin(), tracks.end(),
                              [&](const Track& track) {
                                return named ? !is_depth(track) : track.name == "IR";
                              }),
               tracks.end());
}

StoredDepth Decode(const Track& track, const std::uint8_t* bytes, std::size_t size,
                   const std::string& name) {
  RosImage image;
  image.width = static_cast<std::uint32_t>(track.width);
  image.height = static_cast<std::uint32_t>(track.height);
  image.step = 2 * image.width;
  image.encoding = "16UC1";
  image.big_endian = track.fourcc == "b16g";
  image.data = std::string_view(reinterpret_cast<const char*>(bytes), size);
  return DecodeImage(image, name);
}

void AddBlock(const mkv::KaxInternalBlock& const_block, int max_frames, ReadBudget* budget,
              Content* content) {
  auto& block = const_cast<mkv::KaxInternalBlock&>(const_block);  // its getters are not const
  for (Track& track : content->tracks) {
    if (track.number != block.TrackNum()) continue;
    for (unsigned int i = 0; i < block.NumberFrames(); ++i) {
      if (static_cast<int>(track.frames.size()) >= max_frames) return;
      const auto& data = block.GetBuffer(i);
      track.frames.push_back(Decode(track, data.Buffer(), data.Size(), content->name));
      budget->Keep(BytesOf(track.frames.back()), content->name);
    }
  }
}

void AddCluster(const libebml::EbmlMaster& cluster, int max_frames, ReadBudget* budget,
                Content* content) {
  ForEach<mkv::KaxSimpleBlock>(cluster, [&](const mkv::KaxSimpleBlock& block) {
    AddBlock(block, max_frames, budget, content);
  });
  ForEach<mkv::KaxBlockGroup>(cluster, [&](const mkv::KaxBlockGroup& group) {
    if (const auto* block = Child<mkv::KaxBlock>(group))
      AddBlock(*block, max_frames, budget, content);
  });
}

void AddAttachments(const libebml::EbmlMaster& attachments, Content* content) {
  ForEach<mkv::KaxAttached>(attachments, [&](const mkv::KaxAttached& file) {
    const auto* file_name = Child<mkv::KaxFileName>(file);
    if (!file_name ||
        static_cast<const libebml::UTFstring&>(*file_name).GetUTF8() != "calibration.json")
      return;
    content->calibration = Bytes(Child<mkv::KaxFileData>(file), *content);
    // The recorder attaches the device's memory, with the zero that ends it.
    content->calibration.resize(
        std::min(content->calibration.size(), content->calibration.find('\0')));
  });
}

void AddTags(const libebml::EbmlMaster& tags, Content* content) {
  ForEach<mkv::KaxTag>(tags, [&](const mkv::KaxTag& tag) {
    ForEach<mkv::KaxTagSimple>(tag, [&](const mkv::KaxTagSimple& simple) {
      const auto* key = Child<mkv::KaxTagName>(simple);
      const auto* value = Child<mkv::KaxTagString>(simple);
      if (key && value) {
        content->tags[static_cast<const libebml::UTFstring&>(*key).GetUTF8()] =
            static_cast<const libebml::UTFstring&>(*value).GetUTF8();
      }
    });
  });
}

bool HasAllFrames(const Content& content, int max_frames) {
  return !content.tracks.empty() &&
         std::all_of(content.tracks.begin(), content.tracks.end(), [&](const Track& track) {
           return static_cast<int>(track.frames.size()) >= max_frames;
         });
}

/// Adds the content of a part of the segment; irrelevant parts were not read.
void AddPart(const libebml::EbmlMaster& part, int max_frames, ReadBudget* budget,
             Content* content) {
  const libebml::EbmlId id(part);
  if (id == EBML_ID(mkv::KaxTracks)) {
    ForEach<mkv::KaxTrackEntry>(part,
                                [&](const mkv::KaxTrackEntry& entry) { AddTrack(entry, content); });
    KeepDepthTracks(content);
  } else if (id == EBML_ID(mkv::KaxAttachments)) {
    AddAttachments(part, content);
  } else if (id == EBML_ID(mkv::KaxTags)) {
    AddTags(part, content);
  } else {
    AddCluster(part, max_frames, budget, content);
  }
}

bool IsWanted(const libebml::EbmlElement& element, const Content& content, int max_frames) {
  const libebml::EbmlId id(element);
  if (id == EBML_ID(mkv::KaxCluster))
    return !content.tracks.empty() && !HasAllFrames(content, max_frames);
  return id == EBML_ID(mkv::KaxTracks) || id == EBML_ID(mkv::KaxAttachments) ||
         id == EBML_ID(mkv::KaxTags);
}

using Element = std::unique_ptr<libebml::EbmlElement>;

Element FindSegment(libebml::EbmlStream* stream) {
  Element head(stream->FindNextID(EBML_INFO(libebml::EbmlHead), UINT32_MAX));
  if (!head) return nullptr;
  head->SkipData(*stream, EBML_CONTEXT(head));
  while (true) {
    Element segment(stream->FindNextID(EBML_INFO(mkv::KaxSegment), UINT64_MAX));
    if (!segment || libebml::EbmlId(*segment) == EBML_ID(mkv::KaxSegment)) return segment;
    segment->SkipData(*stream, EBML_CONTEXT(segment));
  }
}

/// Throws DataError for a part of the segment that is larger than any recorder writes. A cluster
/// that was written live states no size; it ends at the file's end at the latest.
void RequireBounded(const libebml::EbmlElement& part, std::uint64_t left, const std::string& name) {
  const bool is_cluster = libebml::EbmlId(part) == EBML_ID(mkv::KaxCluster);
  if (!part.IsFiniteSize() && !is_cluster)
    throw DataError(name + ": damaged: a part without a size");
  const bool is_tags = libebml::EbmlId(part) == EBML_ID(mkv::KaxTags);
  const std::uint64_t size = part.IsFiniteSize() ? part.GetSize() : left;
  if (size > (is_tags ? kMaxTags : kMaxElement))
    throw DataError(fmt::format("{}: damaged: a part of {} bytes", name, size));
}

/// libmatroska 1.7 counts the laced frames of a block with a byte. It never passes the 255 that
/// mean 256 frames of one size and would go on for ever. No depth frame is laced; such a block has
/// 255 frames here.
class RecordingFile : public libebml::StdIOCallback {
 public:
  explicit RecordingFile(const std::filesystem::path& path)
      : StdIOCallback(path.c_str(), MODE_READ) {}
  std::uint32_t read(void* buffer, std::size_t size) override {
    const std::uint32_t count = StdIOCallback::read(buffer, size);
    auto* const bytes = static_cast<std::uint8_t*>(buffer);
    // libebml uses bytes that it did not get as if it had read them, so they must not be old
    // memory.
    std::fill(bytes + count, bytes + size, std::uint8_t{0});
    // The track's number of one or two bytes, the time of two, the flags.
    const std::size_t flags = count > 0 && bytes[0] >= 0x80 ? 3 : 4;
    constexpr int kLacing = 0x06, kOfOneSize = 0x04;
    if (reads_blocks && count > flags + 1 && (bytes[flags] & kLacing) == kOfOneSize &&
        bytes[flags + 1] == 255)
      bytes[flags + 1] = 254;
    return count;
  }
  bool reads_blocks = false;
};

Content ReadContent(const std::filesystem::path& path, int max_frames, const std::string& name,
                    ReadBudget* budget) {
  Content content{name, std::filesystem::file_size(path), {}, {}, {}, {}, {}};
  RecordingFile file(path);
  libebml::EbmlStream stream(file);
  const Element segment = FindSegment(&stream);
  if (!segment) throw DataError(name + ": damaged: no Matroska segment");
  int upper = 0;
  Element part(stream.FindNextElement(EBML_CONTEXT(segment), upper, UINT64_MAX, true));
  while (part && upper <= 0) {
    Element beyond;
    if (IsWanted(*part, content, max_frames)) {
      RequireBounded(*part, content.file_size - std::min(content.file_size, file.getFilePointer()),
                     name);
      libebml::EbmlElement* found = nullptr;
      file.reads_blocks = libebml::EbmlId(*part) == EBML_ID(mkv::KaxCluster);
      part->Read(stream, EBML_CONTEXT(part), upper, found, true);
      file.reads_blocks = false;
      // An element found beyond the part belongs to the caller; else the part has it already. One
      // level above its children is the next part.
      if (upper > 0) {
        beyond.reset(found);
        --upper;
      }
      AddPart(static_cast<const libebml::EbmlMaster&>(*part), max_frames, budget, &content);
      if (!content.calibration.empty() && !content.tags.empty() &&
          HasAllFrames(content, max_frames))
        break;
    }
    if (!beyond) beyond.reset(part->SkipData(stream, EBML_CONTEXT(part)));
    if (!beyond) {
      beyond.reset(stream.FindNextElement(EBML_CONTEXT(segment), upper, UINT64_MAX, true));
    }
    part = std::move(beyond);
  }
  return content;
}

std::string KinectKind(int width, int height) {
  if (width == 320 && height == 288) return "azure_kinect_nfov_binned";
  if (width == 640 && height == 576) return "azure_kinect_nfov_unbinned";
  if (width == 512 && height == 512) return "azure_kinect_wfov_binned";
  return width == 1024 && height == 1024 ? "azure_kinect_wfov_unbinned" : "";
}

/// None if the calibration does not have the colour camera's pose, because depth does not need it.
std::optional<ColourCamera> Colour(const Content& content, const std::string& name) {
  try {
    return ParseKinectColour(content.calibration, name + ": calibration.json", content.picture);
  } catch (const DataError&) {
    return std::nullopt;
  }
}

RecordedDepth Describe(const Content& content, Track&& track, const std::string& name) {
  RecordedDepth depth;
  depth.stream = track.name.empty() ? fmt::format("track {}", track.number) : track.name;
  const auto has_kinect_tag = [](const auto& tag) { return tag.first.rfind("K4A_", 0) == 0; };
  if (track.name == "DEPTH" || !content.calibration.empty() ||
      std::any_of(content.tags.begin(), content.tags.end(), has_kinect_tag)) {
    depth.device = "Azure Kinect";
    depth.kind = KinectKind(track.width, track.height);
    depth.depth_scale = kKinectUnit;
    depth.depth_scale_stated = true;
    depth.depth_scale_source = "the Azure Kinect's unit";
  }
  if (const auto serial = content.tags.find("K4A_DEVICE_SERIAL_NUMBER");
      serial != content.tags.end())
    depth.serial = serial->second;
  if (!content.calibration.empty()) {
    try {
      depth.intrinsics = ParseIntrinsicsText(content.calibration, name + ": calibration.json",
                                             {track.width, track.height});
      depth.intrinsics_source = "the attached calibration.json";
      depth.intrinsics_stated = true;
    } catch (const DataError& error) {
      depth.intrinsics_problem = error.what();
    }
    depth.colour = Colour(content, name);
  }
  depth.frames = std::move(track.frames);
  return depth;
}

}  // namespace

Recording ReadMkvRecording(const std::filesystem::path& path, const std::string& name,
                           int max_frames, ReadBudget* budget) {
  try {
    Content content = ReadContent(path, max_frames, name, budget);
    Recording recording;
    recording.contents = content.contents;
    for (Track& track : content.tracks) {
      if (!track.frames.empty())
        recording.streams.push_back(Describe(content, std::move(track), name));
    }
    return recording;
  } catch (const Error&) {
    throw;
  } catch (const std::exception& error) {
    throw DataError(
        fmt::format("{}: not a readable Matroska file: {}", name, Shortened(error.what())));
  }
}

}  // namespace volalign::formats_internal
