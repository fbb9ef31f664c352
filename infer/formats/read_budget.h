#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <set>
#include <string>
#include <utility>

namespace volalign {

/// What a record costs beside its bytes, in bytes that could be unpacked in that time.
inline constexpr std::uint64_t kRecordCost = 256;

/// What reading may cost: of one recording, or of a whole capture, whose readers share it. Each
/// part of a file has a limit of its own; this is the limit of all of them together.
class ReadBudget {
 public:
  /// Allowed for any file, and of each count: bytes. A file's own size allows more.
  static constexpr std::uint64_t kBase = std::uint64_t{1} << 30;

  explicit ReadBudget(std::uint64_t base = kBase) : allowed_(base) {}

  /// Allows as much more as a file of this size may hold. A file counts once, and with what it has
  /// on the disk, so that neither repeating it nor its holes allow anything.
  void Open(const std::filesystem::path& path);

  /// Counts bytes that are unpacked or gone through, and thereby time. False beyond what is
  /// allowed.
  bool Spend(std::uint64_t bytes);
  /// The same before the bytes are unpacked. Throws DataError, which `name` begins.
  void Unpack(std::uint64_t bytes, const std::string& name);

  /// Counts bytes before they are kept in memory. Throws DataError, which `name` begins.
  void Keep(std::uint64_t bytes, const std::string& name);
  /// Of what was kept, these are let go.
  void Drop(std::uint64_t bytes) { kept_ -= bytes; }
  std::uint64_t kept() const { return kept_; }

 private:
  std::uint64_t allowed_, spent_ = 0, kept_ = 0;
  std::set<std::pair<std::uint64_t, std::uint64_t>> files_;  // device and number
};

}  // namespace volalign
