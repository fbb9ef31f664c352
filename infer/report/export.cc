#include "infer/report/export.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/file_limits.h"
#include "core/base/file_util.h"
#include "core/base/parallel_for.h"
#include "core/formats/image_io.h"
#include "core/json/json_archive.h"
#include "core/plot/picture.h"
#include "infer/capture/capture.h"
#include "infer/report/clouds.h"
#include "infer/report/html_report/payload.h"
#include "infer/report/panels.h"
#include "infer/report/report.h"

namespace volalign {

namespace {

/// A frame's part of the common files.
struct FrameFiles {
  RgbImage picture;
  std::vector<AlignedPoint> cloud;
  std::vector<AlignedPoint> thinned;  // for report.html and rig.glb
  nlohmann::ordered_json report;
};

/// Most points in report.html and in rig.glb: of one frame, and of all together.
constexpr std::size_t kReportPointsAFrame = 12000, kReportPoints = 120000;

/// Folders of a calibration's images and clouds.
constexpr std::array<const char*, 3> kImageFolders = {"labels", "confidence", "pictures"};
constexpr const char* kCloudFolder = "clouds";
constexpr const char* kReportFile = "report.html";
constexpr const char* kRigFile = "rig.glb";

/// The sensors of one capture, its structure, and the place of its files.
struct CaptureFiles {
  std::string name;  // folder in each of the folders; empty for a single capture
  const std::vector<FrameResult>* sensors;
  const Structure* built;
  const std::optional<WorldFrame>* world;
  Pose first_from_placement = Pose::Identity();

