#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <exception>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "bindings/c/volalign.h"
#include "core/base/error.h"
#include "core/base/folder.h"
#include "core/base/input_file.h"
#include "core/base/provenance.h"
#include "core/base/text.h"
#include "core/config/config.h"
#include "core/geometry/structure.h"
#include "infer/capture/capture.h"
#include "infer/formats/depth_file.h"
#include "infer/report/export.h"
#include "infer/segment_onnx/load.h"

struct volalign_capture {
  std::optional<volalign::Structure> structure;
  std::vector<volalign::Capture> captures;
  std::vector<std::string> files;  // of each capture
};

struct volalign_options {
  volalign::ConfigSource source;
  volalign::CalibrateOptions values;
};

struct volalign_model {
  std::string file;
  std::unique_ptr<volalign::NetworkSegmenter> segmenter;
  std::string fits;  // hash of the structure that its labels were compared with
};

struct volalign_result {
  volalign::Calibration whole;
  std::string json;
  std::vector<std::string> about;  // of each finding
};

namespace {

using volalign::ConfigError;
using volalign::DataError;
using volalign::Error;
using volalign::IoError;

struct InvalidArgument : Error {
  using Error::Error;
};
struct Stopped : Error {
  using Error::Error;
};

thread_local std::string last_error;

volalign_code Failed(volalign_code code, const char* message) noexcept {
  try {
    last_error = message;
  } catch (...) {
    last_error.clear();
  }
  return code;
}

/// Runs `work`; what it throws becomes a code and a sentence.
template <class Work>
volalign_code Guard(const Work& work) noexcept {
  try {
    work();
    return VOLALIGN_OK;
  } catch (const InvalidArgument& error) {
    return Failed(VOLALIGN_INVALID_ARGUMENT, error.what());
  } catch (const Stopped& error) {
    return Failed(VOLALIGN_STOPPED, error.what());
  } catch (const ConfigError& error) {
    return Failed(VOLALIGN_CONFIG_ERROR, error.what());
  } catch (const DataError& error) {
    return Failed(VOLALIGN_DATA_ERROR, error.what());
  } catch (const IoError& error) {
    return Failed(VOLALIGN_IO_ERROR, error.what());
  } catch (const std::exception& error) {
    return Failed(VOLALIGN_ERROR, volalign::SentenceOf(error).c_str());
  } catch (...) {
    return Failed(VOLALIGN_ERROR, "an exception that is no std::exception");
  }
}

void Require(bool holds, const char* message) {
  if (!holds) throw InvalidArgument(message);
}

constexpr char kUnknownSize[] =
    "struct_size is of no interface that this library has; set it to "
    "the sizeof of the structure, or update libvolalign_c";

/// A path, which results name in JSON.
std::string PathOf(const char* path) {
  volalign::RequireUtf8(path, "the path");
  return path;
}

volalign::SensorFrame FrameOf(const volalign_frame& from) {
  Require(from.struct_size == sizeof(volalign_frame), kUnknownSize);
  Require(from.name, "name is NULL");
  volalign::SensorFrame frame;
  frame.name = from.name;
  if (!volalign::IsFileName(frame.name)) {
    throw DataError("the sensor's name \"" + volalign::Shortened(frame.name) +
                    "\" does not serve as the name of its files");
  }
  if (from.sensor) frame.sensor = from.sensor;
  volalign::RequirePlainText(frame.sensor, frame.name + ": sensor");
  volalign::formats_internal::RequireSize(from.width, from.height, frame.name);
  volalign::Intrinsics& intrinsics = frame.intrinsics;
  intrinsics.width = from.width;
  intrinsics.height = from.height;
  intrinsics.fx = from.fx;
  intrinsics.fy = from.fy;
  intrinsics.cx = from.cx;
  intrinsics.cy = from.cy;
  Require(from.distortion_count >= 0 && from.distortion_count <= 8,
          "distortion_count is not from 0 to 8");
  intrinsics.distortion.assign(from.distortion, from.distortion + from.distortion_count);
  intrinsics.Validate("sensor \"" + frame.name + "\"");
  Require((from.depth == nullptr) != (from.raw == nullptr), "give either depth or raw");
  frame.depth = volalign::DepthImage(from.width, from.height);
  if (from.depth) {
    std::copy_n(from.depth, frame.depth.size(), frame.depth.begin());
  } else {
    Require(from.raw_scale > 0, "raw_scale is not positive: 0.001 for millimetres");
    frame.depth_scale = from.raw_scale;
    std::transform(from.raw, from.raw + frame.depth.size(), frame.depth.begin(),
                   [&](std::uint16_t raw) { return static_cast<float>(raw * from.raw_scale); });
  }
  if (from.orientation_known) {
    Require(from.quarter_turns >= 0 && from.quarter_turns <= 3, "quarter_turns is not from 0 to 3");
    frame.quarter_turns = from.quarter_turns;
  }
  return frame;
}

/// The model, whose labels are those of `structure`.
volalign::NetworkSegmenter* Fitting(volalign_model* model,
                                    const std::optional<volalign::Structure>& structure) {
  if (!model) return nullptr;
  if (structure && model->fits != structure->Hash()) {
    model->segmenter = volalign::LoadOnnxSegmenter(model->file, &*structure);
    model->fits = structure->Hash();
  }
  return model->segmenter.get();
}

/// What `make` fills becomes the caller's, unless it throws.
template <class T, class Make>
volalign_code Created(T** handle, const Make& make) noexcept {
  if (handle) *handle = nullptr;
  return Guard([&] {
    Require(handle, "the place for the handle is NULL");
    auto made = std::make_unique<T>();
    make(made.get());
    *handle = made.release();
  });
}

const std::vector<volalign::FrameResult>& FramesOf(const volalign_result& result, int capture) {
  const auto& captures = result.whole.result.captures;
  Require(capture >= 0 && capture < std::max(1, static_cast<int>(captures.size())),
          "there is no capture of this number");
  return captures.empty() ? result.whole.result.sensors
                          : captures[static_cast<std::size_t>(capture)].sensors;
}

const volalign::FrameResult& SensorOf(const volalign_result* result, int index) {
  Require(result, "result is NULL");
  Require(index >= 0 && index < volalign_result_count(result), "there is no sensor of this number");
  return result->whole.result.sensors[static_cast<std::size_t>(index)];
}

}  // namespace

