#include <fmt/format.h>
#include <pybind11/stl.h>

#include "bindings/python/arrays.h"
#include "bindings/python/module.h"
#include "bindings/python/options.h"
#include "bindings/python/work.h"
#include "core/base/file_util.h"
#include "core/base/input_file.h"
#include "core/formats/structure_gltf.h"
#include "core/geometry/camera.h"
#include "core/geometry/lens.h"
#include "core/geometry/visibility.h"
#include "infer/plan/target_report.h"

namespace volalign::python {

namespace {

constexpr double kRadians = M_PI / 180;

/// How good a target a structure is.
struct Target {
  Structure structure;
  TargetQuality quality;
};

Box MakeBox(const std::string& name, const py::handle& low, const py::handle& high,
            double yaw_deg) {
  Box box = Box::FromMinMax(name, VectorOf(low, name + ": low"), VectorOf(high, name + ": high"));
  box.structure_from_box.rotate(Eigen::AngleAxisd(yaw_deg * kRadians, Eigen::Vector3d::UnitY()));
  return box;
}

py::tuple CastViewOf(const Structure& structure, const Intrinsics& intrinsics,
                     const py::handle& pose) {
  intrinsics.Validate("intrinsics");
  ExpectedView view =
      CastView(structure, ComputeRays(intrinsics), PoseOf(pose, "structure_from_sensor"));
  return py::make_tuple(ArrayOf(std::move(view.depth)), ArrayOf(std::move(view.labels)));
}

void AddIntrinsics(py::module_& module) {
  py::class_<Intrinsics>(module, "Intrinsics",
                         "A camera, in pixels: u = fx x/z + cx, v = fy y/z + cy, pixel centres at "
                         "integer coordinates. Distortion is empty or has 4, 5 or 8 coefficients "
                         "of OpenCV (k1 k2 p1 p2 k3 k4 k5 k6).")
      .def(py::init([](int width, int height, double fx, double fy, double cx, double cy,
                       std::vector<double> distortion) {
             Intrinsics intrinsics{width, height, fx, fy, cx, cy, std::move(distortion)};
             intrinsics.Validate("intrinsics");
             return intrinsics;
           }),
           py::arg("width"), py::arg("height"), py::arg("fx"), py::arg("fy"), py::arg("cx"),
           py::arg("cy"), py::arg("distortion") = std::vector<double>())
      .def_readonly("width", &Intrinsics::width)
      .def_readonly("height", &Intrinsics::height)
      .def_readonly("fx", &Intrinsics::fx)
      .def_readonly("fy", &Intrinsics::fy)
      .def_readonly("cx", &Intrinsics::cx)
      .def_readonly("cy", &Intrinsics::cy)
      .def_readonly("distortion", &Intrinsics::distortion)
      .def_property_readonly(
          "matrix",
          [](const Intrinsics& k) {
            Eigen::Matrix3d matrix;
            matrix << k.fx, 0, k.cx, 0, k.fy, k.cy, 0, 0, 1;
            return matrix;
          },
          "(3, 3) float64: OpenCV's camera matrix.")
      .def("resized", &Intrinsics::Resized, py::arg("width"), py::arg("height"),
           "The intrinsics of the image resized to this size.")
      .def("__eq__", [](const Intrinsics& a, const Intrinsics& b) { return a == b; })
      .def("__repr__", [](const Intrinsics& k) {
        return fmt::format("Intrinsics({}, {}, fx={}, fy={}, cx={}, cy={}, {} coefficients)",
                           k.width, k.height, k.fx, k.fy, k.cx, k.cy, k.distortion.size());
      });
  module.def(
      "intrinsics_pool",
      [](const Path& path) {
        std::map<std::string, std::vector<Intrinsics>> pool;
        for (IntrinsicsPoolEntry& entry : ReadIntrinsicsPool(PathOf(path)))
          pool[entry.sensor] = std::move(entry.intrinsics);
        return pool;
      },
      py::arg("path") = "configs/intrinsics.yaml",
      "Measured intrinsics by kind of sensor: dict of lists. Raises IoError, ConfigError.");
}

void AddBoxes(py::module_& module) {
  py::class_<Box>(module, "Box", "A solid part: a box, or a mesh within such a box.")
      .def(py::init(&MakeBox), py::arg("name"), py::arg("low"), py::arg("high"),
           py::arg("yaw_deg") = 0.0,
           "low, high: (3,) corners, structure frame, m, y up. yaw_deg: turn about the vertical "
           "through its centre, from +z towards +x.")
      .def_readonly("name", &Box::name)
      .def_readonly("size", &Box::size, "(3,) float64: along its own axes, m.")
      .def_readonly("structure_from_box", &Box::structure_from_box,
                    "(4, 4) float64: of its centre.")
      .def_property_readonly(
          "is_mesh", [](const Box& box) { return box.mesh != nullptr; },
          "Is it a mesh, which Structure.load read?")
      .def("__repr__", [](const Box& box) {
        return fmt::format("<{} {}: {:.3f} x {:.3f} x {:.3f} m>", box.mesh ? "Mesh part" : "Box",
                           box.name, box.size.x(), box.size.y(), box.size.z());
      });

  py::class_<Structure>(module, "Structure",
                        "A stack of boxes, or a mesh, whose sides have labels; metres, y up.")
      .def(py::init(&Structure::FromBoxes), py::arg("name"), py::arg("boxes"),
           py::arg("label_order") = std::vector<std::string>(),
           "label_order: names of the sides (\"BOX/front\") in the order of their labels 1, 2, "
           "...; none: box by box front, back, up, right, left. Raises DataError.")
      .def_static(
          "load", [](const Path& path) { return ReadStructure(PathOf(path)); }, py::arg("path"),
          "Reads a .yaml of boxes or meshes, or a mesh: .glb, .gltf, .obj, .stl, .ply. Raises "
          "IoError, ConfigError.")
      .def(
          "save",
          [](const Structure& structure, const Path& path) {
            const std::filesystem::path file = PathOf(path);
            if (file.extension() == ".glb") {
              WriteStructureGlb(file, structure);
            } else {
              WriteFileAtomically(file, StructureYaml(structure));
            }
          },
          py::arg("path"),
          "Writes a .yaml, which load reads, meshes included, or a .glb, which shows it. Raises "
          "IoError; "
          "DataError for a .yaml where a box leans.")
      .def_property_readonly("name", &Structure::name)
      .def_property_readonly("boxes", &Structure::boxes)
      .def_property_readonly("side_names", &Structure::SideNames,
                             "Names of the labels 1, 2, ...; 0 is background.")
      .def_property_readonly("num_classes", &Structure::num_classes, "Labels, background included.")
      .def_property_readonly("floor_height", &Structure::FloorHeight, "Lowest y, m.")
      .def_property_readonly("height", &Structure::Height, "m")
      .def_property_readonly("sha256", &Structure::Hash, "SHA-256 of sizes, poses and labels.")
      .def_property_readonly(
          "side_centres",
          [](const Structure& structure) {
            Eigen::MatrixXd centres(structure.num_classes() - 1, 3);
            for (int label = 1; label < structure.num_classes(); ++label)
              centres.row(label - 1) = structure.SideOfLabel(label).centre.transpose();
            return centres;
          },
          "(K-1, 3) float64: of the labels 1, 2, ..., m.")
      .def("cast_view", &CastViewOf, py::arg("intrinsics"), py::arg("structure_from_sensor"),
           "Renders the structure alone for a sensor at this (4, 4) pose: depth (H, W) float32, m, "
           "0 where there is no box, and labels (H, W) uint8.")
      .def(
          "check",
          [](const Structure& structure, double distance_m, std::vector<double> heights_m) {
            TargetViewOptions views;
            views.distance_m = distance_m;
            views.heights_m = std::move(heights_m);
            return Working([&] { return Target{structure, MeasureTarget(structure, views)}; });
          },
          py::arg("distance_m") = TargetViewOptions().distance_m,
          py::arg("heights_m") = TargetViewOptions().heights_m,
          "Is it a good target? Views from all directions at this horizontal distance from its "
          "middle and these heights above the floor, m.")
      .def("__eq__", [](const Structure& a, const Structure& b) { return a.Hash() == b.Hash(); })
      .def("__repr__", [](const Structure& structure) {
        return fmt::format("<Structure {}: {}, {} labels>", structure.name(),
                           structure.CountedParts(), structure.num_classes() - 1);
      });
}

void AddTarget(py::module_& module) {
  py::class_<TargetSymmetry>(module, "TargetSymmetry",
                             "A motion of the stack that moves boxes onto boxes.")
      .def_readonly("motion", &TargetSymmetry::motion)
      .def_readonly("boxes", &TargetSymmetry::boxes)
      .def_readonly("all", &TargetSymmetry::all)
      .def_readonly("floor_tells", &TargetSymmetry::floor_tells);
  py::class_<TargetView>(module, "TargetView", "The view of a structure that a sensor would have.")
      .def_readonly("phi_deg", &TargetView::phi_deg)
      .def_readonly("height_m", &TargetView::height_m)
      .def_readonly("sides", &TargetView::sides)
      .def_readonly("sides_fix_pose", &TargetView::sides_fix_pose)
      .def_readonly("weakest_m", &TargetView::weakest_m)
      .def_readonly("look_alike", &TargetView::look_alike);
  py::class_<Target>(module, "Target", "How good a target a structure is; str() is a report.")
      .def_property_readonly("aliases", [](const Target& t) { return t.quality.symmetries; })
      .def_property_readonly("views", [](const Target& t) { return t.quality.views; })
      .def("__str__", [](const Target& t) { return FormatTarget(t.structure, t.quality); });
}

void AddPoses(py::module_& module) {
  module.def(
      "look_at",
      [](const py::handle& position, const py::handle& target, double roll_deg) {
        return LookAt(VectorOf(position, "position"), VectorOf(target, "target"),
                      roll_deg * kRadians);
      },
      py::arg("position"), py::arg("target"), py::arg("roll_deg") = 0.0,
      "(4, 4) structure_from_sensor of a level sensor at `position` that looks at `target`, (3,) "
      "m each, then turned about its axis; 90 deg turns image +x to the floor.");
  module.def(
      "compare_poses",
      [](const py::handle& a, const py::handle& b) {
        return ComparePoses(PoseOf(a, "a"), PoseOf(b, "b"));
      },
      py::arg("a"), py::arg("b"),
      "Distance, m, of the positions and angle, deg, between two (4, 4) poses.");
}

}  // namespace

void AddStructure(py::module_& module) {
  AddIntrinsics(module);
  AddTarget(module);
  AddBoxes(module);
  AddPoses(module);
}

}  // namespace volalign::python
