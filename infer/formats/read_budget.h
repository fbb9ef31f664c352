#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <set>
#include <string>
#include <utility>

namespace volalign {

/// Cost of a record beside its bytes, in bytes that could be unpacked in that time.
inline constexpr std::uint64_t kRecordCost = 256;

/// The limit on the cost of reading one recording, or a whole capture, whose readers share it. Each
/// part of a file has a limit of its own; this is the limit of all of them together.
class ReadBudget {
 public:
  /// Bytes allowed for any file, for each count. A file's own size allows more.
  static constexpr std::uint64_t kBase = std::uint64_t{1} << 30;

  explicit ReadBudget(std::uint64_t base = kBase) : allowed_(base) {}

  /// Allows as much more as a file of this size may contain. A file counts once, and with its size
  /// on the disk, so that neither repeats nor holes allow anything.
  void Open(const std::filesystem::path& path);

  /// Counts bytes that are unpacked or passed, and thereby time. False beyond the limit.
  bool Spend(std::uint64_t bytes);
  /// The same before the bytes are unpacked. Throws DataError, which `name` begins.
  void Unpack(std::uint64_t bytes, const std::string& name);

  /// Counts bytes before they are kept in memory. Throws DataError, which `name` begins.
  void Keep(std::uint64_t bytes, const std::string& name);
  /// Subtracts kept bytes that are released.
  void Drop(std::uint64_t bytes) { kept_ -= bytes; }
  std::uint64_t kept() const { return kept_; }

 private:
  std::uint64_t allowed_, spent_ = 0, kept_ = 0;
  std::set<std::pair<std::uint64_t, std::uint64_t>> files_;  // device and number
};

}  // namespace volalign
