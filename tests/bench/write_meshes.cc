// Writes the ten meshes of tests/core/geometry/mesh_shapes.h into a folder, for
// tests/bench/meshes.py.

#include <filesystem>
#include <fstream>
#include <iostream>

#include "tests/core/geometry/mesh_shapes.h"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "write_meshes FOLDER\n";
    return 2;
  }
  const std::filesystem::path folder = argv[1];
  std::filesystem::create_directories(folder);
  for (const volalign::mesh_shapes::Shape& shape : volalign::mesh_shapes::TenShapes())
    std::ofstream(folder / (shape.name + ".obj")) << volalign::mesh_shapes::Obj(shape);
  return 0;
}
