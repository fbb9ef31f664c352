#include "infer/capture/capture_folder.h"

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <iterator>
#include <regex>
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
  static const std::regex words(
      "(^|[^a-z])(ir|infrared|infra|colou?r|rgb|amplitude|confidence|labels?|masks?|sheet|preview|"
      "normals?)([^a-z]|$)");
  return std::regex_search(Lower(path.stem().string()), words);
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
  return content;
}

std::optional<std::string> NameBesideDepth(const std::string& stem) {
  static const std::regex after("^(.*?)[_\\-. ]*(depth|depthmap|z16)[_\\-. ]*[0-9]*$");
  static const std::regex before("^(depth|depthmap|z16)[_\\-. ]+(.*)$");
  std::smatch match;
  const std::string lower = Lower(stem);
  if (std::regex_match(lower, match, after))
    return stem.substr(0, static_cast<std::size_t>(match.length(1)));
  if (std::regex_match(lower, match, before))
    return stem.substr(static_cast<std::size_t>(match.position(2)));
  return std::nullopt;
}

std::string WithoutNumber(const std::string& stem) {
  const std::size_t last = stem.find_last_not_of("0123456789");
  return last == std::string::npos ? "" : stem.substr(0, last + 1);
}

}  // namespace volalign
