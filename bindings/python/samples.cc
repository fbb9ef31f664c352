#include <fmt/format.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "bindings/python/arrays.h"
#include "bindings/python/module.h"
#include "bindings/python/options.h"
#include "core/base/error.h"
#include "core/config/config.h"
#include "render/egl/renderers.h"
#include "render/sample.h"
#include "train/training_data_config.h"

namespace volalign::python {

namespace {

/// What samples depend on of a recipe of training.
struct SampleRecipe {
  struct Run {
    std::int64_t seed = 1;
    int batch_size = 16;

    template <class Archive>
    void Describe(Archive& ar) {
      ar("seed", seed, "of the samples", AtLeast(0));
      ar("batch_size", batch_size, "samples that share an image size", AtLeast(1));
    }
  };
  Run run;
  TrainingDataConfig data;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("run", run, "");
    ar("data", data, "");
  }
};

class Samples {
 public:
  Samples(const SampleRecipe& recipe, std::uint64_t start, int threads)
      : context_(std::make_shared<const SampleContext>(
            MakeSampleContext(recipe.data, recipe.run.batch_size))),
        recipe_(recipe) {
    const Renderers renderers = ChooseRenderers(recipe.data.renderer);
    renderer_ = renderers.description;
    StreamOptions options;
    options.seed = static_cast<std::uint64_t>(recipe.run.seed);
    options.first_index = start;
    options.num_threads = threads;
    options.make_renderer = renderers.make;
    draw_ = StreamSamples(context_, options);
  }

  std::shared_ptr<Sample> Next() {
    const py::gil_scoped_release released;
    return std::make_shared<Sample>(draw_());
  }

  const SampleContext& context() const { return *context_; }
  const std::string& renderer() const { return renderer_; }
  std::string Recipe() const { return WriteConfig(recipe_); }

 private:
  std::shared_ptr<const SampleContext> context_;
  SampleRecipe recipe_;
  std::string renderer_;
  std::function<Sample()> draw_;
};

std::unique_ptr<Samples> MakeSamples(const py::object& recipe, std::optional<std::int64_t> seed,
                                     std::uint64_t start, int threads,
                                     const std::optional<std::string>& renderer,
                                     const py::kwargs& keywords) {
  // The rest of a recipe is the training's.
  ConfigSource source = SourceOf(recipe, py::dict()).Only({"data.", "run.seed", "run.batch_size"});
  SetOptions(keywords, &source);
  if (seed) source.Set(fmt::format("run.seed={}", *seed), "argument");
  if (renderer) source.Set("data.renderer=" + *renderer, "argument");
  if (threads < 0) throw ConfigError(fmt::format("threads = {} violates threads >= 0", threads));
  if (threads == 0) threads = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  const auto read = ReadConfig<SampleRecipe>(source);
  const py::gil_scoped_release released;
  return std::make_unique<Samples>(read, start, threads);
}

/// A writable array of an image of the sample.
template <class T>
Array ImageOf(const std::shared_ptr<Sample>& sample, Image<T> Sample::*member) {
  Image<T>& image = (*sample).*member;
  return ArrayOf(sample, image.data(), {image.height(), image.width()});
}

void AddSample(py::module_& module) {
  using Kept = std::shared_ptr<Sample>;
  py::class_<Sample, Kept>(module, "Sample",
                           "A rendered training sample. Its images are writable, contiguous arrays "
                           "that torch.from_numpy takes without a copy.")
      .def_readonly("index", &Sample::index)
      .def_property_readonly(
          "depth", [](const Kept& s) { return ImageOf(s, &Sample::depth); },
          "(H, W) float32: what the sensor would deliver, m; 0 is no measurement.")
      .def_property_readonly(
          "labels", [](const Kept& s) { return ImageOf(s, &Sample::labels); },
          "(H, W) uint8: 0 is background, and where noise took the depth away.")
      .def_property_readonly(
          "depth_clean", [](const Kept& s) { return ImageOf(s, &Sample::depth_clean); },
          "(H, W) float32: before noise, m.")
      .def_property_readonly(
          "labels_clean", [](const Kept& s) { return ImageOf(s, &Sample::labels_clean); },
          "(H, W) uint8: before noise.")
      .def_readonly("intrinsics", &Sample::intrinsics)
      .def_readonly("sensor", &Sample::sensor, "Kind of the sensor that was drawn.")
      .def_readonly("structure_from_sensor", &Sample::structure_from_sensor, "(4, 4) float64, m.")
      .def_property_readonly(
          "box_offsets",
          [](const Sample& s) -> Array {
            return py::module_::import("numpy").attr("stack")(s.box_offsets);
          },
          "(boxes, 4, 4) float64: displacement of each box from its nominal place.")
      .def_readonly("size_scale", &Sample::size_scale, "Factor on the size of all boxes.")
      .def("__repr__", [](const Sample& s) {
        return fmt::format("<Sample {}: {}x{} {}>", s.index, s.depth.width(), s.depth.height(),
                           s.sensor);
      });
}

}  // namespace

void AddSamples(py::module_& module) {
  AddSample(module);
  py::class_<Samples>(module, "Samples", "An endless iterator of Sample, in order of the index.")
      .def("__iter__", [](Samples& samples) -> Samples& { return samples; })
      .def("__next__", &Samples::Next)
      .def_property_readonly("structure",
                             [](const Samples& samples) { return samples.context().structure; })
      .def_property_readonly(
          "batch_size", [](const Samples& samples) { return samples.context().batch_size; },
          "As many consecutive samples, from multiples of it on, have images of one size.")
      .def_property_readonly("renderer", &Samples::renderer, "The renderer, in words.")
      .def_property_readonly(
          "recipe", &Samples::Recipe,
          "The configuration on which the samples depend, as it was used, YAML.");

  module.def(
      "samples", &MakeSamples, py::arg("recipe") = "configs/m05-lite.yaml", py::kw_only(),
      py::arg("seed") = py::none(), py::arg("start") = 0, py::arg("threads") = 0,
      py::arg("renderer") = py::none(),
      "Draws the samples that training with this recipe sees.\n\nrecipe: the path of a YAML "
      "(docs/training.md), or a dict of its keys; of a recipe data, run.seed and run.batch_size "
      "count. Further keywords stand over it: **{\"data.image_sizes\": [\"160x144\"]}. seed: "
      "instead of run.seed. start: first index, a multiple of the batch size. A sample depends on "
      "recipe, seed and index alone.\nthreads: number of threads that draw ahead of the reader; 0: "
      "one per core.\nrenderer: \"egl\", \"cpu\" or \"auto\" instead of data.renderer; cpu needs "
      "no OpenGL. Raises ConfigError, DataError, IoError.");
}

}  // namespace volalign::python