int volalign_interface(void) { return VOLALIGN_C_INTERFACE; }

const char* volalign_tool(void) {
  static const std::string tool = volalign::Tool();
  return tool.c_str();
}

const char* volalign_last_error(void) { return last_error.c_str(); }

volalign_code volalign_set_data_folder(const char* folder) {
  return Guard([&] {
    Require(folder, "folder is NULL");
    volalign::SetDataFolder(PathOf(folder));
  });
}

volalign_code volalign_capture_create(const char* structure, volalign_capture** capture) {
  return Created(capture, [&](volalign_capture* made) {
    Require(structure, "structure is NULL");
    made->structure = volalign::ReadStructure(volalign::FindInputFile(PathOf(structure)));
    made->captures.emplace_back();
    made->files.emplace_back("memory");
  });
}

volalign_code volalign_capture_read(const char* path, const char* structure,
                                    volalign_capture** capture) {
  return Created(capture, [&](volalign_capture* made) {
    Require(path, "path is NULL");
    volalign::CaptureFile read = volalign::ReadCapture(PathOf(path));
    if (structure) {
      made->structure = volalign::ReadStructure(volalign::FindInputFile(PathOf(structure)));
    } else if (read.structure) {
      made->structure = volalign::ReadStructure(*read.structure);
    }
    made->files.emplace_back(path);
    made->captures = volalign::NameCaptures({std::move(read)});
  });
}

void volalign_capture_free(volalign_capture* capture) { delete capture; }

volalign_code volalign_capture_add(volalign_capture* capture, const volalign_frame* frame) {
  return Guard([&] {
    Require(capture && frame, "capture or frame is NULL");
    capture->captures.back().frames.push_back(FrameOf(*frame));
  });
}

volalign_code volalign_capture_next_still(volalign_capture* capture) {
  return Guard([&] {
    Require(capture, "capture is NULL");
    const std::size_t number = capture->captures.size() + 1;
    if (number == 2) capture->captures.front().name = "still_1";
    capture->captures.push_back({"still_" + std::to_string(number), {}});
    capture->files.emplace_back("memory");
  });
}

volalign_code volalign_options_create(const char* yaml, volalign_options** options) {
  return Created(options, [&](volalign_options* made) {
    if (yaml) made->source = volalign::ConfigSource::FromFile(PathOf(yaml));
    made->values = volalign::ReadConfig<volalign::CalibrateOptions>(made->source);
  });
}

volalign_code volalign_options_set(volalign_options* options, const char* key, const char* value) {
  return Guard([&] {
    Require(options && key && value, "options, key or value is NULL");
    volalign::ConfigSource source = options->source;
    source.Set(std::string(key) + "=" + value);
    options->values = volalign::ReadConfig<volalign::CalibrateOptions>(source);
    options->source = std::move(source);
  });
}

void volalign_options_free(volalign_options* options) { delete options; }

volalign_code volalign_model_load(const char* onnx, volalign_model** model) {
  return Created(model, [&](volalign_model* made) {
    Require(onnx, "onnx is NULL");
    made->file = PathOf(onnx);
    made->segmenter = volalign::LoadOnnxSegmenter(onnx);
    made->fits = made->segmenter->structure().Hash();
  });
}

void volalign_model_free(volalign_model* model) { delete model; }

