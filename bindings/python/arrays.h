#pragma once

// NumPy arrays by the buffer protocol alone, which every version of NumPy speaks.

#include <pybind11/pybind11.h>

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "core/base/image.h"
#include "core/geometry/pose.h"

namespace volalign::python {

namespace py = pybind11;

inline bool AnyObject(PyObject*) { return true; }

/// Objects that signatures, and the stubs that are made of them, name by what they are.
struct Array : py::object {
  PYBIND11_OBJECT_DEFAULT(Array, py::object, AnyObject)
};
struct OptionalArray : py::object {
  PYBIND11_OBJECT_DEFAULT(OptionalArray, py::object, AnyObject)
};
struct Path : py::object {
  PYBIND11_OBJECT_DEFAULT(Path, py::object, AnyObject)
};

/// Memory that arrays have without a copy: the class `_Memory`.
struct Memory {
  std::shared_ptr<const void> owner;
  void* data = nullptr;
  py::ssize_t item = 0;  ///< bytes
  std::string format;    ///< of Python's struct
  std::vector<py::ssize_t> shape;
  bool read_only = true;
};

Array ArrayOfMemory(Memory memory);

/// An array of what `owner` keeps, row-major; read-only where T is const.
template <class T>
Array ArrayOf(std::shared_ptr<const void> owner, T* data, std::vector<py::ssize_t> shape) {
  using Value = std::remove_const_t<T>;
  return ArrayOfMemory({std::move(owner), const_cast<Value*>(data), sizeof(Value),
                        py::format_descriptor<Value>::format(), std::move(shape),
                        std::is_const_v<T>});
}

/// A writable array (height, width) that has the image's memory.
template <class T>
Array ArrayOf(Image<T> image) {
  auto kept = std::make_shared<Image<T>>(std::move(image));
  return ArrayOf(kept, kept->data(), {kept->height(), kept->width()});
}

/// A read-only array (height, width) of an image that `owner` keeps; None where it is empty.
template <class T>
OptionalArray ViewOf(std::shared_ptr<const void> owner, const Image<T>& image) {
  if (image.empty()) return py::none();
  return ArrayOf(std::move(owner), image.data(), {image.height(), image.width()});
}

Array ArrayOf(const Eigen::MatrixXd& matrix);               ///< (rows, columns)
Array ArrayOf(const Eigen::Vector3d& vector);               ///< (3,)
Array ArrayOf(const Pose& pose);                            ///< (4, 4)
Array ArrayOf(const std::vector<Pose>& poses);              ///< (N, 4, 4)
OptionalArray PoseOrNone(const std::optional<Pose>& pose);  ///< (4, 4)

/// From anything that NumPy makes an array of. Throw DataError, with `what` in the message, for
/// another shape, and the pose for what is no rigid transform.
Pose PoseOf(const py::handle& array, const std::string& what);
Eigen::Vector3d VectorOf(const py::handle& array, const std::string& what);

/// A contiguous array of numpy's `dtype`, and its memory.
struct Input {
  py::object array;
  py::buffer_info memory;
};
Input InputOf(const py::handle& array, const char* dtype);

}  // namespace volalign::python

namespace pybind11::detail {

template <>
struct handle_type_name<volalign::python::Array> {
  static constexpr auto name = const_name("numpy.ndarray");
};
template <>
struct handle_type_name<volalign::python::OptionalArray> {
  static constexpr auto name = const_name("Optional[numpy.ndarray]");
};
template <>
struct handle_type_name<volalign::python::Path> {
  static constexpr auto name = const_name("Union[str, os.PathLike]");
};

}  // namespace pybind11::detail
