#include "infer/capture/capture_folder.h"

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <iterator>
#include <set>
#include <system_error>

#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/text.h"
#include "infer/capture/capture.h"
#include "infer/formats/depth_file.h"
#include "infer/formats/intrinsics_file.h"
#include "infer/formats/recording.h"

namespace volalign {

namespace {

namespace fs = std::filesystem;

bool HasExtension(const fs::path& path, const std::set<std::string>& extensions) {
  return extensions.count(Lower(path.extension().string())) > 0;
}

/// Whether a part of the name says that the image is something else.
bool IsNamedOtherwise(const fs::path& path) {
  static const std::set<std::string> others = {
      "ir",    "infrared", "infra", "color", "colour", "rgb",     "amplitude", "confidence",
      "label", "labels",   "mask",  "masks", "sheet",  "preview", "normal",    "normals"};
  std::string words = Lower(path.stem().string());
  for (char& c : words) {
    if (c < 'a' || c > 'z') c = ' ';
  }
  const std::vector<std::string> parts = Split(words, ' ');
  return std::any_of(parts.begin(), parts.end(),
                     [&](const std::string& part) { return others.count(part) > 0; });
}

bool IsIntrinsicsFile(const fs::path& path) {
  std::error_code error;
  if (!HasExtension(path, {".json", ".yaml", ".yml", ".txt"}) ||
      fs::file_size(path, error) > kMaxTextBytes || error)
    return false;
  const std::string text = ReadFile(path, kMaxTextBytes);
  return text.find(kCaptureFormat) == std::string::npos &&
         text.find("\"sensors\"") == std::string::npos && LooksLikeIntrinsics(text);
}

}  // namespace

bool ComesBefore(const std::filesystem::path& a, const std::filesystem::path& b) {
  const std::string x = a.filename().string(), y = b.filename().string();
  std::size_t i = 0, j = 0;
  const auto digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  while (i < x.size() && j < y.size()) {
    if (digit(x[i]) && digit(y[j])) {
      std::size_t p = i, q = j;
      while (p < x.size() && digit(x[p])) ++p;
      while (q < y.size() && digit(y[q])) ++q;
      while (i < p - 1 && x[i] == '0') ++i;
      while (j < q - 1 && y[j] == '0') ++j;
      if (p - i != q - j) return p - i < q - j;
      if (const int order = x.compare(i, p - i, y, j, q - j)) return order < 0;
      i = p;
      j = q;
    } else {
      if (x[i] != y[j]) return x[i] < y[j];
      ++i;
      ++j;
    }
  }
  return x.size() - i < y.size() - j || (x.size() - i == y.size() - j && x < y);
}

FolderContent LookInto(const std::filesystem::path& folder) {
  std::vector<fs::path> paths;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder))
    if (entry.is_regular_file()) paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end(), ComesBefore);
  FolderContent content;
  for (const fs::path& path : paths) {
    if (IsRecording(path)) {
      content.recordings.push_back(path);
    } else if (HasExtension(path, {std::begin(kDepthEndings), std::end(kDepthEndings)})) {
      if (IsNamedOtherwise(path))
        content.left_out.push_back(path.filename().string());
      else
        content.images.push_back(path);
    } else if (IsIntrinsicsFile(path)) {
      content.intrinsics.push_back(path);
    }
  }
  for (const auto* list : {&content.images, &content.recordings, &content.intrinsics})
    for (const fs::path& path : *list) RequireUtf8(path.string(), "the file");
  return content;
}

std::optional<std::string> NameBesideDepth(const std::string& stem) {
  constexpr char kBetween[] = "_-. ";
  const std::string lower = Lower(stem);
  const auto skip = [&](std::size_t at, const char* letters) {
    return std::min(lower.find_first_not_of(letters, at), lower.size());
  };
  for (std::size_t at = 0; at < lower.size(); ++at) {
    for (const std::string word : {"depth", "depthmap", "z16"}) {
      if (lower.compare(at, word.size(), word) != 0) continue;
      if (skip(skip(at + word.size(), kBetween), "0123456789") == lower.size())
        return stem.substr(0, stem.substr(0, at).find_last_not_of(kBetween) + 1);
    }
  }
  for (const std::string word : {"depth", "depthmap", "z16"}) {
    const std::size_t rest = skip(word.size(), kBetween);
    if (lower.compare(0, word.size(), word) == 0 && rest > word.size()) return stem.substr(rest);
  }
  return std::nullopt;
}

std::string WithoutNumber(const std::string& stem) {
  const std::size_t last = stem.find_last_not_of("0123456789");
  return last == std::string::npos ? "" : stem.substr(0, last + 1);
}

}  // namespace volalign
