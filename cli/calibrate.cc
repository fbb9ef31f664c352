#include <memory>

#include "cli/calibration.h"
#include "cli/commands.h"
#include "infer/report/report.h"
#include "infer/report/sensors_table.h"

namespace volalign {

Command AddCalibrateCommand(CLI::App& program) {
  auto request = std::make_shared<CalibrationRequest>();
  CLI::App* app = program.add_subcommand("calibrate", "Find the poses of a capture's sensors");
  app->add_option(
         "--capture", request->captures,
         "capture.json; several, of the same sensors, where the stack was moved between them: "
         "poses are in the frame of the stack in the first")
      ->required();
  app->add_option("-o,--output", request->output, "folder for poses, pictures and clouds")
      ->required();
  AddCalibrationOptions(app, request.get());
  app->add_option(
      "--world", request->world,
      "file that says where the structure stands in a frame of yours: its pose, touched "
      "corners, or the poses of the robot that carries it (docs/world.md)");
  return {app, [request] {
            const WrittenCalibration calibration = RunCalibration(*request);
            const CalibrationResult& result = calibration.result;
            request->table.Print(FormatReport(result), SensorsTable(result.sensors));
            request->table.Say("written: " + calibration.written);
            return result.placed() == static_cast<int>(result.sensors.size()) ? 0 : 2;
          }};
}

}  // namespace volalign
