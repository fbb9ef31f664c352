#include "infer/capture/capture_folder.h"

#include <fmt/format.h>

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

constexpr std::size_t kTimeDigits = 13;  // of milliseconds since 1970; serial numbers have fewer

bool HasExtension(const fs::path& path, const std::set<std::string>& extensions) {
  return extensions.count(Lower(path.extension().string())) > 0;
}

/// Can the name be that of a file of intrinsics?
bool IsTextFile(const fs::path& path) {
  const std::string name = Lower(path.filename().string());
  const auto has = [&](const char* word) { return name.find(word) != std::string::npos; };
  return HasExtension(path, {".json", ".yaml", ".yml", ".txt", ".xml", ".ini", ".cfg", ".toml"}) ||
         has("intrin") || has("calib") || has("camera_info");
}

/// Adds the file to the intrinsics, or says why it is none.
void AddText(const fs::path& path, FolderContent* content) {
  std::error_code error;
  if (!IsTextFile(path) || fs::file_size(path, error) > kMaxTextBytes || error) return;
  const std::string text = ReadFile(path, kMaxTextBytes);
  const auto has = [&](const char* word) { return text.find(word) != std::string::npos; };
  // Files of volalign and of `ros2 bag record`.
  if (has(kCaptureFormat) || has("\"sensors\"") || has("\"volalign.") ||
      has("rosbag2_bagfile_information") ||
      path.filename().string().find(".command.") != std::string::npos)
    return;
  std::string why = WhyNoText(text);
  if (why.empty() && LooksLikeIntrinsics(text)) {
    content->intrinsics.push_back(path);
    return;
  }
  if (why.empty()) why = "it has none of the forms of intrinsics that are read";
  content->not_understood.push_back(Shortened(path.filename().string()) + ": " + why);
}

/// Keeps only the first of several parts of one recording.
void KeepFirstPart(const fs::path& folder, FolderContent* content) {
  const std::vector<std::string> parts = PartsOfRecording(folder);
  const auto is_part = [&](const fs::path& path) {
    return std::find(parts.begin(), parts.end(), path.filename().string()) != parts.end();
  };
  std::vector<fs::path>& recordings = content->recordings;
  const auto first = std::find_if(recordings.begin(), recordings.end(), is_part);
  if (first == recordings.end()) return;
  const fs::path kept = *first;
  for (const fs::path& path : recordings) {
    if (path == kept || !is_part(path)) continue;
    content->not_read.push_back(fmt::format("{}: a later part of the recording {}",
                                            Shortened(path.filename().string()),
                                            Shortened(kept.filename().string())));
  }
  recordings.erase(std::remove_if(first + 1, recordings.end(), is_part), recordings.end());
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
      if (IsNamedOtherwise(path.stem().string()))
        content.left_out.push_back(path.filename().string());
      else
        content.images.push_back(path);
    } else if (HasExtension(path, {".bag", ".db3", ".mcap", ".mkv", ".zst", ".zstd"})) {
      content.not_read.push_back(
          fmt::format("{}: it is named as a recording, and does not begin as one",
                      Shortened(path.filename().string())));
    } else {
      AddText(path, &content);
    }
  }
  for (const auto* list : {&content.images, &content.recordings, &content.intrinsics})
    for (const fs::path& path : *list) RequireUtf8(path.string(), "the file");
  KeepFirstPart(folder, &content);
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
      // The number may be a time with a fraction, as in names of rs-convert.
      if (skip(skip(at + word.size(), kBetween), "0123456789.") == lower.size())
        return stem.substr(0, stem.substr(0, at).find_last_not_of(kBetween) + 1);
    }
  }
  for (const std::string word : {"depth", "depthmap", "z16"}) {
    const std::size_t rest = skip(word.size(), kBetween);
    if (lower.compare(0, word.size(), word) == 0 && rest > word.size()) return stem.substr(rest);
  }
  return std::nullopt;
}

bool IsNamedAsFrame(const std::string& stem) {
  const std::string name = NameBesideDepth(stem).value_or(stem);
  const std::size_t begin = name.find_last_not_of("0123456789.") + 1;  // 0 where there is none
  const std::string number = name.substr(begin);
  const bool is_time = number.size() >= kTimeDigits || number.find('.') != std::string::npos;
  return !number.empty() && (is_time || (number.size() >= 3 && number[0] == '0') ||
                             HasWord(name, {"frame", "image", "img"}));
}

std::string WithoutNumber(const std::string& stem) {
  const std::size_t last = stem.find_last_not_of("0123456789.");
  return last == std::string::npos ? "" : stem.substr(0, last + 1);
}

}  // namespace volalign
