#include "infer/capture/capture_draft.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <system_error>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/statistics.h"
#include "core/base/text.h"
#include "core/geometry/camera.h"
#include "core/geometry/sensor_kind.h"
#include "infer/capture/capture.h"
#include "infer/formats/depth_file.h"
#include "infer/formats/intrinsics_file.h"
#include "infer/formats/read_budget.h"
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

namespace {

namespace fs = std::filesystem;

constexpr double kSameScale = 1e-6;     // share of it, of single precision
constexpr std::size_t kMostListed = 5;  // files of one kind that a sentence names

/// One sensor as far as the folder shows it.
struct DraftSensor {
  std::string name;
  std::vector<fs::path> files;  // frames, or one recording
  std::string stream;           // of a recording with several
  int width = 0, height = 0;
  double median = 0;       // of the first frame's measured values, in the file's units
  RecordedDepth recorded;  // the recording's data without its frames
  std::optional<Intrinsics> intrinsics;
  bool typical_intrinsics = false;
};

/// Do two frames show the same scene from the same place? Hardly any depth differs then, nor where
/// depth was measured.
bool SeeTheSame(const Image<float>& a, const Image<float>& b) {
  constexpr float kAlike = 0.05f;      // share of the depth: noise is below, other views are not
  constexpr double kMostOther = 0.15;  // share of the pixels
  if (a.width() != b.width() || a.height() != b.height()) return false;
  std::size_t measured = 0, other = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const float far = std::max(a[i], b[i]);
    measured += far > 0;
    other += std::abs(a[i] - b[i]) > kAlike * far;
  }
  return static_cast<double>(other) <= kMostOther * static_cast<double>(measured);
}

class Drafter {
 public:
  Drafter(fs::path folder, const CaptureDraftOptions& options)
      : folder_(std::move(folder)), options_(options) {}

