#pragma once

// NumPy arrays by the buffer protocol alone, which every version of NumPy speaks.

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <Eigen/Core>
#include <memory>
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

/// An array of this shape with a copy of the values, which are row by row.
Array Owned(std::vector<double> values, std::vector<py::ssize_t> shape);

/// From anything that NumPy makes an array of. Throw DataError, with `what` in the message, for
/// another shape, and the pose for what is no rigid transform.
Pose PoseOf(const py::handle& array, const std::string& what);
Eigen::Vector3d VectorOf(const py::handle& array, const std::string& what);

/// The parts of what `owner` keeps, by their names. Each keeps the owner.
template <class T>
py::dict PartsByName(const std::shared_ptr<void>& owner, std::vector<T>& parts) {
  py::dict named;
  for (T& part : parts) named[py::str(part.name)] = std::shared_ptr<T>(owner, &part);
  return named;
}

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

// How members and results of these types appear in Python.

/// Vectors and matrices, as arrays.
template <int Rows, int Columns, int Options, int MostRows, int MostColumns>
struct type_caster<Eigen::Matrix<double, Rows, Columns, Options, MostRows, MostColumns>> {
  static constexpr auto name = const_name("numpy.ndarray");
  static handle cast(
      const Eigen::Matrix<double, Rows, Columns, Options, MostRows, MostColumns>& matrix,
      return_value_policy /*policy*/, handle /*parent*/) {
    const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows = matrix;
    std::vector<ssize_t> shape = {matrix.rows()};
    if constexpr (Columns != 1) shape.push_back(matrix.cols());
    return volalign::python::Owned({rows.data(), rows.data() + rows.size()}, std::move(shape))
        .release();
  }
};

/// A pose, as an array (4, 4).
template <>
struct type_caster<volalign::Pose> {
  static constexpr auto name = const_name("numpy.ndarray");
  static handle cast(const volalign::Pose& pose, return_value_policy policy, handle parent) {
    return type_caster<Eigen::Matrix4d>::cast(pose.matrix(), policy, parent);
  }
};

/// (m, deg).
template <>
struct type_caster<volalign::PoseError> {
  static constexpr auto name = const_name("Tuple[float, float]");
  static handle cast(const volalign::PoseError& error, return_value_policy /*policy*/,
                     handle /*parent*/) {
    return pybind11::make_tuple(error.translation_m, error.rotation_deg).release();
  }
};

/// Enums, as their words.
template <class Enum>
struct type_caster<Enum, enable_if_t<std::is_enum_v<Enum> &&
                                     std::is_same_v<decltype(ToString(Enum())), const char*>>> {
  static constexpr auto name = const_name("str");
  static handle cast(Enum value, return_value_policy /*policy*/, handle /*parent*/) {
    return str(ToString(value)).release();
  }
};

}  // namespace pybind11::detail
