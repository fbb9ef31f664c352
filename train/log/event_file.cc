#include "train/log/event_file.h"

#include <event.pb.h>
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

/// All supported machines have this byte order.
template <class T>
std::string LittleEndian(T value) {
  std::string bytes(sizeof(T), '\0');
  std::memcpy(bytes.data(), &value, sizeof(T));
  return bytes;
}

double Now() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

tensorboard::Event EventAt(std::int64_t step) {
  tensorboard::Event event;
  event.set_wall_time(Now());
  event.set_step(step);
  return event;
}

/// Appends a value to an event.
tensorboard::Value& Add(const std::string& tag, tensorboard::Event* event) {
  tensorboard::Value& value = *event->mutable_summary()->add_value();
  value.set_tag(tag);
  return value;
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
  tensorboard::Event version;
  version.set_wall_time(now);
  version.set_file_version("brain.Event:2");
  Write(version.SerializeAsString());
}

void EventFile::Restart(std::int64_t step) {
  tensorboard::Event event = EventAt(step);
  event.mutable_session_log()->set_status(tensorboard::SessionLog::START);
  Write(event.SerializeAsString());
}

void EventFile::Scalars(std::int64_t step,
                        const std::vector<std::pair<std::string, double>>& values) {
  tensorboard::Event event = EventAt(step);
  for (const auto& [tag, value] : values)
    Add(tag, &event).set_simple_value(static_cast<float>(value));
  Write(event.SerializeAsString());
}

void EventFile::Picture(std::int64_t step, const std::string& tag, const RgbImage& picture) {
  constexpr int kRgb = 3;
  tensorboard::Event event = EventAt(step);
  tensorboard::Image& image = *Add(tag, &event).mutable_image();
  image.set_height(picture.height());
  image.set_width(picture.width());
  image.set_colorspace(kRgb);
  image.set_encoded_image_string(EncodePng(picture));
  Write(event.SerializeAsString());
}

void EventFile::Text(std::int64_t step, const std::string& tag, const std::string& markdown) {
  constexpr int kString = 7, kTensorClass = 2;
  tensorboard::Event event = EventAt(step);
  tensorboard::Value& value = Add(tag, &event);
  value.mutable_metadata()->mutable_plugin_data()->set_plugin_name("text");
  value.mutable_metadata()->set_data_class(kTensorClass);
  value.mutable_tensor()->set_dtype(kString);
  value.mutable_tensor()->mutable_tensor_shape()->add_dim()->set_size(1);
  value.mutable_tensor()->add_string_val(markdown);
  Write(event.SerializeAsString());
}

void EventFile::Write(const std::string& event) {
  const std::string length = LittleEndian<std::uint64_t>(event.size());
  file_ << length << MaskedCrc(length) << event << MaskedCrc(event) << std::flush;
  if (!file_) {
    throw IoError(fmt::format("{}: writing failed: is the disk full?", path_.string()));
  }
}

}  // namespace volalign
