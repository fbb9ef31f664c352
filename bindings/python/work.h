#pragma once

#include <pybind11/pybind11.h>

#include <functional>
#include <optional>
#include <string>

namespace volalign::python {

namespace py = pybind11;

/// Told what begins.
using Tell = std::function<void(const std::string& stage)>;

/// Runs `work` on a thread of its own and waits for it without Python's lock. `work` must not touch
/// Python. What it tells goes to `progress`, a callable or None, on the calling thread. Ctrl-C, or
/// an exception of `progress`, asks the work to stop (core/base/stop.h), and is raised when it has.
void RunWork(const py::object& progress, const std::function<void(const Tell&)>& work);

/// The same with a result.
template <class F>
auto Working(const F& work) {
  std::optional<decltype(work())> result;
  RunWork(py::none(), [&](const Tell&) { result.emplace(work()); });
  return *std::move(result);
}

}  // namespace volalign::python