  std::filesystem::path Path(const std::filesystem::path& folder, const std::string& kind,
                             const std::string& file) const {
    return folder / kind / name / file;
  }
};

/// A capture's points in the structure frame of the first one.
std::vector<AlignedPoint> CloudOf(const CaptureFiles& capture, const FrameResult& sensor) {
  std::vector<AlignedPoint> cloud = AlignedPoints(sensor, *capture.built);
  for (AlignedPoint& point : cloud) {
    point.p = (capture.first_from_placement * point.p.cast<double>()).cast<float>();
  }
  return cloud;
}

int AllThreads() { return static_cast<int>(std::max(1U, std::thread::hardware_concurrency())); }

/// Makes the frames' parts of the report of at most `points` points each (0: without one). With a
/// `folder`, it also writes the frames' own files there and keeps their pictures and clouds.
std::vector<FrameFiles> MakeFrames(const CaptureFiles& capture, std::size_t points,
                                   const std::filesystem::path* folder = nullptr) {
  const std::vector<FrameResult>& sensors = *capture.sensors;
  const std::vector<int> turns = UprightTurnsOf(sensors);
  std::vector<FrameFiles> frames(sensors.size());
  ParallelFor(sensors.size(), AllThreads(), [&](std::size_t i) {
    const FrameResult& sensor = sensors[i];
    FramePanels panels = MakePanels(sensor, *capture.built, turns[i]);
    std::vector<AlignedPoint> cloud = CloudOf(capture, sensor);
    if (folder) {
      const std::string png = sensor.name + ".png";
      WritePng(capture.Path(*folder, "labels", png), sensor.segmentation.labels);
      WritePng(capture.Path(*folder, "confidence", png),
               ConfidenceImage(sensor.segmentation.confidence));
      WriteFileAtomically(capture.Path(*folder, "pictures", png),
                          EncodePalettePng(SensorPicture(sensor, panels, *capture.built, true)));
      if (sensor.structure_from_sensor)
        WritePly(capture.Path(*folder, kCloudFolder, sensor.name + ".ply"), cloud, *capture.world);
      frames[i].picture = SensorPicture(sensor, panels, *capture.built, false);
    }
    if (points > 0) {
      frames[i].thinned = ThinCloud(cloud, points);
      frames[i].report = ReportFrameJson(sensor.name, panels, frames[i].thinned);
    }
    if (folder) frames[i].cloud = std::move(cloud);
  });
  return frames;
}

/// Returns the frames' parts of the report, without pictures and whole clouds.
std::vector<FrameFiles> WriteCapture(const std::filesystem::path& folder,
                                     const CaptureFiles& capture, std::size_t points) {
  std::vector<FrameFiles> written = MakeFrames(capture, points, &folder);
  std::vector<RgbImage> pictures;
  std::vector<AlignedPoint> merged;
  for (FrameFiles& files : written) {
    pictures.push_back(std::exchange(files.picture, {}));
    merged.insert(merged.end(), files.cloud.begin(), files.cloud.end());
    files.cloud.clear();
  }
  WriteFileAtomically(capture.Path(folder, "pictures", "overview.png"),
                      EncodePalettePng(OverviewPicture(pictures, *capture.built)));
  WritePly(capture.Path(folder, kCloudFolder, "merged.ply"), merged, *capture.world);
  return written;
}

ReportRig RigOf(const CalibrationResult& result, const std::vector<CaptureFiles>& files) {
  const std::optional<WorldFrame>& world = *files.front().world;
  ReportRig rig{(world ? WorldSentence(*world) + "\n" : "") + FormatNotes(result),
                Advise(result),
                PlacedFromAbove(result.sensors, *files.front().built),
                {}};
  for (const RigAlternative& alternative : result.alternatives) {
    const auto of = std::find_if(files.begin(), files.end(), [&](const CaptureFiles& capture) {
      return capture.name == alternative.capture;
    });
    const CaptureFiles& capture = of == files.end() ? files.front() : *of;
    rig.alternatives.push_back(AlternativeJson(alternative, result.sensors, *capture.sensors,
                                               *capture.built, capture.first_from_placement));
  }
  return rig;
}

/// Writes the page, and rig.glb if it has a path.
void WriteReport(const std::filesystem::path& page, const std::filesystem::path& rig_glb,
                 const std::vector<CaptureFiles>& files,
                 std::vector<std::vector<FrameFiles>> written, const Extrinsics& extrinsics,
                 const CalibrationResult& result, const ReportRun& run) {
  std::vector<ReportCapture> captures;
  std::vector<Structure> structures;
  std::vector<RigCloud> clouds;
  for (std::size_t s = 0; s < files.size(); ++s) {
    structures.push_back(*files[s].built);
    captures.push_back({files[s].name, *files[s].built, {}});
    for (std::size_t i = 0; i < written[s].size(); ++i) {
      FrameFiles& frame = written[s][i];
      captures.back().frames.push_back(std::move(frame.report));
      clouds.push_back({(*files[s].sensors)[i].name, files[s].name, std::move(frame.thinned)});
    }
  }
  if (!rig_glb.empty()) WriteRigGlb(rig_glb, extrinsics, structures, clouds);
  WriteFileAtomically(page,
                      ReportPage(ReportPayload(extrinsics, captures, RigOf(result, files), run)));
}

std::vector<CaptureFiles> NameCaptures(const Calibration& calibration) {
  const CalibrationResult& result = calibration.result;
  const std::optional<WorldFrame>& world = calibration.source.world;
  const auto built = [&](const Structure& of) {
    return of.boxes().empty() ? &calibration.structure : &of;
  };
  if (result.captures.empty()) return {{"", &result.sensors, built(result.built), &world}};
  std::vector<CaptureFiles> captures;
  for (const CaptureResult& capture : result.captures) {
    captures.push_back({capture.name, &capture.sensors, built(capture.built), &world,
                        capture.first_from_placement});
  }
  return captures;
}

std::size_t ReportPointsAFrame(const std::vector<CaptureFiles>& captures) {
  std::size_t frames = 1;
  for (const CaptureFiles& capture : captures) frames += capture.sensors->size();
  return std::min(kReportPointsAFrame, kReportPoints / frames);
}

/// Paths of a capture's files below a calibration's folder, whether they were written or not.
/// `clouds`: names of the placed sensors.
void AddPaths(const std::string& capture, const std::vector<std::string>& sensors,
              const std::vector<std::string>& clouds, std::set<std::filesystem::path>* paths) {
  const std::filesystem::path below = capture;
  for (const char* kind : kImageFolders) {
    for (const std::string& name : sensors) paths->insert(kind / below / (name + ".png"));
  }
  for (const std::string& name : clouds) paths->insert(kCloudFolder / below / (name + ".ply"));
  paths->insert("pictures" / below / "overview.png");
  paths->insert(kCloudFolder / below / "merged.ply");
}

/// The files of the run whose results are in `folder`. None if its extrinsics.json cannot be read.
std::set<std::filesystem::path> EarlierFiles(const std::filesystem::path& folder) {
  std::set<std::filesystem::path> files = {kReportFile, kRigFile};
  try {
    const Extrinsics earlier = ReadExtrinsics(folder);
    // volalign writes no name that leads elsewhere.
    std::vector<std::string> sensors, captures;
    for (const Extrinsics::Sensor& sensor : earlier.sensors) {
      if (IsFileName(sensor.name)) sensors.push_back(sensor.name);
    }
    for (const Extrinsics::Placement& placement : earlier.placements) {
      if (IsFileName(placement.name)) captures.push_back(placement.name);
    }
    if (captures.empty()) captures = {""};
    for (const std::string& capture : captures) AddPaths(capture, sensors, sensors, &files);
    return files;
  } catch (const Error&) {
    return {};
  }
}

/// Files of an earlier run that this one does not write.
std::set<std::filesystem::path> OutdatedFiles(const std::filesystem::path& folder,
                                              const std::vector<CaptureFiles>& captures,
                                              bool report) {
  std::set<std::filesystem::path> now;
  if (report) now = {kReportFile, kRigFile};
  for (const CaptureFiles& capture : captures) {
    std::vector<std::string> sensors, placed;
    for (const FrameResult& sensor : *capture.sensors) {
      sensors.push_back(sensor.name);
      if (sensor.structure_from_sensor) placed.push_back(sensor.name);
    }
    AddPaths(capture.name, sensors, placed, &now);
  }
  std::set<std::filesystem::path> outdated;
  for (const std::filesystem::path& path : EarlierFiles(folder)) {
    if (now.count(path) == 0) outdated.insert(path);
  }
  return outdated;
}

}  // namespace

Calibration CalibrateFiles(std::vector<Capture> captures, std::vector<std::string> files,
                           const Structure& structure, NetworkSegmenter* network,
                           const CalibrateOptions& options, const CalibrateProgress& progress) {
  Calibration out{std::move(captures), structure, {}, {}, WriteConfig(options)};
  out.source.captures = std::move(files);
  if (network) {
    out.source.model_file = network->file();
    out.source.model_sha256 = network->sha256();
    out.source.model_runtime = network->runtime();
  }
  out.result = Calibrate(out.captures, structure, network, options, progress);
  return out;
}

Extrinsics MakeExtrinsics(const Calibration& calibration) {
  return MakeExtrinsics(calibration.result, calibration.captures, calibration.structure,
                        calibration.source);
}

void WriteReportPage(const std::filesystem::path& path, const Calibration& calibration,
                     const ReportRun& run) {
  const std::vector<CaptureFiles> files = NameCaptures(calibration);
  std::vector<std::vector<FrameFiles>> frames;
  for (const CaptureFiles& capture : files)
    frames.push_back(MakeFrames(capture, ReportPointsAFrame(files)));
  WriteReport(path, "", files, std::move(frames), MakeExtrinsics(calibration), calibration.result,
              run);
}

void WriteCalibration(const ResultFolder& folder, const Calibration& calibration,
                      const std::optional<ReportRun>& report) {
  WriteFileAtomically(folder.draft() / "options.yaml", calibration.options);
  const std::vector<CaptureFiles> files = NameCaptures(calibration);
  const std::size_t points = report ? ReportPointsAFrame(files) : 0;
  std::vector<std::vector<FrameFiles>> written;
  for (const CaptureFiles& capture : files)
    written.push_back(WriteCapture(folder.draft(), capture, points));
  const Extrinsics extrinsics = MakeExtrinsics(calibration);
  if (report)
    WriteReport(folder.draft() / kReportFile, folder.draft() / kRigFile, files, std::move(written),
                extrinsics, calibration.result, *report);
  WriteExtrinsics(folder.draft() / kExtrinsicsFile, extrinsics);
  folder.Publish(kExtrinsicsFile, OutdatedFiles(folder.dir(), files, report.has_value()));
}

}  // namespace volalign
