#include "cli/calibration.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <system_error>
#include <utility>

#include "cli/command_line.h"
#include "cli/commands.h"
#include "cli/load_segmenter.h"
#include "cli/options.h"
#include "core/base/error.h"
#include "core/base/file_util.h"
#include "core/base/folder.h"
#include "core/base/input_file.h"
#include "core/base/progress_line.h"
#include "core/base/text.h"
#include "core/config/config.h"
#include "core/geometry/structure.h"
#include "infer/calib/calibrate.h"
#include "infer/capture/capture.h"
#include "infer/report/export.h"
#include "infer/report/pose_format.h"

namespace volalign {

namespace {

CalibrateOptions Resolve(const CalibrationRequest& request) {
  ConfigSource source = ReadSource(request.config, request.assignments);
  if (!request.initial.empty()) source.Set("initial.method=" + request.initial);
  if (!request.estimate.empty()) source.Set("refine.estimate=" + request.estimate);
  auto config = ReadConfig<CalibrateOptions>(source);
  if (!request.choose.empty()) config.orientation.choose = request.choose;
  return config;
}

struct Labeller {
  std::unique_ptr<NetworkSegmenter> network;  ///< null: the structure's shape alone
  std::string choice;                         ///< which one and why, for a person
};

/// The network of --model. Throws ConfigError if there is no structure either.
Labeller ChooseLabeller(const std::string& model, const Structure* structure,
                        const CalibrateOptions& config) {
  constexpr char kGeometry[] = "model: none, poses come from the structure's shape";
  const auto load = [&](const std::string& file, const Structure* of) {
    return LoadSegmenter(file, of, config.device, config.threads);
  };
  if (model == "none") {
    if (structure) return {nullptr, kGeometry};
    throw ConfigError(
        "--model none needs a structure; describe the boxes in a YAML, or take a mesh, and give it "
        "with --structure");
  }
  if (model != "shipped") return {load(model, structure), "model: " + model};
  std::error_code error;
  if (!std::filesystem::exists(FindInputFile(kShippedModel), error)) {
    if (structure) return {nullptr, fmt::format("{} ({} is not there)", kGeometry, kShippedModel)};
    throw ConfigError(
        fmt::format("there is neither a structure nor {}; describe the boxes in a YAML and give it "
                    "with --structure",
                    kShippedModel));
  }
  Labeller labeller{load(kShippedModel, nullptr), ""};
  // It has learnt this structure alone, not others with its labels.
  if (structure && structure->Hash() != labeller.network->structure().Hash()) {
    return {nullptr,
            fmt::format("{} (the shipped model does not know {})", kGeometry, structure->name())};
  }
  labeller.choice = structure
                        ? fmt::format("model: {}, which knows {}", kShippedModel, structure->name())
                        : fmt::format(
                              "model: {}, with the structure that it knows, since neither the "
                              "capture nor --structure names one",
                              kShippedModel);
  return labeller;
}

/// Gives each sensor that --prior names its pose there.
void GivePriors(const CalibrationRequest& request, std::vector<Capture>* captures) {
  if (request.prior.empty()) return;
  PosePrior prior;
  FromWord(request.prior_scale, &prior.world);
  prior.sigma_m = request.prior_sigma[0];
  prior.sigma_deg = request.prior_sigma[1];
  std::vector<std::string> names;
  int given = 0;
  for (const SensorPose& pose : ReadPoses(request.prior, request.prior_from)) {
    names.push_back(pose.name);
    prior.world_from_sensor = pose.structure_from_sensor;
    for (Capture& capture : *captures) {
      for (SensorFrame& frame : capture.frames) {
        if (frame.name != pose.name) continue;
        frame.prior = prior;
        ++given;
      }
    }
  }
  if (given == 0) {
    throw ConfigError(
        fmt::format("--prior {}: it has poses of {}, and none is a sensor of the "
                    "capture; sensors have to have the same names in both",
                    request.prior, Shortened(fmt::format("{}", fmt::join(names, ", ")))));
  }
}

/// --structure, else the captures' structure; none: the model's own serves. Throws ConfigError if
/// captures name different ones.
std::optional<Structure> GivenStructure(const CalibrationRequest& request,
                                        const std::vector<CaptureFile>& captures) {
  if (!request.structure.empty()) return ReadStructure(request.structure);
  std::optional<Structure> structure;
  for (const CaptureFile& capture : captures) {
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

/// Next commands for the report, with this run's files. NEW.json stands for a later capture.
std::vector<std::string> NextCommands(const CalibrationRequest& request) {
  const auto in_output = [&](const char* name) {
    return ShellWord((std::filesystem::path(request.output) / name).string());
  };
  std::string captures, options;
  for (const std::string& capture : request.captures) captures += " " + ShellWord(capture);
  if (!request.structure.empty()) options += " --structure " + ShellWord(request.structure);
  if (request.model != "shipped") options += " --model " + ShellWord(request.model);
  const std::string poses = in_output("extrinsics.json");
  return {fmt::format("# for another program, here Open3D\nvolalign convert {} --to open3d -o {}",
                      poses, in_output("open3d.json")),
          fmt::format(
              "# has a sensor moved since?\nvolalign check --extrinsics {} --capture NEW.json{}",
              poses, options),
          fmt::format("# with a second capture, before which only the stack was moved\n"
                      "volalign calibrate --capture{} NEW.json{} -o {}",
                      captures, options, in_output("both"))};
}

}  // namespace

void AddCalibrationOptions(CLI::App* app, CalibrationRequest* request) {
  app->add_option(
         "--model", request->model,
         "checkpoint, or its ONNX export. shipped: the program's own, models/m05-lite.safetensors, "
         "or none if that does not know the structure. none: poses come from the structure's "
         "shape alone")
      ->capture_default_str();
  app->add_option(
      "--structure", request->structure,
      "the structure: .yaml, or a mesh (.glb, .gltf, .obj, .stl, .ply). Without it: that "
      "of the capture, else that of the model");
  app->add_option("--initial", request->initial,
                  "source of initial poses: network, geometry, or auto (the default: geometry, and "
                  "the network if there is a model)")
      ->check(CLI::IsMember(WordsOfAll<PoseMethod>()));
  app->add_option("--estimate", request->estimate,
                  "beside the poses: auto (the default), none, or a list of boxes, size, "
                  "depth_gain, depth_offset, lens; refine.estimate of the config");
  app->add_option("--choose", request->choose,
                  "SENSOR=NUMBER: takes that one of several poses that fit a sensor (`twins` in "
                  "extrinsics.json, and in the report). The other sensors follow. 1 is the pose "
                  "that would be chosen")
      ->take_all();
  app->add_option_function<std::string>("--twin",
                                        [](const std::string&) {
                                          throw CLI::ValidationError(
                                              "--twin", "--choose SENSOR=NUMBER does this now");
                                        })
      ->group("");
  CLI::Option* const prior =
      app->add_option("--prior", request->prior,
                      "file with poses that are known beforehand, in any format that convert "
                      "reads. Sensors with the same names use them as priors");
  app->add_option("--prior-from", request->prior_from, "format of --prior, as convert --from")
      ->capture_default_str();
  CLI::Option* const sigma =
      app->add_option("--prior-sigma", request->prior_sigma,
                      "how exact --prior is: standard deviations M,DEG of position and rotation, "
                      "e.g. 0.05,3")
          ->delimiter(',')
          ->expected(2)
          ->needs(prior);
  prior->needs(sigma);
  app->add_option("--prior-scale", request->prior_scale,
                  "metric: --prior is in metres; free: in a unit that is not known (three sensors "
                  "or more)")
      ->check(CLI::IsMember({ToString(PriorWorld::kMetric), ToString(PriorWorld::kScaleFree)}))
      ->capture_default_str();
  app->add_option("--config", request->config, "YAML of calibration options (docs/config.md)");
  AddSettings(app, &request->assignments, "the config, e.g. refine.box_sigma_m=0.01", "",
              "threads over sensors");
  app->add_option("--note", request->note,
                  "a note for the report and extrinsics.json, e.g. \"S3 on the new tripod\"");
  app->add_flag("--no-report", request->no_report, "write neither report.html nor rig.glb");
  request->table.AddOptions(app);
}

WrittenCalibration RunCalibration(const CalibrationRequest& request,
                                  const CompleteReport& complete) {
  const CalibrateOptions config = Resolve(request);

  ProgressLine line;
  line.Begin("reading");
  const auto start = std::chrono::steady_clock::now();
  std::vector<CaptureFile> read;
  for (const std::string& capture : request.captures) read.push_back(ReadCapture(capture));
  const std::optional<Structure> given = GivenStructure(request, read);
  std::vector<Capture> captures = NameCaptures(std::move(read));
  GivePriors(request, &captures);
  const Labeller labeller = ChooseLabeller(request.model, given ? &*given : nullptr, config);
  NetworkSegmenter* const segmenter = labeller.network.get();
  const Structure& structure = given ? *given : segmenter->structure();
  if (!given && request.last_structure && request.last_structure->sha256 != structure.Hash()) {
    throw ConfigError(
        fmt::format("the last calibration has the structure \"{}\", and the model knows \"{}\"; "
                    "the capture names none: give that of the last calibration with --structure",
                    request.last_structure->name, structure.name()));
  }
  WarnOf(structure);
  const std::chrono::duration<double> loading = std::chrono::steady_clock::now() - start;

  std::optional<WorldObservation> world;
  if (!request.world.empty()) world = ReadWorldObservation(request.world);

  // This comes before the work, because it fails if nobody can write there.
  std::optional<ResultFolder> folder;
  bool replaced = false;
  if (!request.output.empty()) {
    folder.emplace(request.output);
    std::error_code error;
    replaced = std::filesystem::exists(folder->dir() / "extrinsics.json", error);
  }
  WrittenCalibration out{
      CalibrateFiles(std::move(captures), request.captures, structure, segmenter, config,
                     [&](const std::string& stage) { line.Begin(stage); }),
      ""};
  if (!given && 2 * out.result.placed() < static_cast<int>(out.result.sensors.size())) {
    out.result.findings.insert(out.result.findings.begin(),
                               {RigCode::kStructureAssumed,
                                {},
                                fmt::format("no structure was given, and most sensors do not see "
                                            "\"{}\", the structure that the model knows",
                                            structure.name()),
                                "describe your boxes in a YAML, and give it with --structure"});
  }
  out.result.timings_s.back().second += loading.count();
  out.result.timings_s.insert(out.result.timings_s.begin(), {"load", loading.count()});
  out.source.note = request.note;
  if (world) out.source.world = FindWorldFrame(*world, out.result, structure);
  ReportRun report{CommandLine(), out.options, NextCommands(request)};
  if (complete) complete(out, &report);
  if (folder) {
    line.Begin("writing poses, pictures, clouds and the report");
    SaveCommand(folder->draft());
    WriteCalibration(*folder, out, request.no_report ? std::nullopt : std::optional(report));
    out.written = fmt::format(
        "{}/{}extrinsics.json, options.yaml, labels/, confidence/, pictures/, clouds/{}",
        request.output, request.no_report ? "" : "report.html, rig.glb, ",
        replaced ? " (in place of an earlier result)" : "");
  }
  line.Stop();
  request.table.Say(labeller.choice);
  if (out.source.world) request.table.Say(WorldSentence(*out.source.world));
  return out;
}

}  // namespace volalign
