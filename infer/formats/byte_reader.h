#pragma once

#include <fmt/format.h>

#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>

#include "core/base/error.h"

namespace volalign::formats_internal {

/// Takes little-endian values off the front of some bytes. Throws DataError, which `name` begins,
/// if there are too few.
class ByteReader {
 public:
  ByteReader(std::string_view bytes, const std::string& name) : bytes_(bytes), name_(name) {}

  std::size_t left() const { return bytes_.size() - at_; }

  std::string_view Take(std::size_t count) {
    if (count > left())
      throw DataError(
          fmt::format("{}: damaged: {} bytes are announced, {} are there", name_, count, left()));
    at_ += count;
    return bytes_.substr(at_ - count, count);
  }
  template <class T>
  T Value() {
    T value;
    std::memcpy(&value, Take(sizeof(T)).data(), sizeof(T));
    return value;
  }
  /// Takes as many bytes as the 32-bit number before them states.
  std::string_view Block() { return Take(Value<std::uint32_t>()); }

 private:
  std::string_view bytes_;
  const std::string& name_;
  std::size_t at_ = 0;
};

}  // namespace volalign::formats_internal
