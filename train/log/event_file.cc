#include "train/log/event_file.h"

#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstring>

#include "core/base/error.h"
#include "core/base/folder.h"
#include "core/formats/image_io.h"

namespace volalign {
namespace {

// Field numbers of tensorflow/core/util/event.proto and
// framework/{summary,tensor,tensor_shape}.proto.
enum EventField { kWallTime = 1, kStep = 2, kFileVersion = 3, kSummary = 5, kSessionLog = 7 };
enum SessionLogField { kStatus = 1 };
enum SummaryField { kValue = 1 };
enum ValueField { kTag = 1, kSimpleValue = 2, kImage = 4, kTensor = 8, kMetadata = 9 };
enum ImageField { kHeight = 1, kWidth = 2, kColourSpace = 3, kEncoded = 4 };
enum MetadataField { kPluginData = 1, kDataClass = 4 };
enum PluginField { kPluginName = 1 };
enum TensorField { kType = 1, kShape = 2, kStringValue = 8 };
enum ShapeField { kDimension = 2 };
enum DimensionField { kSize = 1 };
constexpr int kStatusStart = 1, kRgb = 3, kStringType = 7, kTensorClass = 2;

/// All supported machines have this byte order.
template <class T>
std::string LittleEndian(T value) {
  std::string bytes(sizeof(T), '\0');
  std::memcpy(bytes.data(), &value, sizeof(T));
  return bytes;
}

/// A protocol buffer's message, field by field.
class Message {
 public:
  Message& Integer(int field, std::int64_t value) {
    Varint(static_cast<std::uint64_t>(field) << 3);
    Varint(static_cast<std::uint64_t>(value));
    return *this;
  }
  Message& Double(int field, double value) {
    Varint(static_cast<std::uint64_t>(field) << 3 | 1);
    return Raw(value);
  }
  Message& Float(int field, float value) {
    Varint(static_cast<std::uint64_t>(field) << 3 | 5);
    return Raw(value);
  }
  Message& Bytes(int field, std::string_view bytes) {
    Varint(static_cast<std::uint64_t>(field) << 3 | 2);
    Varint(bytes.size());
    bytes_.append(bytes);
    return *this;
  }
  Message& Nested(int field, const Message& message) { return Bytes(field, message.bytes_); }
  const std::string& bytes() const { return bytes_; }

 private:
  void Varint(std::uint64_t value) {
    for (; value >= 128; value >>= 7) bytes_.push_back(static_cast<char>((value & 127) | 128));
    bytes_.push_back(static_cast<char>(value));
  }
  template <class T>
  Message& Raw(T value) {
    bytes_ += LittleEndian(value);
    return *this;
  }

  std::string bytes_;
};

double Now() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

Message Event(std::int64_t step) {
  Message event;
  event.Double(kWallTime, Now()).Integer(kStep, step);
  return event;
}

std::string HostName() {
  std::array<char, 256> name{};
  return ::gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "host";
}

std::array<std::uint32_t, 256> CrcTable() {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t i = 0; i < table.size(); ++i) {
    std::uint32_t crc = i;
    for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ ((crc & 1) != 0 ? 0x82f63b78U : 0U);
    table[i] = crc;
  }
  return table;
}

std::string MaskedCrc(std::string_view bytes) {
  const std::uint32_t crc = Crc32c(bytes);
  return LittleEndian<std::uint32_t>((crc >> 15 | crc << 17) + 0xa282ead8U);
}

}  // namespace

std::uint32_t Crc32c(std::string_view bytes) {
  static const std::array<std::uint32_t, 256> table = CrcTable();
  std::uint32_t crc = 0xffffffffU;
  for (const char c : bytes) crc = table[(crc ^ static_cast<unsigned char>(c)) & 255U] ^ crc >> 8;
  return ~crc;
}

EventFile::EventFile(const std::filesystem::path& folder) {
  MakeFolder(folder);
  const double now = Now();
  do {
    static int number = 0;
    path_ = folder / fmt::format("events.out.tfevents.{:017.6f}.{}.{}.{}", now, HostName(),
                                 ::getpid(), number++);
  } while (std::filesystem::exists(path_));
  file_.open(path_, std::ios::binary);
  Message version;
  Write(version.Double(kWallTime, now).Bytes(kFileVersion, "brain.Event:2").bytes());
}

void EventFile::Restart(std::int64_t step) {
  Write(Event(step).Nested(kSessionLog, Message().Integer(kStatus, kStatusStart)).bytes());
}

void EventFile::Scalars(std::int64_t step,
                        const std::vector<std::pair<std::string, double>>& values) {
  Message summary;
  for (const auto& [tag, value] : values) {
    summary.Nested(kValue,
                   Message().Bytes(kTag, tag).Float(kSimpleValue, static_cast<float>(value)));
  }
  Write(Event(step).Nested(kSummary, summary).bytes());
}

void EventFile::Picture(std::int64_t step, const std::string& tag, const RgbImage& picture) {
  Message image;
  image.Integer(kHeight, picture.height())
      .Integer(kWidth, picture.width())
      .Integer(kColourSpace, kRgb)
      .Bytes(kEncoded, EncodePng(picture));
  const Message value = Message().Bytes(kTag, tag).Nested(kImage, image);
  Write(Event(step).Nested(kSummary, Message().Nested(kValue, value)).bytes());
}

void EventFile::Text(std::int64_t step, const std::string& tag, const std::string& markdown) {
  Message metadata, tensor;
  metadata.Nested(kPluginData, Message().Bytes(kPluginName, "text"))
      .Integer(kDataClass, kTensorClass);
  tensor.Integer(kType, kStringType)
      .Nested(kShape, Message().Nested(kDimension, Message().Integer(kSize, 1)))
      .Bytes(kStringValue, markdown);
  const Message value =
      Message().Bytes(kTag, tag).Nested(kTensor, tensor).Nested(kMetadata, metadata);
  Write(Event(step).Nested(kSummary, Message().Nested(kValue, value)).bytes());
}

void EventFile::Write(const std::string& event) {
  const std::string length = LittleEndian<std::uint64_t>(event.size());
  file_ << length << MaskedCrc(length) << event << MaskedCrc(event) << std::flush;
  if (!file_) {
    throw IoError(fmt::format("{}: writing failed: is the disk full?", path_.string()));
  }
}

}  // namespace volalign
