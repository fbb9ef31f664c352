#include <fmt/format.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "cli/commands.h"
#include "core/error.h"
#include "render/capture_writer.h"
#include "render/depth_renderer.h"
#include "render/egl_context.h"
#include "render/rig.h"
#include "render/sample.h"
#include "train/train_config.h"

namespace volalign {

Command AddRenderCommand(CLI::App& program) {
  struct Options {
    std::string rig, config, output;
    std::vector<std::string> assignments;
    std::uint64_t index = 0;
    int count = 24;
    int device = -1;
  };
  auto options = std::make_shared<Options>();
  CLI::App* app =
      program.add_subcommand("render", "Render a multi-sensor capture, or training samples");
  CLI::Option* rig =
      app->add_option("--rig", options->rig, "rig.yaml: write one capture with ground truth");
  app->add_option("--config", options->config,
                  "training recipe: write samples as training sees them")
      ->excludes(rig);
  app->add_option("--set", options->assignments, "KEY=VALUE over the rig or recipe")->take_all();
  app->add_option("-o,--output", options->output, "folder to write")->required();
  app->add_option("--index", options->index, "first sample")->excludes(rig);
  app->add_option("--count", options->count, "number of samples")
      ->check(CLI::Range(1, 100000000))
      ->excludes(rig);
  app->add_option("--device", options->device,
                  "EGL device; the first that works, or software, without it");
  return {
      app, [options] {
        if (options->rig.empty() == options->config.empty()) {
          throw ConfigError(
              "render wants --rig RIG.yaml for a capture, or --config RECIPE.yaml for samples");
        }
        ConfigSource source =
            ConfigSource::FromFile(options->rig.empty() ? options->config : options->rig);
        for (const std::string& assignment : options->assignments) source.Set(assignment);
        EglContextOptions context_options;
        context_options.device = options->device;
        const EglContext egl(context_options);
        DepthRenderer renderer;
        fmt::print("renderer: {}\n", egl.Describe());
        if (!options->rig.empty()) {
          const RigCapture capture = RenderRig(ReadRig(source), renderer);
          WriteCapture(options->output, capture);
          for (const CapturedSensor& sensor : capture.sensors) {
            const Eigen::Vector3d p = sensor.structure_from_sensor.translation();
            fmt::print("{:<12} {:<26} {}x{}  at ({:+.3f}, {:+.3f}, {:+.3f}) m\n", sensor.name,
                       sensor.sensor, sensor.intrinsics.width, sensor.intrinsics.height, p.x(),
                       p.y(), p.z());
          }
          fmt::print("written: {}/capture.json, contact_sheet.png\n", options->output);
        } else {
          const TrainConfig recipe = ReadTrainConfig(source);
          WriteSamples(options->output, MakeSampleContext(recipe.data, recipe.run.batch_size),
                       renderer, static_cast<std::uint64_t>(recipe.run.seed), options->index,
                       options->count);
          fmt::print(
              "written: {} samples from index {} of seed {} to {}/index.json, contact_sheet.png\n",
              options->count, options->index, recipe.run.seed, options->output);
        }
        return 0;
      }};
}

}  // namespace volalign
