#pragma once

#include <pybind11/pybind11.h>

#include "core/geometry/structure.h"

namespace volalign::python {

/// A Structure, or the path of one.
Structure StructureOf(const pybind11::handle& object);

}  // namespace volalign::python
