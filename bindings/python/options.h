#pragma once

#include <pybind11/pybind11.h>

#include <string>
#include <vector>

#include "core/config/config.h"
#include "core/geometry/structure.h"

namespace volalign::python {

namespace py = pybind11;

/// `options`: None, the path of a YAML, or a dict, nested or with dotted keys; The keys of
/// `keywords`, another such dict, win. Throws like ConfigSource.
ConfigSource SourceOf(const py::object& options, const py::dict& keywords);

/// Sets the keys of such a dict.
void SetOptions(const py::dict& options, ConfigSource* source);

/// A path as text: str or os.PathLike. Throws DataError where it is not UTF-8.
std::string PathOf(const py::handle& path);

/// Is this a path?
bool IsPath(const py::handle& object);

/// A Structure, or the path of one.
Structure StructureOf(const py::handle& object);

/// Parses a text with Python's module json.
py::object FromJson(const std::string& text);

/// The call of Python, as a shell reads it.
std::string PythonCommand();

}  // namespace volalign::python
