// The example at the end of each sub-command's help. Each works in any folder: the lines before the
// last one make its input, or the data folder has it. tests/cli/command_line.py runs them all.

#include <map>

#include "cli/app_tree.h"
#include "core/base/text.h"

namespace volalign {

namespace {

const std::map<std::string, std::string>& Examples() {
  const std::string render = "volalign render --rig configs/rig_ring4.yaml -o out/capture\n";
  const std::string calibrate =
      render + "volalign calibrate --capture out/capture/capture.json -o out/calibration\n";
  const std::string train =
      "volalign train --config configs/m05-lite.yaml --set run.samples=32 "
      "--set run.validation_samples=16 --set optim.warmup_samples=16 -o out/try\n";
  static const std::map<std::string, std::string> examples = {
      {"add", calibrate + "volalign add --extrinsics out/calibration/extrinsics.json --capture "
                          "out/capture/capture.json -o out/rig.json\n"},
      {"calibrate", calibrate},
      {"init", render + "volalign init out/capture --depth-scale 0.001 -o out/draft.json\n"},
      {"check", calibrate + "volalign check --extrinsics out/calibration/extrinsics.json --capture "
                            "out/capture/capture.json -o out/check\n"},
      {"config reference", "volalign config reference\n"},
      {"config show", "volalign config show configs/rig_ring4.yaml --set seed=7\n"},
      {"convert",
       calibrate + "volalign convert out/calibration/extrinsics.json --to colmap -o out/colmap\n"},
      {"doctor", "volalign doctor\n"},
      {"evaluate", "volalign evaluate --rig configs/rig_ring4.yaml --seeds 7 -o out/evaluation\n"},
      {"export",
       "volalign export --model models/m05-lite.safetensors --format onnx -o out/m05-lite.onnx\n"},
      {"plan", "volalign plan configs/rig_ring4.yaml -o out/plan.svg\n"},
      {"render", render},
      {"runs compare", train + "volalign runs compare out --csv\n"},
      {"runs list", train + "volalign runs list out\n"},
      {"structure build", "volalign structure build configs/structure.yaml -o out/structure.glb\n"},
      {"structure check", "volalign structure check configs/structure.yaml\n"},
      {"structure sheet", "volalign structure sheet configs/structure.yaml -o out/build.svg\n"},
      {"structure show", "volalign structure show configs/structure.yaml\n"},
      {"structure suggest",
       "volalign structure suggest '2x 500x400x300, 400x300x250' -o out/my_boxes.yaml\n"},
      {"train", train},
      {"validate",
       "volalign validate --model models/m05-lite.safetensors --samples 16 -o out/scores.json\n"}};
  return examples;
}

}  // namespace

void AddExamples(CLI::App* program) {
  ForEachApp(program, [](CLI::App* app, const std::string& path) {
    // A group has the example of its first sub-command.
    const auto found = Examples().lower_bound(path);
    if (path.empty() || found == Examples().end() || found->first.rfind(path, 0) != 0) return;
    std::string text = "Example:\n" + Indented(found->second, "  ");
    text.pop_back();
    app->footer(text);
  });
}

}  // namespace volalign
