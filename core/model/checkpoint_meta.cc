#include "core/model/checkpoint_meta.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "core/base/error.h"
#include "core/json/json_archive.h"

namespace volalign {

template <class Archive>
void Describe(Archive& ar, StructureNetOptions& options) {
  std::string kind =
      options.kind == "paper" ? "" : options.kind;  // absent in files of the paper's network
  ar.Optional("kind", kind);
  if constexpr (Archive::kReading) options.kind = kind.empty() ? "paper" : kind;
  ar("base_channels", options.base_channels);
  ar("num_classes", options.num_classes);
  ar("attention", options.attention);
  ar("normalization", options.normalization);
  ar("input", options.input);
  ar("residual_blocks", options.residual_blocks);
  ar("background_bias", options.background_bias);
}

template <class Archive>
void Describe(Archive& ar, Box& box) {
  ar("name", box.name);
  ar("size", box.size);
  ar("structure_from_box", box.structure_from_box);
  std::vector<double> vertices;  // x, y, z of each, in the part's frame, m
  std::vector<int> triangles;
  if (box.mesh) {
    for (const Eigen::Vector3d& p : box.mesh->vertices())
      vertices.insert(vertices.end(), p.begin(), p.end());
    for (const PartMesh::Triangle& triangle : box.mesh->triangles())
      triangles.insert(triangles.end(), triangle.begin(), triangle.end());
  }
  ar.Optional("vertices", vertices);
  ar.Optional("triangles", triangles);
  if constexpr (Archive::kReading) {
    if (!triangles.empty()) box.mesh = PartMesh::Make(vertices, triangles);
  }
}

template <class Archive>
void Describe(Archive& ar, Structure& structure) {
  std::string name = structure.name(), hash = structure.Hash();
  std::vector<Box> boxes = structure.boxes();
  std::vector<std::string> labels = structure.SideNames();
  ar("name", name);
  ar("boxes", boxes);
  ar("labels", labels);
  ar("sha256", hash);
  if constexpr (Archive::kReading) {
    structure = Structure::FromBoxes(name, std::move(boxes), labels);
    if (structure.Hash() != hash) throw DataError("the structure's hash does not match its boxes");
  }
}

template <class Archive>
void Describe(Archive& ar, IntrinsicsPoolEntry& entry) {
  ar("sensor", entry.sensor);
  ar("intrinsics", entry.intrinsics);
  if constexpr (Archive::kReading) {
    if (entry.intrinsics.empty())
      throw DataError(fmt::format("{}: {} has no intrinsics", ar.where(), entry.sensor));
  }
}

template <class Archive>
void Describe(Archive& ar, CheckpointMeta& meta) {
  ar("tool", meta.tool);
  ar.Optional("date", meta.date);
  ar.Optional("libraries", meta.libraries);
  ar.Optional("renderer", meta.renderer);
  ar("network", meta.network);
  ar("structure", meta.structure);
  ar("focal_px", meta.focal_px);
  ar("image_sizes", meta.image_sizes);
  ar("roll_offsets_deg", meta.roll_offsets_deg);
  ar.Optional("intrinsics", meta.intrinsics);
  ar("samples", meta.samples);
  ar("config", meta.config_yaml);
}

std::string MetaToJson(const CheckpointMeta& meta) { return WriteDescribed(meta, "metadata", 1); }

CheckpointMeta MetaFromJson(const std::string& text) {
  auto meta = ReadDescribed<CheckpointMeta>(text, "metadata");
  RequireClasses(meta);
  meta.network.Validate();
  return meta;
}

std::string OrientationOf(const CheckpointMeta& meta) {
  const auto all_are = [&](double first, double second) {
    return std::all_of(meta.roll_offsets_deg.begin(), meta.roll_offsets_deg.end(),
                       [&](double roll) { return roll == first || roll == second; });
  };
  if (meta.roll_offsets_deg.empty()) return "any";
  return all_are(90, 270) ? "portrait" : all_are(0, 180) ? "landscape" : "any";
}

void RequireClasses(const CheckpointMeta& meta) {
  if (meta.structure.num_classes() != meta.network.num_classes) {
    throw DataError(
        fmt::format("network.num_classes = {} violates the structure '{}', which has {}",
                    meta.network.num_classes, meta.structure.name(), meta.structure.num_classes()));
  }
}

void RequirePaperNet(const CheckpointMeta& meta, const std::string& what) {
  if (meta.network.kind == "paper") return;
  throw ConfigError(fmt::format("{}: a network of kind '{}' cannot be exported, only 'paper'", what,
                                meta.network.kind));
}

void CheckStructure(const CheckpointMeta& meta, const Structure& structure) {
  const std::vector<std::string> trained = meta.structure.SideNames();
  const std::vector<std::string> given = structure.SideNames();
  if (trained == given) return;
  if (trained.size() != given.size()) {
    throw DataError(
        fmt::format("structure '{}' has {} labelled sides, the model was trained on '{}' with {}; "
                    "calibrate by the stack's shape alone (--model none), or train a model for it",
                    structure.name(), given.size(), meta.structure.name(), trained.size()));
  }
  std::size_t i = 0;
  while (trained[i] == given[i]) ++i;
  throw DataError(fmt::format(
      "label {} of structure '{}' is '{}', the model was trained with '{}'; calibrate by the "
      "stack's shape alone (--model none), or train a model for it",
      i + 1, structure.name(), given[i], trained[i]));
}

}  // namespace volalign
