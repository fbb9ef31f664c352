#include "infer/evaluate/evaluate.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "cli/commands.h"
#include "core/error.h"
#include "core/file_util.h"
#include "infer/view/segmenter.h"
#include "render/depth_renderer.h"
#include "render/egl_context.h"
#include "render/rig.h"

namespace volalign {

namespace {

/// Turns the structure on between seeds: consecutive multiples of the golden angle never bunch.
constexpr double kGoldenAngleDeg = 137.50776405003785;

/// "configs/rig_ring8.yaml" -> "ring8"
std::string RigName(const std::string& path) {
  const std::string stem = std::filesystem::path(path).stem().string();
  return stem.rfind("rig_", 0) == 0 ? stem.substr(4) : stem;
}

/// The options that `compare` ("initial.method=paper,robust") asks for, in order; one, named after
/// the defaults, without it.
std::vector<EvaluationVariant> Variants(const ConfigSource& source, const std::string& compare) {
  if (compare.empty()) return {{"volalign", ReadConfig<CalibrateOptions>(source)}};
  const std::size_t equals = compare.find('=');
  if (equals == std::string::npos || equals == 0 || equals + 1 == compare.size()) {
    throw ConfigError(fmt::format(
        "--compare {}: KEY=VALUE,VALUE is expected, as in refine.edge_weight=1,30", compare));
  }
  std::vector<EvaluationVariant> variants;
  std::set<std::string> names;
  for (std::size_t begin = equals + 1; begin <= compare.size();) {
    const std::size_t comma = std::min(compare.find(',', begin), compare.size());
    const std::string value = compare.substr(begin, comma - begin);
    if (!names.insert(value).second) {
      throw ConfigError(fmt::format("--compare {}: {} stands twice", compare, value));
    }
    ConfigSource own = source;
    own.Set(compare.substr(0, equals + 1) + value);
    variants.push_back({value, ReadConfig<CalibrateOptions>(own)});
    begin = comma + 1;
  }
  return variants;
}

}  // namespace

Command AddEvaluateCommand(CLI::App& program) {
  struct Options {
    std::string model, output, config, seeds, compare;
    std::vector<std::string> rigs, sensors, captures, assignments, rig_assignments;
    bool keep_yaw = false;
    int device = -1;
  };
  auto options = std::make_shared<Options>();
  CLI::App* app = program.add_subcommand(
      "evaluate", "Measure calibration on rendered rigs with known poses, or on captures");
  app->add_option("--model", options->model, "checkpoint, e.g. models/m05-lite.pt")->required();
  app->add_option("--rigs", options->rigs, "rig.yaml files, rendered in memory");
  app->add_option("--sensors", options->sensors,
                  "run each rig with each of these models for all its sensors, e.g. "
                  "azure_kinect_nfov_binned realsense_d415; without it, with the rig's own");
  app->add_option("--seeds", options->seeds,
                  "FIRST:END (END not included) or a list with commas; the rig's own without it");
  app->add_option("--captures", options->captures,
                  "capture.json files, scored by residuals and, where they have it, ground truth");
  app->add_option("--compare", options->compare,
                  "KEY=VALUE,VALUE: a calibration option under which each still is calibrated with "
                  "each value, side by side");
  app->add_option("--config", options->config, "YAML of calibration options (docs/config.md)");
  app->add_option("--set", options->assignments, "KEY=VALUE over the calibration options")
      ->take_all();
  app->add_option("--set-rig", options->rig_assignments, "KEY=VALUE over every rig")->take_all();
  app->add_flag("--keep-yaw", options->keep_yaw,
                "leave the structure as the rig turns it; else each seed turns it by the golden "
                "angle more");
  app->add_option("--device", options->device,
                  "EGL device; the first that works, or software, without it");
  app->add_option("-o,--output", options->output,
                  "folder for evaluation.json; what a killed run left there is not done again")
      ->required();
  return {app, [options] {
            if (options->rigs.empty() && options->captures.empty()) {
              throw ConfigError(
                  "evaluate wants --rigs RIG.yaml ..., --captures capture.json ..., or both");
            }
            ConfigSource source =
                options->config.empty() ? ConfigSource() : ConfigSource::FromFile(options->config);
            for (const std::string& assignment : options->assignments) source.Set(assignment);
            const std::vector<EvaluationVariant> variants = Variants(source, options->compare);
            std::vector<Rig> rigs;
            std::set<std::string> names;
            for (const std::string& path : options->rigs) {
              if (!names.insert(RigName(path)).second) {
                throw ConfigError(fmt::format("--rigs: two are named {}", RigName(path)));
              }
              ConfigSource rig_source = ConfigSource::FromFile(path);
              for (const std::string& assignment : options->rig_assignments)
                rig_source.Set(assignment);
              rigs.push_back(ReadRig(rig_source));
            }
            std::vector<std::uint64_t> seeds;
            if (!options->seeds.empty()) seeds = ParseSeeds(options->seeds);
            std::vector<std::string> models = options->sensors;
            if (models.empty()) models.emplace_back();

            const std::unique_ptr<NetworkSegmenter> segmenter =
                LoadNetworkSegmenter(options->model, nullptr, variants.front().options.threads);
            std::optional<EglContext> egl;
            std::optional<DepthRenderer> renderer;
            if (!rigs.empty()) {
              EglContextOptions context_options;
              context_options.device = options->device;
              egl.emplace(context_options);
              renderer.emplace();
              fmt::print(stderr, "renderer: {}\n", egl->Describe());
            }

            std::vector<EvaluationItem> items;
            for (std::size_t r = 0; r < rigs.size(); ++r) {
              const std::vector<std::uint64_t> own{rigs[r].seed};
              for (const std::string& model : models) {
                for (const std::uint64_t seed : seeds.empty() ? own : seeds) {
                  Rig rig = rigs[r];
                  rig.seed = seed;
                  if (!options->keep_yaw) {
                    rig.structure_yaw_deg = std::fmod(
                        rig.structure_yaw_deg + kGoldenAngleDeg * static_cast<double>(seed), 360.0);
                  }
                  items.push_back(RigItem(RigName(options->rigs[r]), rig, model, &*renderer));
                }
              }
            }
            for (const std::string& capture : options->captures) {
              items.push_back(CaptureItem(capture, segmenter->structure()));
            }
            EvaluateRun run;
            run.output = std::filesystem::path(options->output) / "evaluation.json";
            run.model_file = segmenter->file();
            run.model_sha256 = segmenter->sha256();
            run.program = Sha256(ReadFile("/proc/self/exe"));
            run.progress = [](const std::string& line) {
              fmt::print(stderr, "{}\n", line);
              std::fflush(stderr);
            };
            const std::vector<EvaluatedCase> cases =
                Evaluate(items, variants, *segmenter, segmenter->structure(), run);
            fmt::print("{}", FormatEvaluation(cases));
            std::fflush(stdout);
            fmt::print(stderr, "written: {}\n", run.output.string());
            return 0;
          }};
}

}  // namespace volalign
