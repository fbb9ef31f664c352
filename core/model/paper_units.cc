#include "core/model/paper_units.h"

namespace volalign {
namespace {

/// Collects the units of MakePaperNet. Values have no content.
struct UnitCollector {
  struct Value {};
  std::vector<PaperUnit> units = {};

  Value Unit(const PaperUnit& unit, Value) {
    units.push_back(unit);
    return {};
  }
  Value UnitOfEnlarged(const PaperUnit& unit, const std::string&, Value, Value) {
    return Unit(unit, {});
  }
  static Value Op(PaperOp, const std::string&, Value, Value = {}) { return {}; }
};

}  // namespace

std::vector<PaperUnit> PaperUnits(const StructureNetOptions& options) {
  UnitCollector collector;
  MakePaperNet(options, collector, {});
  return collector.units;
}

TensorShapes PaperNetShapes(const StructureNetOptions& options) {
  options.Validate();
  static const std::map<Normalization, std::vector<std::string>> vectors = {
      {Normalization::kNone, {"bias"}},
      {Normalization::kBatch, {"norm_weight", "norm_bias", "running_mean", "running_var"}},
      {Normalization::kGroup, {"norm_weight", "norm_bias"}}};
  TensorShapes shapes;
  for (const PaperUnit& unit : PaperUnits(options)) {
    shapes[unit.name + ".weight"] = {unit.out, unit.in, unit.kernel, unit.kernel};
    for (const std::string& name : vectors.at(unit.normalization))
      shapes[unit.name + "." + name] = {unit.out};
  }
  return shapes;
}

}  // namespace volalign
