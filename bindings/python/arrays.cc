#include "bindings/python/arrays.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "bindings/python/module.h"
#include "core/base/error.h"

namespace volalign::python {

namespace {

void RequireShape(const py::buffer_info& memory, const std::vector<py::ssize_t>& shape,
                  const std::string& what) {
  if (memory.shape == shape) return;
  throw DataError(fmt::format("{} has the shape ({}); ({}) is expected", what,
                              fmt::join(memory.shape, ", "), fmt::join(shape, ", ")));
}

}  // namespace

Array ArrayOfMemory(Memory memory) {
  return py::module_::import("numpy").attr("asarray")(py::cast(std::move(memory)));
}

Array Owned(std::vector<double> values, std::vector<py::ssize_t> shape) {
  auto kept = std::make_shared<std::vector<double>>(std::move(values));
  return ArrayOf(kept, kept->data(), std::move(shape));
}

Input InputOf(const py::handle& array, const char* dtype) {
  py::object contiguous = py::module_::import("numpy").attr("ascontiguousarray")(array, dtype);
  py::buffer_info memory = py::buffer(contiguous).request();
  return {std::move(contiguous), std::move(memory)};
}

Pose PoseOf(const py::handle& array, const std::string& what) {
  const Input input = InputOf(array, "float64");
  RequireShape(input.memory, {4, 4}, what);
  using Rows = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;
  return PoseFromMatrix(Eigen::Map<const Rows>(static_cast<const double*>(input.memory.ptr)), what);
}

Eigen::Vector3d VectorOf(const py::handle& array, const std::string& what) {
  const Input input = InputOf(array, "float64");
  RequireShape(input.memory, {3}, what);
  return Eigen::Map<const Eigen::Vector3d>(static_cast<const double*>(input.memory.ptr));
}

void AddArrays(py::module_& module) {
  py::class_<Memory>(module, "_Memory", py::buffer_protocol()).def_buffer([](const Memory& memory) {
    std::vector<py::ssize_t> strides(memory.shape.size());
    py::ssize_t stride = memory.item;
    for (std::size_t i = strides.size(); i-- > 0; stride *= memory.shape[i]) strides[i] = stride;
    return py::buffer_info(memory.data, memory.item, memory.format,
                           static_cast<py::ssize_t>(memory.shape.size()), memory.shape, strides,
                           memory.read_only);
  });
}

}  // namespace volalign::python