volalign_code volalign_calibrate(const volalign_capture* capture, volalign_model* model,
                                 const volalign_options* options, volalign_progress progress,
                                 void* user, volalign_result** result) {
  return Created(result, [&](volalign_result* made) {
    Require(capture, "capture is NULL");
    for (const volalign::Capture& each : capture->captures) {
      if (each.frames.empty()) throw DataError("the capture has a placement without a frame");
    }
    const volalign::CalibrateOptions values =
        options ? options->values : volalign::CalibrateOptions();
    volalign::NetworkSegmenter* segmenter = Fitting(model, capture->structure);
    if (!capture->structure && !segmenter) {
      throw ConfigError("neither the capture nor a model has a structure; give its file");
    }
    made->whole =
        volalign::CalibrateFiles(capture->captures, capture->files,
                                 capture->structure ? *capture->structure : segmenter->structure(),
                                 segmenter, values, [&](const std::string& stage) {
                                   if (progress && progress(stage.c_str(), user) != 0)
                                     throw Stopped("the calibration was stopped before: " + stage);
                                 });
    for (const volalign::RigFinding& finding : made->whole.result.findings)
      made->about.push_back(fmt::format("{}", fmt::join(finding.about, "\n")));
    made->json = volalign::ExtrinsicsJson(volalign::MakeExtrinsics(made->whole), "result")
                     .dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
  });
}

void volalign_result_free(volalign_result* result) { delete result; }

int volalign_result_count(const volalign_result* result) {
  return result ? static_cast<int>(result->whole.result.sensors.size()) : 0;
}

volalign_code volalign_result_sensor(const volalign_result* result, int index,
                                     volalign_sensor* sensor) {
  return Guard([&] {
    const volalign::FrameResult& from = SensorOf(result, index);
    Require(sensor, "sensor is NULL");
    Require(sensor->struct_size == sizeof(volalign_sensor), kUnknownSize);
    *sensor = {};
    sensor->struct_size = sizeof(volalign_sensor);
    sensor->name = from.name.c_str();
    sensor->status = static_cast<int>(from.status);
    sensor->code = from.code == volalign::SensorCode::kNone ? "" : volalign::ToString(from.code);
    sensor->reason = from.reason.c_str();
    sensor->hint = from.hint.c_str();
    sensor->fx = from.intrinsics.fx;
    sensor->fy = from.intrinsics.fy;
    sensor->cx = from.intrinsics.cx;
    sensor->cy = from.intrinsics.cy;
    sensor->distortion_count = static_cast<int>(from.intrinsics.distortion.size());
    std::copy(from.intrinsics.distortion.begin(), from.intrinsics.distortion.end(),
              sensor->distortion);
    sensor->rms_to_structure = from.rms_to_structure_m;
    sensor->has_pose = from.structure_from_sensor.has_value();
    if (!sensor->has_pose) return;
    using RowMajor4 = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;
    using RowMajor6 = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
    Eigen::Map<RowMajor4>(sensor->structure_from_sensor) = from.structure_from_sensor->matrix();
    Eigen::Map<RowMajor6>(sensor->covariance) = from.covariance;
    Eigen::Map<Eigen::Vector3d>(sensor->sigma_position) = from.sigma_position_m();
  });
}

int volalign_result_finding_count(const volalign_result* result) {
  return result ? static_cast<int>(result->about.size()) : 0;
}

volalign_code volalign_result_finding(const volalign_result* result, int index,
                                      volalign_finding* finding) {
  return Guard([&] {
    Require(result && finding, "result or finding is NULL");
    Require(index >= 0 && index < volalign_result_finding_count(result),
            "there is no finding of this number");
    Require(finding->struct_size == sizeof(volalign_finding), kUnknownSize);
    const auto i = static_cast<std::size_t>(index);
    const volalign::RigFinding& from = result->whole.result.findings[i];
    *finding = {sizeof(volalign_finding), volalign::ToString(from.code), result->about[i].c_str(),
                from.reason.c_str(), from.hint.c_str()};
  });
}

volalign_code volalign_result_labels(const volalign_result* result, int index, int capture,
                                     std::uint8_t* labels, std::size_t size) {
  return Guard([&] {
    const std::string& name = SensorOf(result, index).name;
    Require(labels, "labels is NULL");
    for (const volalign::FrameResult& frame : FramesOf(*result, capture)) {
      if (frame.name != name) continue;
      const volalign::LabelImage& image = frame.segmentation.labels;
      Require(size == image.size(), "size is not the frame's width * height");
      std::copy(image.begin(), image.end(), labels);
      return;
    }
    throw InvalidArgument("the sensor is not in this capture");
  });
}

const char* volalign_result_json(const volalign_result* result) {
  return result ? result->json.c_str() : "";
}

volalign_code volalign_result_save(const volalign_result* result, const char* folder,
                                   int with_report) {
  return Guard([&] {
    Require(result && folder, "result or folder is NULL");
    std::optional<volalign::ReportRun> report;
    if (with_report) report = volalign::ReportRun{"libvolalign_c", result->whole.options};
    volalign::WriteCalibration(volalign::ResultFolder(PathOf(folder)), result->whole, report);
  });
}