  CaptureDraft Run(const fs::path& output_folder) {
    std::error_code error;
    if (!fs::is_directory(folder_, error))
      throw IoError(folder_.string() + ": no such folder; name the one that has the depth files");
    const FolderContent top = LookInto(folder_);
    AddFlat(top);
    std::vector<fs::path> folders;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder_))
      if (entry.is_directory()) folders.push_back(entry.path());
    std::sort(folders.begin(), folders.end(), ComesBefore);
    for (const fs::path& sub : folders) AddSubFolder(sub);
    if (sensors_.empty()) {
      const std::vector<std::string>& said = draft_.unknown.empty() ? draft_.found : draft_.unknown;
      throw DataError(fmt::format(
          "{}: no depth that can be read is in it or in a folder of it; expected {}, "
          ".bag, .db3, .mcap or .mkv{}",
          folder_.string(), kDepthFormats, said.empty() ? "" : " (" + said.front() + ")"));
    }
    std::set<fs::path> used;
    for (DraftSensor& sensor : sensors_) FindIntrinsics(top, &sensor, &used);
    draft_.json = Write(output_folder);
    RequireUsed("--depth-scale", options_.depth_scale.has_value(), scale_);
    RequireUsed("--intrinsics", options_.intrinsics.has_value(), intrinsics_);
    RequireUsed("--sensor", !options_.sensor.empty(), kind_);
    draft_.sensors = static_cast<int>(sensors_.size());
    return std::move(draft_);
  }

 private:
  /// Number of sensors that an option was used for, and why not for the others.
  struct Use {
    int sensors = 0;
    std::vector<std::string> others;
  };

  /// Names the sensors that do not need an option. Throws ConfigError if none does.
  void RequireUsed(const char* option, bool given, const Use& use) {
    if (!given || use.others.empty()) return;
    const std::string others = Shortened(fmt::format("{}", fmt::join(use.others, "; ")));
    if (use.sensors == 0) {
      throw ConfigError(
          fmt::format("{}: no sensor needs it: {}; leave the option out. If other values are "
                      "right, change them in the file that is written",
                      option, others));
    }
    draft_.found.push_back(fmt::format("{} is not used for all: {}", option, others));
  }

  void AddFlat(const FolderContent& content) {
    std::map<std::string, std::vector<fs::path>> frames;
    std::vector<std::string> order;
    for (const fs::path& image : content.images) {
      const std::string stem = image.stem().string();
      std::string name = NameBesideDepth(stem).value_or(stem);
      if (name.empty()) name = "depth";
      if (!frames.count(name)) order.push_back(name);
      frames[name].push_back(image);
    }
    JoinFrames(&order, &frames);
    for (const std::string& name : order) AddImages(name, frames[name]);
    for (const fs::path& recording : content.recordings)
      AddRecording(recording.stem().string(), recording);
    SayLeftOut(content, "");
  }

  /// Joins images that their names make one sensor each if they are numbered as frames and see the
  /// same as the first.
  void JoinFrames(std::vector<std::string>* order,
                  std::map<std::string, std::vector<fs::path>>* frames) {
    std::map<std::string, std::vector<std::string>> alike;  // by name without the number
    for (const std::string& name : *order) {
      if ((*frames)[name].size() == 1 && IsNamedAsFrame(name))
        alike[WithoutNumber(name)].push_back(name);
    }
    for (const auto& each : alike) {
      const std::string& rest = each.first;
      const std::vector<std::string>& names = each.second;
      if (names.size() < 2) continue;
      std::vector<std::string> joined;
      try {
        const Image<float> first = ReadStoredDepth((*frames)[names[0]][0], &budget_).values;
        std::copy_if(
            names.begin(), names.end(), std::back_inserter(joined), [&](const std::string& name) {
              return name == names[0] ||
                     SeeTheSame(first, ReadStoredDepth((*frames)[name][0], &budget_).values);
            });
      } catch (const Error&) {
        continue;  // AddImages reports it
      }
      if (joined.size() != names.size()) continue;
      std::vector<fs::path> files;
      for (const std::string& name : names) files.push_back((*frames)[name][0]);
      const std::size_t last = rest.find_last_not_of("_-. ");
      const std::string word = last == std::string::npos ? "" : rest.substr(0, last + 1);
      const std::string sensor = word.empty() ? "depth" : word;
      if (frames->count(sensor) > 0) continue;
      *std::find(order->begin(), order->end(), names[0]) = sensor;
      for (const std::string& name : names) {
        frames->erase(name);
        order->erase(std::remove(order->begin(), order->end(), name), order->end());
      }
      (*frames)[sensor] = files;
    }
  }

  void AddSubFolder(const fs::path& sub) {
    const std::string name = sub.filename().string();
    const FolderContent content = LookInto(sub);
    std::map<std::string, std::vector<fs::path>> groups;  // by name without the number
    for (const fs::path& image : content.images)
      groups[WithoutNumber(image.stem().string())].push_back(image);
    if (groups.size() > 1) {
      std::map<std::string, std::vector<fs::path>> named;
      for (const auto& group : groups)
        if (Lower(group.first).find("depth") != std::string::npos) named.insert(group);
      if (named.size() != 1) {
        draft_.unknown.push_back(
            fmt::format("{}: which of its images are depth: {}... (name them depth_0001 and so on)",
                        name, content.images.front().filename().string()));
        return;
      }
      groups = named;
    }
    const std::size_t before = sensors_.size();
    if (!groups.empty()) AddImages(name, groups.begin()->second);
    for (const fs::path& recording : content.recordings) {
      const bool alone = groups.empty() && content.recordings.size() == 1;
      AddRecording(alone ? name : name + "_" + recording.stem().string(), recording);
    }
    for (std::size_t i = before; i < sensors_.size(); ++i) own_[sensors_[i].name] = content;
    SayLeftOut(content, name + "/");
  }

  void SayLeftOut(const FolderContent& content, const std::string& where) {
    for (const std::string& sentence : content.not_read)
      draft_.found.push_back(fmt::format("left out: {}{}", where, sentence));
    std::vector<std::string> names = content.left_out;
    if (names.empty()) return;
    const bool more = names.size() > kMostListed;
    names.resize(std::min(names.size(), kMostListed));
    draft_.found.push_back(fmt::format("left out, by their names: {}{}{}", where,
                                       fmt::join(names, ", "), more ? ", ..." : ""));
  }

  void AddImages(const std::string& name, const std::vector<fs::path>& files) {
    DraftSensor sensor;
    for (const fs::path& file : files) {
      try {
        const StoredDepth depth = ReadStoredDepth(file, &budget_);
        if (sensor.files.empty()) {
          SetSize(depth, &sensor);
        } else if (depth.values.width() != sensor.width || depth.values.height() != sensor.height) {
          throw DataError(fmt::format("{}: {}x{}, unlike the first of its sensor", file.string(),
                                      depth.values.width(), depth.values.height()));
        }
        sensor.files.push_back(file);
      } catch (const Error& error) {
        draft_.found.push_back(fmt::format("left out: {}", error.what()));
      }
    }
    if (sensor.files.empty()) return;
    sensor.name = UniqueName(name);
    draft_.found.push_back(
        fmt::format("{}: {} depth frame{} of {}x{}: {}", sensor.name, sensor.files.size(),
                    sensor.files.size() == 1 ? "" : "s, one capture,", sensor.width, sensor.height,
                    fs::relative(sensor.files.front(), folder_).string()));
    sensors_.push_back(std::move(sensor));
  }

  void AddRecording(const std::string& name, const fs::path& file) {
    std::vector<RecordedDepth> streams;
    const std::uint64_t kept = budget_.kept();
    try {
      streams = ReadRecording(file, kDefaultFrames, &budget_);
    } catch (const Error& error) {
      draft_.unknown.push_back(fmt::format("what {} holds: {}", name, error.what()));
      return;
    }
    budget_.Drop(budget_.kept() - kept);
    const std::string where = fs::relative(file, folder_).string();
    for (RecordedDepth& stream : streams) {
      if (!stream.problem.empty()) {
        draft_.unknown.push_back(
            fmt::format("what {} of {} holds: {}", stream.stream, where, stream.problem));
        continue;
      }
      const Image<float>& first = stream.frames.front().values;
      if (const auto other = devices_.find(stream.serial);
          !stream.serial.empty() && other != devices_.end() && other->second.first != file &&
          SeeTheSame(other->second.second, first)) {
        draft_.found.push_back(fmt::format("left out: {}: the device {} sees the same in {}", where,
                                           stream.serial, other->second.first.filename().string()));
        continue;
      }
      devices_.emplace(stream.serial, std::pair(file, first));
      DraftSensor sensor;
      sensor.name = UniqueName(name);
      sensor.files = {file};
      SetSize(stream.frames.front(), &sensor);
      if (streams.size() > 1) sensor.stream = stream.stream;
      stream.frames.clear();
      sensor.intrinsics = stream.intrinsics;
      if (options_.depth_scale && !stream.depth_scale_stated) {
        stream.depth_scale = options_.depth_scale;
        stream.depth_scale_source = "--depth-scale";
      }
      draft_.found.push_back(fmt::format(
          "{}: depth stream {} of {}, {}x{}{}{}", sensor.name, stream.stream, where, sensor.width,
          sensor.height,
          stream.depth_scale
              ? fmt::format(", {} m per unit ({})", *stream.depth_scale, stream.depth_scale_source)
              : "",
          stream.intrinsics ? ", intrinsics of " + stream.intrinsics_source : ""));
      sensor.recorded = std::move(stream);
      sensors_.push_back(std::move(sensor));
    }
  }

  static void SetSize(const StoredDepth& depth, DraftSensor* sensor) {
    sensor->width = depth.values.width();
    sensor->height = depth.values.height();
    std::vector<float> measured;
    std::copy_if(depth.values.begin(), depth.values.end(), std::back_inserter(measured),
                 [](float value) { return value > 0; });
    sensor->median = static_cast<double>(Quantile(measured, 0.5));
  }

  std::string UniqueName(const std::string& wanted) {
    const std::string base = IsFileName(wanted) ? wanted : "sensor";
    std::string name = base;
    for (int i = 2; !names_.insert(name).second; ++i) name = fmt::format("{}_{}", base, i);
    return name;
  }

  /// Files of intrinsics that may be the sensor's, the nearest first.
  std::vector<fs::path> Candidates(const FolderContent& top, const DraftSensor& sensor) const {
    std::vector<fs::path> files;
    if (const auto own = own_.find(sensor.name); own != own_.end()) files = own->second.intrinsics;
    std::vector<fs::path> shared;
    for (const fs::path& file : top.intrinsics) {
      const std::string stem = Lower(file.stem().string());
      const std::string name = Lower(sensor.name);
      const bool begins = stem.rfind(name, 0) == 0 &&
                          (stem.size() == name.size() ||
                           !std::isalnum(static_cast<unsigned char>(stem[name.size()])));
      if (begins) files.push_back(file);
      const bool is_other = std::any_of(sensors_.begin(), sensors_.end(), [&](const auto& other) {
        return stem.rfind(Lower(other.name), 0) == 0;
      });
      if (!is_other) shared.push_back(file);
    }
    if (options_.intrinsics) {
      files.push_back(*options_.intrinsics);
      return files;
    }
    return files.empty() && shared.size() == 1 ? shared : files;
  }

  void FindIntrinsics(const FolderContent& top, DraftSensor* sensor, std::set<fs::path>* used) {
    if (sensor->intrinsics && sensor->recorded.intrinsics_stated) {
      intrinsics_.others.push_back(
          fmt::format("{} has those of {}", sensor->name, sensor->recorded.intrinsics_source));
      return;
    }
    std::vector<std::string> why;
    if (!sensor->recorded.intrinsics_problem.empty())
      why.push_back(sensor->recorded.intrinsics_problem);
    const std::vector<fs::path> candidates = Candidates(top, *sensor);
    for (const fs::path& file : candidates) {
      try {
        const Intrinsics read = ReadIntrinsicsFile(file, {sensor->width, sensor->height});
        if (read.width != sensor->width || read.height != sensor->height) {
          throw DataError(fmt::format("{} is for {}x{}, the frames are {}x{}", file.string(),
                                      read.width, read.height, sensor->width, sensor->height));
        }
        sensor->intrinsics = read;
        used->insert(file);
        const std::string name = file.filename().string();
        if (options_.intrinsics && file == *options_.intrinsics) {
          ++intrinsics_.sensors;
        } else {
          intrinsics_.others.push_back(fmt::format("{} has those of {}", sensor->name, name));
        }
        draft_.found.push_back(fmt::format("{}: intrinsics of {}", sensor->name, name));
        return;
      } catch (const Error& error) {
        why.push_back(error.what());
      }
    }
    if (sensor->intrinsics) return;  // of a camera that calls itself not calibrated
    if (TakeTypical(sensor)) return;
    if (candidates.empty())
      why.push_back("no file of intrinsics is beside it" + PassedOver(top, *sensor));
    draft_.unknown.push_back(
        fmt::format("{}: intrinsics (fx, fy, cx, cy, distortion of the {}x{} frames): {}",
                    sensor->name, sensor->width, sensor->height, fmt::join(why, "; ")));
  }

  /// Says why files that may be meant as the sensor's intrinsics are none.
  std::string PassedOver(const FolderContent& top, const DraftSensor& sensor) const {
    std::vector<std::string> files = top.not_understood;
    if (const auto own = own_.find(sensor.name); own != own_.end())
      files.insert(files.begin(), own->second.not_understood.begin(),
                   own->second.not_understood.end());
    if (files.empty()) return "";
    const bool more = files.size() > kMostListed;
    files.resize(std::min(files.size(), kMostListed));
    return fmt::format(" that can be read ({}{})", fmt::join(files, "; "), more ? "; ..." : "");
  }

  /// Takes typical intrinsics if options ask for them.
  bool TakeTypical(DraftSensor* sensor) {
    if (!options_.typical) return false;
    const std::string& stated = sensor->recorded.kind;
    const std::string kind = stated.empty() ? options_.sensor : stated;
    sensor->intrinsics = TypicalIntrinsics(kind, sensor->width, sensor->height);
    sensor->typical_intrinsics = sensor->intrinsics.has_value();
    if (sensor->intrinsics) {
      draft_.found.push_back(fmt::format(
          "{}: intrinsics typical of {}, not its own: its pose will be weak", sensor->name, kind));
    } else {
      draft_.unknown.push_back(fmt::format(
          "{}: typical intrinsics of {} at {}x{} are not known (configs/intrinsics.yaml has those "
          "that are)",
          sensor->name, kind.empty() ? "a kind that is not named (--sensor names it)" : kind,
          sensor->width, sensor->height));
    }
    return true;
  }

  nlohmann::ordered_json SensorJson(const DraftSensor& sensor, const fs::path& output_folder) {
    nlohmann::ordered_json json;
    json["name"] = sensor.name;
    std::vector<std::string> files;
    for (const fs::path& file : sensor.files)
      files.push_back(fs::relative(file, output_folder).generic_string());
    if (files.size() == 1)
      json["depth"] = files.front();
    else
      json["depth"] = files;
    if (!sensor.stream.empty()) json["stream"] = sensor.stream;
    const RecordedDepth& recorded = sensor.recorded;
    if (recorded.kind.empty() || recorded.kind == options_.sensor) {
      ++kind_.sensors;
    } else {
      kind_.others.push_back(fmt::format("{} is a {}", sensor.name, recorded.kind));
    }
    const std::string kind = recorded.kind.empty() ? options_.sensor : recorded.kind;
    if (!kind.empty()) json["sensor"] = kind;
    if (!recorded.serial.empty()) json["serial"] = recorded.serial;
    std::optional<double> scale = recorded.depth_scale;
    const bool same = scale && options_.depth_scale &&
                      std::abs(*scale - *options_.depth_scale) <= kSameScale * *scale;
    if (scale && recorded.depth_scale_stated && !same) {
      scale_.others.push_back(
          fmt::format("{} has {} m ({})", sensor.name, *scale, recorded.depth_scale_source));
    } else {
      ++scale_.sensors;
      if (options_.depth_scale && !recorded.depth_scale_stated) scale = options_.depth_scale;
    }
    if (scale) {
      json["depth_scale"] = *scale;
    } else {
      draft_.unknown.push_back(fmt::format(
          "{}: depth_scale, metres per unit: give it with --depth-scale. The median of its first "
          "frame is {:.6g}, which is {:.3g} m at 0.001 (mm), {:.3g} m at 0.0001, {:.3g} m at 1",
          sensor.name, sensor.median, 0.001 * sensor.median, 0.0001 * sensor.median,
          sensor.median));
    }
    if (sensor.intrinsics) {
      const Intrinsics& k = *sensor.intrinsics;
      json["intrinsics"] = {{"width", k.width}, {"height", k.height}, {"fx", k.fx},
                            {"fy", k.fy},       {"cx", k.cx},         {"cy", k.cy}};
      if (!k.distortion.empty()) json["intrinsics"]["distortion"] = k.distortion;
      if (sensor.typical_intrinsics) json["typical_intrinsics"] = true;
      lenses_[LensSentence(k.distortion, kind)].push_back(sensor.name);
    }
    return json;
  }

  /// A sentence on the lens that a calibration will assume.
  static std::string LensSentence(const std::vector<double>& distortion, const std::string& kind) {
    if (std::any_of(distortion.begin(), distortion.end(), [](double x) { return x != 0; }))
      return "the lens is that of the distortion that the intrinsics give";
    if (!distortion.empty()) return "taken as rectified, since the distortion is all zeros";
    const std::string why = "the intrinsics give no distortion";
    const SensorKind* known = FindSensorKind(kind);
    if (known != nullptr && known->lens) {
      return known->lens->rectified()
                 ? fmt::format("taken as rectified, since {}, and {} delivers rectified frames",
                               why, kind)
                 : fmt::format(
                       "the lens is taken as the typical one of {} and will be estimated, since {}",
                       kind, why);
    }
    return fmt::format(
        "the lens is unknown and will be estimated, since {}, and {}. To state it, give \"sensor\" "
        "with a known kind, or \"distortion\" (zeros: rectified)",
        why, kind.empty() ? "no kind of sensor is named" : "that of " + kind + " is not known");
  }

  std::string Write(const fs::path& output_folder) {
    nlohmann::ordered_json json;
    json["format"] = kCaptureFormat;
    if (options_.structure)
      json["structure"] = fs::relative(*options_.structure, output_folder).generic_string();
    json["sensors"] = nlohmann::ordered_json::array();
    for (const DraftSensor& sensor : sensors_)
      json["sensors"].push_back(SensorJson(sensor, output_folder));
    for (const auto& [sentence, names] : lenses_)
      draft_.found.push_back(fmt::format("{}: {}", fmt::join(names, ", "), sentence));
    return json.dump(2) + "\n";
  }

  fs::path folder_;
  const CaptureDraftOptions& options_;
  CaptureDraft draft_;
  std::vector<DraftSensor> sensors_;
  std::set<std::string> names_;
  std::map<std::string, std::vector<std::string>> lenses_;  // sensors by the sentence on their lens
  std::map<std::string, FolderContent> own_;                // of a sensor's sub-folder
  std::map<std::string, std::pair<fs::path, Image<float>>> devices_;  // by serial: first frames
  Use scale_, intrinsics_, kind_;
  ReadBudget budget_;
};

}  // namespace

CaptureDraft DraftCapture(const std::filesystem::path& folder,
                          const std::filesystem::path& output_folder,
                          const CaptureDraftOptions& options) {
  if (!options.sensor.empty()) RequireSensorKind(options.sensor, "--sensor");
  return Drafter(folder, options).Run(output_folder);
}

}  // namespace volalign
