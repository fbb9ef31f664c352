#include "infer/formats/unpack.h"

#include <fmt/format.h>
#include <lz4frame.h>
#include <unistd.h>
#include <zstd.h>

#include <cstdlib>
#include <fstream>
#include <memory>

#include "core/base/error.h"

namespace volalign::formats_internal {

namespace {

constexpr std::string_view kZstdMagic = "\x28\xb5\x2f\xfd";

/// Unpacks the pieces of `next` until it gives none, and passes them to `use` until that returns
/// false. False if the end is missing or damaged, or if pieces give nothing, as those of a hole in
/// the file: a block is not longer than a piece.
template <class Next, class Use>
bool StreamZstd(const Next& next, const Use& use) {
  const std::unique_ptr<ZSTD_DStream, std::size_t (*)(ZSTD_DStream*)> stream(ZSTD_createDStream(),
                                                                             ZSTD_freeDStream);
  std::string piece(ZSTD_DStreamOutSize(), '\0');
  std::size_t left = 1;  // 0: a frame is complete
  int without = 0;       // pieces since the last that gave something
  for (std::string_view bytes = next(); !bytes.empty(); bytes = next()) {
    if (++without > 3) return false;
    ZSTD_inBuffer in{bytes.data(), bytes.size(), 0};
    bool full = true;  // of a full piece more may follow without more input
    while (in.pos < in.size || full) {
      ZSTD_outBuffer out{piece.data(), piece.size(), 0};
      const std::size_t before = in.pos;
      left = ZSTD_decompressStream(stream.get(), &out, &in);
      if (ZSTD_isError(left)) return false;
      if (out.pos > 0) without = 0;
      if (out.pos > 0 && !use(std::string_view(piece.data(), out.pos))) return true;
      full = out.pos == out.size;
      if (in.pos == before && out.pos == 0) break;
    }
  }
  return left == 0;
}

/// Gives the pieces of a file.
class Pieces {
 public:
  explicit Pieces(const std::filesystem::path& path) : stream_(path, std::ios::binary) {}
  std::string_view Next() {
    stream_.read(buffer_.data(), static_cast<std::streamsize>(buffer_.size()));
    return std::string_view(buffer_).substr(0, static_cast<std::size_t>(stream_.gcount()));
  }

 private:
  std::ifstream stream_;
  std::string buffer_ = std::string(ZSTD_DStreamInSize(), '\0');
};

[[noreturn]] void FailDamaged(const std::string& name) {
  throw DataError(name + ": damaged: what zstd packed cannot be unpacked");
}

}  // namespace

std::string UnpackLz4(std::string_view packed, std::size_t size, const std::string& name) {
  std::string bytes(size, '\0');
  LZ4F_dctx* context = nullptr;
  if (LZ4F_isError(LZ4F_createDecompressionContext(&context, LZ4F_VERSION)))
    throw Error("liblz4 could not be initialised");
  std::size_t from = 0, to = 0, status = 1;
  while (status != 0 && from < packed.size()) {
    std::size_t read = packed.size() - from, written = bytes.size() - to;
    status =
        LZ4F_decompress(context, bytes.data() + to, &written, packed.data() + from, &read, nullptr);
    from += read;
    to += written;
    if (LZ4F_isError(status) || (read == 0 && written == 0)) break;
  }
  LZ4F_freeDecompressionContext(context);
  if (status != 0 || to != size)
    throw DataError(name + ": damaged: an lz4 chunk cannot be unpacked");
  return bytes;
}

bool IsZstd(std::string_view bytes) { return bytes.substr(0, kZstdMagic.size()) == kZstdMagic; }

std::string UnpackZstd(std::string_view packed, std::size_t most, const std::string& name,
                       ReadBudget* budget) {
  std::string bytes;
  const auto next = [&] {
    const std::string_view all = packed;
    packed = {};
    return all;
  };
  const bool whole = StreamZstd(next, [&](std::string_view piece) {
    budget->Unpack(piece.size(), name);
    if (piece.size() > most - bytes.size())
      throw DataError(fmt::format("{}: damaged: zstd packed more than {} bytes", name, most));
    bytes += piece;
    return true;
  });
  if (!whole) FailDamaged(name);
  return bytes;
}

std::string FrontOfZstd(const std::filesystem::path& path, std::size_t count) {
  Pieces pieces(path);
  std::string bytes;
  StreamZstd([&] { return pieces.Next(); },
             [&](std::string_view piece) {
               bytes += piece.substr(0, count - bytes.size());
               return bytes.size() < count;
             });
  return bytes;
}

UnpackedFile::UnpackedFile(const std::filesystem::path& path, const std::string& name,
                           ReadBudget* budget)
    : file_([] {
        std::string unpacked =
            (std::filesystem::temp_directory_path() / "volalign_XXXXXX").string();
        const int descriptor = mkstemp(unpacked.data());
        if (descriptor < 0) throw IoError("cannot create the file " + unpacked);
        close(descriptor);
        return std::filesystem::path(unpacked);
      }) {
  Pieces pieces(path);
  std::ofstream stream(file_.path(), std::ios::binary);
  const bool whole = StreamZstd([&] { return pieces.Next(); },
                                [&](std::string_view piece) {
                                  budget->Unpack(piece.size(), name);
                                  stream << piece;
                                  return true;
                                });
  if (!stream.flush())
    throw IoError(fmt::format("{}: cannot be unpacked into {}", name, file_.path().string()));
  if (!whole) FailDamaged(name);
}

}  // namespace volalign::formats_internal
