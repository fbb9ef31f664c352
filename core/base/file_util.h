#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace volalign {

/// Whole content of a file. Throws IoError with the path and the reason: the system's, a size above
/// `max_bytes`, or that it is a folder, a device or a pipe, which may never end. The limits of each
/// kind of file are in core/base/file_limits.h.
std::string ReadFile(const std::filesystem::path& path, std::uint64_t max_bytes);

/// Throws IoError if a folder, a device or a pipe is at `path`: a rename would replace it.
void RequirePlace(const std::filesystem::path& path);

/// Writes a new file `path`.tmp-PID-N in the same folder, syncs it, renames it and syncs the
/// folder. So a reader never sees half a file, and one of several writers of one path wins whole.
/// Creates missing parent folders. Without `sync`, a power failure may lose or empty the file: for
/// many files that are synced together later. Throws IoError, also as RequirePlace.
void WriteFileAtomically(const std::filesystem::path& path, std::string_view bytes,
                         bool sync = true);

std::string Base64(std::string_view bytes);

/// Lower-case hexadecimal SHA-256 of `bytes` (OpenSSL's EVP).
std::string Sha256(std::string_view bytes);

}  // namespace volalign
