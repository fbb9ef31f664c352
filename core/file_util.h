#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace volalign {

/// Whole content of a file. Throws IoError, which names the path and the system's reason.
std::string ReadFile(const std::filesystem::path& path);

/// Writes to `path`.tmp-PID in the same folder, syncs and renames, so that a reader never sees half
/// a file. Creates missing parent folders. Without `sync`, a power failure may still lose or empty
/// the file: for many files that are synced together later. Throws IoError.
void WriteFileAtomically(const std::filesystem::path& path, std::string_view bytes,
                         bool sync = true);

/// Lower-case hexadecimal SHA-256 of `bytes` (OpenSSL's EVP).
std::string Sha256(std::string_view bytes);

}  // namespace volalign
