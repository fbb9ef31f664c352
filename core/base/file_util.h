#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace volalign {

/// Whole content of a file. Throws IoError, which names the path and the reason: the system's, or
/// that it is a folder, a device or a pipe, which may never end, or larger than `max_bytes`.
/// The limit of each kind of file is in core/base/file_limits.h.
std::string ReadFile(const std::filesystem::path& path, std::uint64_t max_bytes);

/// Throws IoError where something other than a file is at `path`: a folder, a device or a pipe,
/// which a rename would replace.
void RequirePlace(const std::filesystem::path& path);

/// Writes to a new file `path`.tmp-PID-N in the same folder, syncs and renames it and syncs the
/// folder, so that a reader never sees half a file, and of several writers of one path one wins
/// whole. Creates missing parent folders. Without `sync`, a power failure may still lose or empty
/// the file: for many files that are synced together later. Throws IoError, also as RequirePlace.
void WriteFileAtomically(const std::filesystem::path& path, std::string_view bytes,
                         bool sync = true);

std::string Base64(std::string_view bytes);

/// Lower-case hexadecimal SHA-256 of `bytes` (OpenSSL's EVP).
std::string Sha256(std::string_view bytes);

}  // namespace volalign
