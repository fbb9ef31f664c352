#pragma once

// Elements of volalign's glTF files. Heavy: only for files that write or read glTF.

#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#include <tiny_gltf.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/structure.h"

namespace volalign {

/// A list, for extras.
tinygltf::Value Numbers(const std::vector<double>& numbers);

/// An empty scene with one buffer.
tinygltf::Model NewGltf(const std::string& scene_name);

/// Appends tightly packed elements to the model's first buffer: numbers (float), shares of 255
/// (std::uint8_t) or indices (std::uint16_t). Returns the index of their accessor. `type`:
/// TINYGLTF_TYPE_...
template <class T>
int AddAccessor(tinygltf::Model* model, const std::vector<T>& values, int type);

/// As AddAccessor, for positions, three numbers each, with the bounds that glTF requires.
int AddPositions(tinygltf::Model* model, const std::vector<float>& positions);

/// Sets the place of a node in its parent.
void SetPose(tinygltf::Node* node, const Pose& parent_from_node);

/// Adds a node; returns its index.
int AddNode(tinygltf::Model* model, tinygltf::Node node);
int AddMesh(tinygltf::Model* model, tinygltf::Mesh mesh);

/// Adds one named node per part (its transform is structure_from_box, metres, y up) and one
/// primitive per side with extras {side, label, centre, exposed_centroid}. `side` is its name
/// without that of the part. Returns the nodes, which have no parent yet.
std::vector<int> AddBoxes(tinygltf::Model* model, const Structure& structure);

/// Writes the binary form, atomically. Throws IoError.
void WriteGlb(const std::filesystem::path& path, const tinygltf::Model& model);

}  // namespace volalign
