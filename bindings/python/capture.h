#pragma once

#include <pybind11/pybind11.h>

#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "core/geometry/structure.h"
#include "infer/capture/capture.h"

namespace volalign::python {

/// A capture whose structure may be in memory, too. One from memory has its name as path.
struct NamedCapture {
  CaptureFile capture;
  std::optional<Structure> structure;  ///< else capture.structure, a path
  bool in_memory = false;

  std::optional<Structure> ReadItsStructure() const;
};

/// A Capture, the path of one, or a list of these.
std::vector<NamedCapture> CapturesOf(const pybind11::handle& object);

}  // namespace volalign::python
