// OpenEXR by its own library.

#include <ImathBox.h>
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputFile.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <exception>
#include <filesystem>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/base/text.h"
#include "infer/formats/depth_file.h"

namespace volalign::formats_internal {

namespace {

/// Throws DataError for an attribute that is larger than the file, because OpenEXR takes the memory
/// before it reads. The file layout (openexr.com) is name, type, size, value; an empty name ends a
/// header.
void RequireAttributesInside(const std::string& bytes, const std::string& name) {
  constexpr std::size_t kHeadersAt = 8;
  constexpr unsigned int kMultiPart = 0x10;  // of the version's second byte
  std::size_t at = kHeadersAt;
  const auto skip_text = [&] {
    const std::size_t end = bytes.find('\0', at);
    const bool empty = end == at;
    at = end == std::string::npos ? bytes.size() : end + 1;
    return !empty;
  };
  const auto skip_header = [&] {
    bool any = false;
    while (at < bytes.size() && skip_text()) {
      any = true;
      skip_text();
      std::uint32_t size = 0;
      if (bytes.size() - at < sizeof(size)) throw DataError(name + ": truncated OpenEXR");
      std::memcpy(&size, bytes.data() + at, sizeof(size));
      at += sizeof(size);
      if (size > bytes.size() - at)
        throw DataError(fmt::format("{}: truncated OpenEXR: an attribute of {} bytes", name, size));
      at += size;
    }
    return any;
  };
  const bool several = bytes.size() > kHeadersAt && (bytes[5] & kMultiPart) != 0;
  while (skip_header() && several) {
  }
}

/// "View Layer.Depth.Z" -> "Z".
std::string LastPart(const std::string& channel) {
  const std::size_t dot = channel.rfind('.');
  return dot == std::string::npos ? channel : channel.substr(dot + 1);
}

/// The channels that may be depth. The first is to be read, the others have to equal it.
std::vector<std::string> DepthChannels(const Imf::ChannelList& list, const std::string& name) {
  std::vector<std::string> all;
  for (auto it = list.begin(); it != list.end(); ++it) all.emplace_back(it.name());
  if (all.size() == 1) return all;
  for (const char* word : {"Z", "Y", "V"}) {
    std::vector<std::string> named;
    std::copy_if(all.begin(), all.end(), std::back_inserter(named),
                 [&](const std::string& channel) { return LastPart(channel) == word; });
    if (named.size() == 1) return named;
  }
  std::vector<std::string> grey = {"R", "G", "B"};
  if (all.size() <= 4 && std::all_of(grey.begin(), grey.end(), [&](const std::string& channel) {
        return std::find(all.begin(), all.end(), channel) != all.end();
      })) {
    return grey;
  }
  throw DataError(fmt::format(
      "{}: none of the channels {} is the only one, nor named Z, Y or V; write depth alone", name,
      Shortened(fmt::format("{}", fmt::join(all, ", ")))));
}

Image<float> ReadChannel(Imf::InputFile& file, const std::string& channel, int width, int height) {
  const Imath::Box2i window = file.header().dataWindow();
  Image<float> values(width, height);
  Imf::FrameBuffer buffer;
  buffer.insert(channel, Imf::Slice::Make(Imf::FLOAT, values.data(), window, sizeof(float),
                                          sizeof(float) * static_cast<std::size_t>(width)));
  file.setFrameBuffer(buffer);
  file.readPixels(window.min.y, window.max.y);
  return values;
}

}  // namespace

StoredDepth ReadExr(const std::filesystem::path& path, const std::string& bytes) {
  const std::string name = path.string();
  try {
    RequireAttributesInside(bytes, name);
    Imf::InputFile file(name.c_str());
    const Imath::Box2i window = file.header().dataWindow();
    const long long width = 1LL + window.max.x - window.min.x;
    const long long height = 1LL + window.max.y - window.min.y;
    RequireSize(width, height, name);
    const std::vector<std::string> channels = DepthChannels(file.header().channels(), name);
    StoredDepth depth;
    depth.whole_numbers = file.header().channels()[channels[0].c_str()].type == Imf::UINT;
    const int w = static_cast<int>(width), h = static_cast<int>(height);
    depth.values = ReadChannel(file, channels[0], w, h);
    for (std::size_t i = 1; i < channels.size(); ++i) {
      if (!(ReadChannel(file, channels[i], w, h) == depth.values))
        throw DataError(fmt::format("{}: R, G and B differ: a colour image, not depth", name));
    }
    return depth;
  } catch (const DataError&) {
    throw;
  } catch (const std::exception& error) {
    const std::string text = error.what();
    throw DataError(fmt::format("{}: not a readable OpenEXR image: {}", name,
                                Shortened(text.substr(0, text.find('\n')))));
  }
}

}  // namespace volalign::formats_internal
