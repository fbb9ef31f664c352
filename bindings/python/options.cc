#include "bindings/python/options.h"

#include <fmt/format.h>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/config/bounded_yaml.h"

namespace volalign::python {

namespace {

/// JSON is YAML's flow syntax. Scalars and arrays of NumPy become Python's.
std::string FlowText(const std::string& key, const py::handle& value) {
  const py::cpp_function plain([](const py::object& other) -> py::object {
    if (!py::hasattr(other, "tolist"))
      throw py::type_error("an option is a number, a text, a bool, or a list or dict of these");
    return other.attr("tolist")();
  });
  try {
    return py::module_::import("json")
        .attr("dumps")(value, py::arg("default") = plain)
        .cast<std::string>();
  } catch (const py::error_already_set& error) {
    if (!error.matches(PyExc_ValueError) && !error.matches(PyExc_RecursionError)) throw;
  }
  throw ConfigError(fmt::format(
      "{}: nested deeper than the {} levels that are read of options, or contains itself",
      Shortened(key), kMaxYamlDepth));
}

}  // namespace

ConfigSource SourceOf(const py::object& options, const py::dict& keywords) {
  ConfigSource source;
  if (IsPath(options)) {
    source = ConfigSource::FromFile(PathOf(options));
  } else if (py::isinstance<py::dict>(options)) {
    SetOptions(options, &source);
  } else if (!options.is_none()) {
    throw py::type_error("options are a dict or the path of a YAML file");
  }
  SetOptions(keywords, &source);
  return source;
}

void SetOptions(const py::dict& options, ConfigSource* source) {
  for (const auto& [name, value] : options) {
    const auto key = py::str(name).cast<std::string>();
    source->Set(key + "=" + FlowText(key, value), "argument");
  }
}

bool IsPath(const py::handle& object) {
  return py::isinstance<py::str>(object) || py::hasattr(object, "__fspath__");
}

Structure StructureOf(const py::handle& object) {
  if (IsPath(object)) return ReadStructure(PathOf(object));
  return object.cast<Structure>();
}

std::string PathOf(const py::handle& path) {
  auto text = py::module_::import("os").attr("fsencode")(path).cast<std::string>();
  RequireUtf8(text, "the path");
  return text;
}

py::object FromJson(const std::string& text) {
  return py::module_::import("json").attr("loads")(text);
}

std::string PythonCommand() {
  return py::module_::import("shlex")
      .attr("join")(py::module_::import("sys").attr("orig_argv"))
      .attr("encode")("utf-8", "backslashreplace")
      .cast<std::string>();
}

}  // namespace volalign::python
