#pragma once

// NumPy arrays by the buffer protocol alone, which every version of NumPy speaks.

#include <pybind11/pybind11.h>

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

/// Memory that arrays have without a copy: the class `_Memory`.
struct Memory {
  std::shared_ptr<const void> owner;
  void* data = nullptr;
  py::ssize_t item = 0;  ///< bytes
  std::string format;    ///< of Python's struct
  std::vector<py::ssize_t> shape;
  bool read_only = true;
};

py::object ArrayOfMemory(Memory memory);

/// An array of what `owner` keeps, row-major; read-only where T is const.
template <class T>
py::object ArrayOf(std::shared_ptr<const void> owner, T* data, std::vector<py::ssize_t> shape) {
  using Value = std::remove_const_t<T>;
  return ArrayOfMemory({std::move(owner), const_cast<Value*>(data), sizeof(Value),
                        py::format_descriptor<Value>::format(), std::move(shape),
                        std::is_const_v<T>});
}

/// A writable array (height, width) that has the image's memory.
template <class T>
py::object ArrayOf(Image<T> image) {
  auto kept = std::make_shared<Image<T>>(std::move(image));
  return ArrayOf(kept, kept->data(), {kept->height(), kept->width()});
}

/// A read-only array (height, width) of an image that `owner` keeps; None where it is empty.
template <class T>
py::object ViewOf(std::shared_ptr<const void> owner, const Image<T>& image) {
  if (image.empty()) return py::none();
  return ArrayOf(std::move(owner), image.data(), {image.height(), image.width()});
}

py::object ArrayOf(const Eigen::MatrixXd& matrix);   ///< (rows, columns)
py::object ArrayOf(const Eigen::Vector3d& vector);   ///< (3,)
py::object ArrayOf(const Pose& pose);                ///< (4, 4)
py::object ArrayOf(const std::vector<Pose>& poses);  ///< (N, 4, 4)

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
