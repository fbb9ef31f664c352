#pragma once

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "core/config/config.h"
#include "infer/calib/calibrate.h"

namespace volalign {

enum class MethodKind { kNetwork, kMarkers, kVolalign };
constexpr Words<MethodKind, 3> WordsOf(MethodKind) {
  return {{{"network", MethodKind::kNetwork},
           {"markers", MethodKind::kMarkers},
           {"volalign", MethodKind::kVolalign}}};
}

/// Poses of a method: its initial ones, as the paper refines them, as volalign does, and as
/// volalign does with corrected depths. The correction is the gain and offset that were estimated
/// with each sensor's pose.
enum class PoseStage { kInitial, kGraph, kStatistical, kCorrected };
constexpr Words<PoseStage, 4> WordsOf(PoseStage) {
  return {{{"initial", PoseStage::kInitial},
           {"graph", PoseStage::kGraph},
           {"statistical", PoseStage::kStatistical},
           {"corrected", PoseStage::kCorrected}}};
}

/// The first two are of a view, the others of a capture (suite/scores.h).
enum class SuiteMetric { kMiouAuthors, kRmse, kD1, kD2 };
constexpr Words<SuiteMetric, 4> WordsOf(SuiteMetric) {
  return {{{"miou_authors", SuiteMetric::kMiouAuthors},
           {"rmse", SuiteMetric::kRmse},
           {"d1", SuiteMetric::kD1},
           {"d2", SuiteMetric::kD2}}};
}

/// Captures of one kind. Files are relative to the suite's own.
struct SuiteDataset {
  std::string name;
  std::vector<std::string> rigs;
  std::vector<std::string> captures;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("name", name, "unique; names a folder of results");
    ar("rigs", rigs, "rig.yaml files to render, one capture for each of their turns");
    ar("captures", captures,
       "capture.json files of recordings in the same layout; without ground truth they have no "
       "pose "
       "errors and no floors, and without infrared pictures no markers");
  }
};

/// A method that finds initial poses.
struct SuiteMethod {
  std::string name;
  MethodKind kind = MethodKind::kNetwork;
  std::string model;
  bool statistical = false;
  std::vector<std::string> datasets;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("name", name, "unique; rows of tables name it");
    ar("kind", kind,
       "network (the paper's poses: medians of labelled pixels, Procrustes), markers (ArUco in "
       "infrared pictures), or volalign (its whole calibration)");
    ar("model", model, "checkpoint; where it does not exist, its rows say so");
    ar("statistical", statistical,
       "network and markers: refine by volalign's joint refinement too, not only by the paper's");
    ar("datasets", datasets, "data sets for which the method can be used; empty: all");
  }
};

bool IsApplicable(const SuiteMethod& method, const std::string& dataset);

/// A group of columns: mean, STD, RSD and the distance to the best mean of one metric.
struct SuiteBlock {
  std::string title;
  SuiteMetric metric = SuiteMetric::kD1;
  std::vector<std::string> datasets;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("title", title, "heading");
    ar("metric", metric, "metric of a view (miou_authors, rmse) or of a capture (d1, d2)");
    ar("datasets", datasets, "names of data sets; their views or captures are taken together");
  }
};

struct SuiteRow {
  std::string label;
  std::string method;
  PoseStage stage = PoseStage::kInitial;
  std::vector<std::string> paper;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("label", label, "name of the row, as the paper has it");
    ar("method", method, "name of a method");
    ar("stage", stage,
       "initial, graph (refined as in the paper), statistical (refined by volalign), or corrected "
       "(statistical, with the corrected depth of each sensor)");
    ar("paper", paper,
       "the paper's cells, as printed: mean, STD, RSD and distance to the best of each block. "
       "Empty: the paper does not have this row");
  }
};

struct SuiteTable {
  std::string name;
  std::string title;
  std::string note;
  std::vector<SuiteBlock> blocks;
  std::vector<SuiteRow> rows;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("name", name, "unique; names files");
    ar("title", title, "caption");
    ar("note", note, "remark for the reader: deviations from the paper");
    ar("blocks", blocks, "groups of columns");
    ar("rows", rows, "rows, in order");
  }
};

/// Experiments: captures, methods, and tables over both.
struct SuiteConfig {
  std::vector<SuiteDataset> datasets;
  std::vector<SuiteMethod> methods;
  std::vector<SuiteTable> tables;
  int min_side_pixels = 25;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("datasets", datasets, "captures");
    ar("methods", methods, "what is compared");
    ar("tables", tables, "what is written",
       Removed("figures", "no pictures are drawn; leave the key out"));
    ar("min_side_pixels", min_side_pixels,
       "smallest number of pixels with which a side counts as visible", AtLeast(1),
       Removed("graph", "the refinement is the paper's; leave the key out"),
       Removed("infrared", "the pictures are those of stereo cameras; leave the key out"));
  }
};

/// Reads a suite. Paths in the result are relative to the working folder. Throws ConfigError for
/// names that are not unique or refer to nothing, and for rows whose `paper` does not have four
/// cells per block. Throws IoError.
SuiteConfig ReadSuite(const std::string& path);

/// The suite with the tables of this name alone ("all": every one), and their datasets and methods.
/// Throws ConfigError for an unknown name.
SuiteConfig SelectTables(SuiteConfig suite, const std::string& name);

}  // namespace volalign
