#include "infer/formats/ros_bag.h"

#include <bzlib.h>
#include <fmt/format.h>

#include <utility>

#include "core/base/error.h"
#include "core/base/text.h"
#include "infer/formats/byte_reader.h"
#include "infer/formats/ros_depth.h"
#include "infer/formats/unpack.h"

namespace volalign::formats_internal {

namespace {

constexpr char kMagic[] = "#ROSBAG V2.0\n";
constexpr std::uint32_t kMaxChunk = std::uint32_t{1} << 28;  // bytes, packed or unpacked
constexpr std::uint32_t kMaxHeader = std::uint32_t{1} << 20;
constexpr std::size_t kMaxConnections = 1000;

// The kind of a record: its header's field "op".
enum Op : std::uint8_t { kMessage = 2, kBagHeader = 3, kChunk = 5, kConnection = 7 };

using Fields = RosBag::Fields;

Fields ParseFields(std::string_view header, const std::string& name) {
  Fields fields;
  ByteReader reader(header, name);
  while (reader.left() > 0) {
    const std::string_view field = reader.Block();
    const std::size_t equals = field.find('=');
    if (equals == std::string_view::npos) throw DataError(name + ": damaged: a field without =");
    fields[std::string(field.substr(0, equals))] = std::string(field.substr(equals + 1));
  }
  return fields;
}

template <class T>
T Field(const Fields& fields, const std::string& key, const std::string& name) {
  const auto found = fields.find(key);
  if (found == fields.end() || found->second.size() != sizeof(T))
    throw DataError(fmt::format("{}: damaged: a record without {}", name, key));
  T value;
  std::memcpy(&value, found->second.data(), sizeof(T));
  return value;
}

std::string TextField(const Fields& fields, const std::string& key) {
  const auto found = fields.find(key);
  return found == fields.end() ? "" : found->second;
}

std::string UnpackBz2(const std::string& packed, std::uint32_t size, const std::string& name) {
  std::string bytes(size, '\0');
  unsigned int length = size;
  if (BZ2_bzBuffToBuffDecompress(bytes.data(), &length, const_cast<char*>(packed.data()),
                                 static_cast<unsigned int>(packed.size()), 0, 0) != BZ_OK ||
      length != size) {
    throw DataError(name + ": damaged: a bz2 chunk cannot be unpacked");
  }
  return bytes;
}

std::string Unpack(const Fields& header, std::string data, const std::string& name,
                   ReadBudget* budget) {
  const std::string compression = TextField(header, "compression");
  const auto size = Field<std::uint32_t>(header, "size", name);
  if (size > kMaxChunk)
    throw DataError(fmt::format("{}: damaged: a chunk of {} bytes", name, size));
  budget->Unpack(size, name);
  if (compression == "none") return data;
  if (compression == "bz2") return UnpackBz2(data, size, name);
  if (compression == "lz4") return UnpackLz4(data, size, name);
  throw DataError(fmt::format("{}: chunks are packed by \"{}\", which is unknown", name,
                              Shortened(compression)));
}

}  // namespace

struct RosBag::Record {
  std::uint8_t op = 0;
  Fields header;
  std::string data;
};

RosBag::RosBag(const std::filesystem::path& path, std::string name, ReadBudget* budget)
    : name_(std::move(name)), budget_(budget) {
  std::error_code error;
  size_ = std::filesystem::file_size(path, error);
  stream_.open(path, std::ios::binary);
  if (error || !stream_) throw IoError(name_ + ": cannot be read");
  std::string magic(sizeof(kMagic) - 1, '\0');
  stream_.read(magic.data(), static_cast<std::streamsize>(magic.size()));
  if (magic != kMagic)
    throw DataError(name_ + ": a bag of another version than 2.0; `rosbag fix` writes 2.0");
  at_ = magic.size();
  Record first;
  if (!ReadRecord(&first) || first.op != kBagHeader)
    throw DataError(name_ + ": damaged: no header");
  first_record_ = at_;
  // 0 if the recorder was killed: connections are then in the chunks alone.
  at_ = Field<std::uint64_t>(first.header, "index_pos", name_);
  Record record;
  while (at_ >= first_record_ && at_ < size_ && ReadRecord(&record) && record.op == kConnection)
    AddConnection(record.header, record.data);
  has_index_ = !connections_.empty();
}

bool RosBag::ReadRecord(Record* record) {
  if (at_ >= size_) return false;
  stream_.clear();
  stream_.seekg(static_cast<std::streamoff>(at_));
  const auto block = [&](std::string* bytes, std::uint32_t most) {
    std::uint32_t length = 0;
    stream_.read(reinterpret_cast<char*>(&length), sizeof(length));
    at_ += sizeof(length);
    if (!stream_ || length > size_ - at_) return false;
    if (length > most)
      throw DataError(fmt::format("{}: damaged: a record of {} bytes", name_, length));
    bytes->resize(length);
    stream_.read(bytes->data(), length);
    at_ += length;
    return static_cast<bool>(stream_);
  };
  std::string header;
  // A recording that was cut off ends in the middle of a record; the whole records still serve.
  if (!block(&header, kMaxHeader) || !block(&record->data, kMaxChunk)) {
    at_ = size_;
    return false;
  }
  record->header = ParseFields(header, name_);
  record->op = Field<std::uint8_t>(record->header, "op", name_);
  return true;
}

void RosBag::AddConnection(const Fields& header, std::string_view data) {
  connections_[Field<std::uint32_t>(header, "conn", name_)] = {
      BoundedText(TextField(header, "topic"), name_, kMostTopicBytes),
      BoundedText(TextField(ParseFields(data, name_), "type"), name_, kMostTopicBytes)};
  if (connections_.size() > kMaxConnections) {
    throw DataError(
        fmt::format("{}: more than the {} topics that are read of a bag", name_, kMaxConnections));
  }
}

bool RosBag::VisitChunk(const Record& chunk, const Visit& visit) {
  const std::string bytes = Unpack(chunk.header, chunk.data, name_, budget_);
  ByteReader reader(bytes, name_);
  while (reader.left() > 0) {
    budget_->Unpack(kRecordCost, name_);
    const Fields header = ParseFields(reader.Block(), name_);
    const std::string_view data = reader.Block();
    const auto op = Field<std::uint8_t>(header, "op", name_);
    if (op == kConnection) {
      AddConnection(header, data);
    } else if (op == kMessage) {
      const auto found = connections_.find(Field<std::uint32_t>(header, "conn", name_));
      if (found == connections_.end())
        throw DataError(name_ + ": damaged: a message of an unknown connection");
      if (!visit(found->second, data)) return false;
    }
  }
  return true;
}

void RosBag::ForEachMessage(const Visit& visit) {
  at_ = first_record_;
  Record record;
  while (ReadRecord(&record)) {
    if (record.op == kConnection) AddConnection(record.header, record.data);
    if (record.op == kChunk && !VisitChunk(record, visit)) return;
  }
}

}  // namespace volalign::formats_internal
