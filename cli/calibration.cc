#include "cli/calibration.h"

#include <fmt/format.h>

#include <chrono>
#include <memory>
#include <optional>
#include <utility>

#include "cli/command_line.h"
#include "cli/load_segmenter.h"
#include "cli/options.h"
#include "cli/stage_progress.h"
#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/base/folder.h"
#include "core/config/config.h"
#include "core/formats/structure_gltf.h"
#include "infer/calib/calibrate.h"
#include "infer/capture/capture.h"
#include "infer/report/export.h"

namespace volalign {

namespace {

CalibrateOptions Resolve(const CalibrationRequest& request) {
  ConfigSource source = ReadSource(request.config, request.assignments);
  if (!request.initial.empty()) source.Set("initial.method=" + request.initial);
  if (!request.estimate.empty()) source.Set("refine.estimate=" + request.estimate);
  return ReadConfig<CalibrateOptions>(source);
}

/// --structure, else the captures'; none: the model's own serves. Throws ConfigError where captures
/// name different ones.
std::optional<Structure> GivenStructure(const CalibrationRequest& request,
                                        const std::vector<Capture>& captures) {
  if (!request.structure.empty()) return ReadStructure(request.structure);
  std::optional<Structure> structure;
  for (const Capture& capture : captures) {
    if (!capture.structure) continue;
    Structure read = ReadStructure(*capture.structure);
    if (structure && structure->Hash() != read.Hash()) {
      throw ConfigError(fmt::format(
          "{} has another structure than the captures before it; give the one with --structure",
          capture.path.string()));
    }
    structure = std::move(read);
  }
  return structure;
}

}  // namespace

void AddCalibrationOptions(CLI::App* app, CalibrationRequest* request) {
  app->add_option("--model", request->model,
                  "checkpoint, e.g. models/m05-lite.pt, or its ONNX export; without it, poses come "
                  "from the shape of "
                  "the structure alone, whatever its boxes");
  app->add_option(
      "--structure", request->structure,
      "the structure (.glb or .yaml), where neither the capture nor the model has it, or has other "
      "dimensions");
  app->add_option("--initial", request->initial,
                  "what initial poses come from: network, geometry, auto (the default: geometry, "
                  "and the network where there is a model), or paper (the paper's estimator)")
      ->check(CLI::IsMember({"auto", "network", "geometry", "paper"}));
  app->add_option("--estimate", request->estimate,
                  "beside the poses: auto (the default), none, or a list of boxes, size, "
                  "depth_gain, depth_offset, lens; refine.estimate of the config");
  app->add_option("--config", request->config, "YAML of calibration options (docs/config.md)");
  app->add_option("--set", request->assignments, "KEY=VALUE over the config, e.g. refine.threads=1")
      ->take_all();
  AddAssignment(app, "--threads", "threads", &request->assignments, "threads over sensors");
  AddAssignment(app, "--device", "device", &request->assignments, "cpu, cuda or cuda:N");
  app->add_flag("--no-report", request->no_report, "write neither report.html nor rig.glb");
}

Calibration RunCalibration(const CalibrationRequest& request) {
  const CalibrateOptions config = Resolve(request);

  const auto start = std::chrono::steady_clock::now();
  std::vector<Capture> captures;
  for (const std::string& capture : request.captures) captures.push_back(ReadCapture(capture));
  std::optional<Structure> structure = GivenStructure(request, captures);
  Calibration out;
  out.stills = StillsOf(std::move(captures));
  std::unique_ptr<NetworkSegmenter> segmenter;
  if (!request.model.empty()) {
    segmenter = LoadSegmenter(request.model, structure ? &*structure : nullptr, config.device,
                              config.threads);
  }
  if (!structure && !segmenter) {
    throw ConfigError(
        "there is neither a model nor a structure; describe the boxes in a YAML and give it with "
        "--structure");
  }
  out.structure = structure ? *structure : segmenter->structure();
  const std::chrono::duration<double> loading = std::chrono::steady_clock::now() - start;

  // Before the work: whether one can write there.
  std::optional<ResultFolder> folder;
  if (!request.output.empty()) folder.emplace(request.output);
  {
    StageProgress progress;
    out.result = Calibrate(out.stills, out.structure, segmenter.get(), config,
                           [&progress](const std::string& stage) { progress.Begin(stage); });
  }
  out.result.timings_s.back().second += loading.count();
  out.result.timings_s.insert(out.result.timings_s.begin(), {"load", loading.count()});
  out.source = {request.captures, segmenter ? segmenter->file() : "",
                segmenter ? segmenter->sha256() : ""};
  out.options = WriteConfig(config);
  if (folder) {
    WriteFileAtomically(folder->draft() / "options.yaml", out.options);
    SaveCommand(folder->draft());
    std::optional<ReportRun> report;
    if (!request.no_report) report = ReportRun{CommandLine(), out.options};
    WriteCalibration(*folder, out.result, out.stills, out.structure, out.source, report);
  }
  return out;
}

std::string WrittenBy(const CalibrationRequest& request) {
  return fmt::format("{}/{}extrinsics.json, options.yaml, labels/, confidence/, pictures/, clouds/",
                     request.output, request.no_report ? "" : "report.html, rig.glb, ");
}

}  // namespace volalign
