#pragma once

// What glTF files of ours are built from. Heavy: only for files that write or read glTF.

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

/// A list, of extras.
tinygltf::Value Numbers(const std::vector<double>& numbers);

/// An empty scene with one buffer.
tinygltf::Model NewGltf(const std::string& scene_name);

/// An accessor of tightly packed elements that are appended to the model's first buffer.
/// `target`: TINYGLTF_TARGET_...; returns the accessor's index.
int AddFloats(tinygltf::Model* model, const std::vector<float>& values, int type);
int AddBytes(tinygltf::Model* model, const std::vector<std::uint8_t>& values, int type);
int AddIndices(tinygltf::Model* model, const std::vector<std::uint16_t>& values);

/// As AddFloats, of positions, three numbers each, with the bounds that glTF demands of them.
int AddPositions(tinygltf::Model* model, const std::vector<float>& positions);

/// Where a node stands in its parent.
void SetPose(tinygltf::Node* node, const Pose& parent_from_node);

/// Adds a node; returns its index.
int AddNode(tinygltf::Model* model, tinygltf::Node node);
int AddMesh(tinygltf::Model* model, tinygltf::Mesh mesh);

/// One named node a box (its transform is structure_from_box, metres, y up), one primitive a side
/// with extras {side, label, centre, exposed_centroid}; returns the nodes, which have no parent
/// yet.
std::vector<int> AddBoxes(tinygltf::Model* model, const Structure& structure);

/// Writes the binary form, atomically. Throws IoError.
void WriteGlb(const std::filesystem::path& path, const tinygltf::Model& model);

}  // namespace volalign
