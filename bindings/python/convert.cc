#include <fmt/format.h>
#include <pybind11/stl.h>

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "bindings/python/arrays.h"
#include "bindings/python/module.h"
#include "bindings/python/options.h"
#include "bindings/python/result.h"
#include "core/base/error.h"
#include "core/base/folder.h"
#include "infer/formats/kinect_calibration.h"
#include "infer/report/pose_format.h"

namespace volalign::python {

namespace {

std::vector<SensorPose> GivenPoses(const py::dict& poses) {
  std::vector<SensorPose> list;
  for (const auto& [key, value] : poses) {
    SensorPose pose;
    if (py::isinstance<SensorPose>(value)) {
      pose = value.cast<SensorPose>();
    } else {
      pose.structure_from_sensor = PoseOf(value, py::str(key));
    }
    pose.name = py::str(key);
    list.push_back(std::move(pose));
  }
  return list;
}

using ColourFiles = std::map<std::string, Path>;

ColourCameras CamerasOf(const ColourFiles& files) {
  ColourCameras cameras;
  for (const auto& [name, file] : files) cameras[name] = ReadKinectColour(PathOf(file));
  return cameras;
}

std::vector<std::string> Write(const std::string& path, const std::string& format,
                               std::vector<SensorPose> poses, const ColourCameras& cameras,
                               const WorldChoice& choice = {}) {
  for (SensorPose& pose : poses) {
    const auto given = cameras.find(pose.name);
    if (given != cameras.end()) pose.colour = given->second;
  }
  if (!IsFolder(format)) return WritePoses(path, format, poses, choice);
  const ResultFolder folder(path);
  std::vector<std::string> notes = WritePoses(folder.draft(), format, poses, choice);
  folder.Publish("");
  return notes;
}

WorldChoice ChoiceOf(const std::optional<std::string>& origin, const std::optional<std::string>& up,
                     const std::string& camera, const std::string& poses_for,
                     const std::optional<std::string>& frame) {
  if (poses_for != "corrected" && poses_for != "raw")
    throw ConfigError(fmt::format("poses_for = '{}': use corrected or raw", poses_for));
  if (camera != "depth" && camera != "colour")
    throw ConfigError(fmt::format("camera = '{}': use depth or colour", camera));
  if (up && *up != "y" && *up != "z") throw ConfigError(fmt::format("up = '{}': use y or z", *up));
  WorldChoice choice;
  choice.origin = origin.value_or("");
  choice.up = up.value_or("");
  choice.colour = camera == "colour";
  choice.raw = poses_for == "raw";
  choice.frame = frame.value_or("");
  return choice;
}

std::vector<std::string> Convert(const py::object& source, const std::string& format,
                                 const Path& output, const std::string& from_format,
                                 const ColourFiles& colour_cameras,
                                 const std::optional<std::string>& origin,
                                 const std::optional<std::string>& up, const std::string& camera,
                                 const std::string& poses_for,
                                 const std::optional<std::string>& frame) {
  const std::string &to = format, &from = from_format;
  static_cast<void>(IsFolder(to));  // an unknown word is an error before anything is read
  const ColourCameras cameras = CamerasOf(colour_cameras);
  WorldChoice choice = ChoiceOf(origin, up, camera, poses_for, frame);
  std::vector<SensorPose> poses;
  if (py::isinstance<Calibration>(source)) {
    const Extrinsics extrinsics = MakeExtrinsics(source.cast<const Calibration&>());
    poses = PosesOf(extrinsics);
    choice.floor_m = extrinsics.structure.floor_m;
    choice.world = extrinsics.world;
  } else {
    if (choice.raw && from != kVolalignPoses)
      throw ConfigError("poses_for = 'raw' needs a Result or an extrinsics.json");
    poses = ReadPoses(PathOf(source), from, cameras);
    ReadWorld(PathOf(source), from, &choice);
  }
  return Write(PathOf(output), to, std::move(poses), cameras, choice);
}

std::map<std::string, SensorPose> Read(const Path& path, const std::string& format,
                                       const ColourFiles& colour_cameras) {
  std::map<std::string, SensorPose> poses;
  for (SensorPose& pose : ReadPoses(PathOf(path), format, CamerasOf(colour_cameras)))
    poses[pose.name] = std::move(pose);
  return poses;
}

constexpr char kColourCameras[] =
    "colour_cameras: by a sensor's name, the raw calibration JSON of that Azure Kinect, which "
    "livescan3d_azure needs of every sensor. ";

}  // namespace

void AddConvert(py::module_& module) {
  py::class_<SensorPose>(module, "SensorPose",
                         "A sensor's pose and, where they are known, its "
                         "intrinsics.")
      .def(py::init([](const py::object& pose, std::optional<Intrinsics> intrinsics) {
             return SensorPose{
                 "", PoseOf(pose, "structure_from_sensor"), std::move(intrinsics), {}, {}};
           }),
           py::arg("structure_from_sensor"), py::arg("intrinsics") = py::none())
      .def_readonly("structure_from_sensor", &SensorPose::structure_from_sensor,
                    "(4, 4) float64, m; sensor x right, y down, z forward.")
      .def_readonly("intrinsics", &SensorPose::intrinsics)
      .def_readonly("depth_gain", &SensorPose::depth_gain,
                    "True depth = depth_gain * measured depth + depth_offset_m.")
      .def_readonly("depth_offset_m", &SensorPose::depth_offset_m, "m; see depth_gain.");

  py::list formats;
  for (const std::string& word : PoseFormats()) formats.append(word);
  module.attr("pose_formats") = py::tuple(formats);

  const std::string colour = kColourCameras;
  module.def(
      "convert", &Convert, py::arg("source"), py::arg("format"), py::arg("output"), py::kw_only(),
      py::arg("from_format") = "volalign", py::arg("colour_cameras") = ColourFiles(),
      py::arg("origin") = py::none(), py::arg("up") = py::none(), py::arg("camera") = "depth",
      py::arg("poses_for") = "corrected", py::arg("frame") = py::none(),
      ("Writes poses as another program reads them (docs/conversion.md).\n\n"
       "source: a Result, or a file or folder of from_format. format: one of pose_formats "
       "but volalign. output: a file; a folder for colmap, depth_correction, volumetric_capture "
       "and livescan3d_... " +
       colour +
       "\norigin: origin of the written poses: structure, floor (the point of the floor below the "
       "structure's origin), world (that of calibrate) or a sensor's name. None: world if there is "
       "one, else structure.\nup: y or z, the axis that is up. None: that of "
       "the format, or that sensor's own axes if a sensor is the origin.\ncamera: depth or colour, "
       "whose poses and intrinsics are written.\nposes_for: corrected or raw, the depths that the "
       "poses fit.\nframe: name of the world in ros, ros_launch and urdf. Returns what the format "
       "has no place for, a sentence each. Raises ConfigError, DataError, IoError.")
          .c_str());
  module.def("read_poses", &Read, py::arg("path"), py::arg("format") = "volalign", py::kw_only(),
             py::arg("colour_cameras") = ColourFiles(),
             ("SensorPose by name, of a file or folder of a format that can be read. " + colour +
              "Raises ConfigError, DataError, IoError.")
                 .c_str());
  module.def(
      "write_poses",
      [](const Path& path, const std::string& format, const py::dict& poses,
         const ColourFiles& colour_cameras) {
        return Write(PathOf(path), format, GivenPoses(poses), CamerasOf(colour_cameras));
      },
      py::arg("path"), py::arg("format"), py::arg("poses"), py::kw_only(),
      py::arg("colour_cameras") = ColourFiles(),
      ("The other way: poses is a dict of SensorPose or (4, 4) arrays. " + colour +
       "Returns what the format has no place for. Raises ConfigError, DataError, IoError.")
          .c_str());
}

}  // namespace volalign::python
