#include "infer/stack/build_sheet.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/geometry/stack_faults.h"
#include "core/plot/picture_text.h"
#include "core/plot/svg.h"

namespace volalign {

namespace {

Overhang OverhangOf(const Eigen::AlignedBox3d& box, const Eigen::AlignedBox3d& below) {
  return {box.max().x() - below.max().x(), below.min().x() - box.min().x(),
          box.max().z() - below.max().z(), below.min().z() - box.min().z()};
}

double SharedArea(const Eigen::AlignedBox3d& a, const Eigen::AlignedBox3d& b) {
  const double x = std::min(a.max().x(), b.max().x()) - std::max(a.min().x(), b.min().x());
  const double z = std::min(a.max().z(), b.max().z()) - std::max(a.min().z(), b.min().z());
  return std::max(x, 0.0) * std::max(z, 0.0);
}

}  // namespace

std::vector<BuildStep> BuildSteps(const Structure& structure) {
  std::vector<Eigen::AlignedBox3d> bounds;
  for (const Box& box : structure.boxes()) bounds.push_back(BoundsOf(box));
  std::vector<int> order(bounds.size());
  std::iota(order.begin(), order.end(), 0);
  const auto of = [&](int b) -> const Eigen::AlignedBox3d& {
    return bounds[static_cast<std::size_t>(b)];
  };
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return of(a).min().y() < of(b).min().y() - kTouching; });

  std::vector<BuildStep> steps;
  for (const int b : order) {
    const Box& box = structure.boxes()[static_cast<std::size_t>(b)];
    const Eigen::Matrix3d& r = box.structure_from_box.linear();
    BuildStep step;
    step.box = b;
    step.height = box.size.y();
    step.front_to_back = box.size.x();
    step.left_to_right = box.size.z();
    step.yaw_deg = std::atan2(r(0, 2), r(2, 2)) / kDegree;
    step.on_floor = of(b).min().y() < structure.FloorHeight() + kTouching;
    std::vector<std::pair<double, int>> below;  // minus the area, box
    for (const BuildStep& earlier : steps) {
      const double area = SharedArea(of(b), of(earlier.box));
      if (std::abs(of(earlier.box).max().y() - of(b).min().y()) < kTouching && area > 0)
        below.emplace_back(-area, earlier.box);
    }
    std::sort(below.begin(), below.end());
    for (const auto& [area, on] : below) step.on.push_back(on);
    if (!step.on.empty()) {
      step.overhang = OverhangOf(of(b), of(step.on.front()));
    } else if (step.on_floor && !steps.empty()) {
      step.overhang = OverhangOf(of(b), of(steps.front().box));
    }
    steps.push_back(std::move(step));
  }
  return steps;
}

namespace {

constexpr double kWidth = 794, kHeight = 1123;  // px: A4 at the 96 px an inch of SVG
constexpr double kMargin = 48;                  // px
constexpr double kViewTop = 104, kViewBottom = 540, kBetweenViews = 96;  // px
constexpr double kStepsTop = 572, kStepsBottom = 1026;                   // px
constexpr double kFullCell = 240;  // px: cells of that size have text of the full size
constexpr double kText = 11;       // px
constexpr double kBold = 1.2;      // times as wide
constexpr double kWidthOfText =
    0.52;                        // px a letter, of the size, in what a sheet says (DejaVu Sans)
constexpr double kArrow = 0.22;  // m, on the floor
// Light tints of Okabe and Ito's colours: neighbours differ also in grey, and figures on them can
// be read.
constexpr std::array<std::array<int, 3>, 6> kTints = {{{244, 214, 160},
                                                       {166, 208, 236},
                                                       {166, 222, 204},
                                                       {240, 200, 220},
                                                       {250, 244, 180},
                                                       {220, 220, 220}}};

std::string Millimetres(double metres) { return fmt::format("{:.0f}", metres * 1000); }

/// The text shortened to `px` at a size of `font` px.
std::string Fitted(const std::string& text, double px, double font) {
  return Ellipsized(text, static_cast<int>(std::max(px / (kWidthOfText * font), 2.0)));
}

std::string Tint(std::size_t number, double light) {
  const std::array<int, 3>& c = kTints[number % kTints.size()];
  const auto part = [&](std::size_t i) {
    return std::clamp(static_cast<int>(c[i] * light), 0, 255);
  };
  return fmt::format("#{:02x}{:02x}{:02x}", part(0), part(1), part(2));
}

std::string Font(double px, const std::string& more = "") {
  return fmt::format("font-size=\"{:.1f}\" {}", px, more);
}

std::vector<Eigen::Vector3d> Outline(const Box& box) {
  std::vector<Eigen::Vector3d> corners;
  for (const auto& [x, z] : {std::pair{-0.5, -0.5}, {0.5, -0.5}, {0.5, 0.5}, {-0.5, 0.5}}) {
    corners.push_back(box.structure_from_box *
                      Eigen::Vector3d(x * box.size.x(), -0.5 * box.size.y(), z * box.size.z()));
  }
  return corners;
}

/// Isometric: from the front (+x), the right (+z) and above, every axis shortened alike.
struct IsometricView {
  double scale = 1, left = 0, top = 0;

  static Eigen::Vector3d Towards() { return Eigen::Vector3d(1, 1, 1).normalized(); }
  static Svg::Point Flat(const Eigen::Vector3d& p) {
    return {(p.x() - p.z()) / std::sqrt(2.0), ((p.x() + p.z()) - 2 * p.y()) / std::sqrt(6.0)};
  }
  Svg::Point At(const Eigen::Vector3d& p) const {
    const Svg::Point flat = Flat(p);
    return {left + scale * flat.x, top + scale * flat.y};
  }
};

/// Arrows on the floor that show front and right.
struct FloorArrow {
  Eigen::Vector3d from, to;
  std::string text;
};

/// `names`: of the sides towards +x and +z.
std::vector<FloorArrow> FloorArrows(const Structure& structure,
                                    const std::array<std::string, 2>& names) {
  Eigen::AlignedBox3d all;
  for (const Box& box : structure.boxes()) all.extend(BoundsOf(box));
  const double y = structure.FloorHeight();
  const Eigen::Vector3d front(all.max().x() + 0.3 * kArrow, y, all.center().z());
  const Eigen::Vector3d right(all.center().x(), y, all.max().z() + 0.3 * kArrow);
  return {{front, front + kArrow * Eigen::Vector3d::UnitX(), names[0]},
          {right, right + kArrow * Eigen::Vector3d::UnitZ(), names[1]}};
}

/// The view that fits between `from` and `to`, px.
IsometricView FittingView(const Structure& structure, const std::vector<FloorArrow>& arrows,
                          double from, double to) {
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  double left = kInfinite, right = -kInfinite, top = kInfinite, bottom = -kInfinite;
  const auto extend = [&](const Eigen::Vector3d& p) {
    const Svg::Point flat = IsometricView::Flat(p);
    left = std::min(left, flat.x);
    right = std::max(right, flat.x);
    top = std::min(top, flat.y);
    bottom = std::max(bottom, flat.y);
  };
  for (const Box& box : structure.boxes()) {
    for (const Eigen::Vector3d& corner : box.Corners()) extend(corner);
  }
  for (const FloorArrow& arrow : arrows) extend(arrow.to);
  constexpr double kTextBelow = 18;  // px, of the arrows
  IsometricView view;
  view.scale = std::min((to - from) / (right - left),
                        (kViewBottom - kTextBelow - kViewTop) / (bottom - top));
  view.left = (from + to) / 2 - view.scale * (left + right) / 2;
  view.top = kViewBottom - kTextBelow - view.scale * bottom;
  return view;
}

/// May a be drawn before b? No part of a is in front of b.
bool IsBehind(const Eigen::AlignedBox3d& a, const Eigen::AlignedBox3d& b) {
  return ((b.min() - a.max()).array() > -kTouching).any();
}

/// Steps ordered so that later ones hide earlier ones.
std::vector<std::size_t> BackToFront(const std::vector<Eigen::AlignedBox3d>& bounds) {
  std::vector<std::size_t> order;
  std::vector<bool> done(bounds.size(), false);
  while (order.size() < bounds.size()) {
    std::optional<std::size_t> next, farthest;
    for (std::size_t a = 0; a < bounds.size() && !next; ++a) {
      if (done[a]) continue;
      bool behind = true;
      for (std::size_t b = 0; b < bounds.size() && behind; ++b)
        behind = b == a || done[b] || IsBehind(bounds[a], bounds[b]);
      if (behind) next = a;
      if (!farthest || bounds[a].center().sum() < bounds[*farthest].center().sum()) farthest = a;
    }
    order.push_back(next.value_or(*farthest));
    done[order.back()] = true;
  }
  return order;
}

std::string Edges(const BuildStep& step) {
  return fmt::format("{} front-back, {} left-right, {} up", Millimetres(step.front_to_back),
                     Millimetres(step.left_to_right), Millimetres(step.height));
}

/// Draws between `from` and `to`, px. Every side has its box's number. Boxes in front of it may
/// hide the number.
void DrawView(const Structure& structure, const std::vector<BuildStep>& steps,
              const std::array<std::string, 2>& names, double from, double to, Svg* svg) {
  const std::vector<FloorArrow> arrows = FloorArrows(structure, names);
  const IsometricView view = FittingView(structure, arrows, from, to);
  std::vector<Eigen::AlignedBox3d> bounds;
  for (const BuildStep& step : steps)
    bounds.push_back(BoundsOf(structure.boxes()[static_cast<std::size_t>(step.box)]));
  for (const std::size_t i : BackToFront(bounds)) {
    for (const Side& side : structure.sides()) {
      if (side.box != steps[i].box || side.normal.dot(IsometricView::Towards()) < 1e-6) continue;
      std::vector<Svg::Point> corners;
      for (const auto& [u, v] : {std::pair{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}) {
        corners.push_back(
            view.At(side.centre + u * side.half_u * side.axis_u + v * side.half_v * side.axis_v));
      }
      const double light = side.normal.y() > 0.9               ? 1.05
                           : side.normal.x() > side.normal.z() ? 0.92
                                                               : 0.78;
      svg->Polygon(corners, fmt::format("fill=\"{}\" stroke=\"#222\" stroke-linejoin=\"round\"",
                                        Tint(i, light)));
      const double font = std::min(16.0, view.scale * std::min(side.half_u, side.half_v));
      const Svg::Point middle = view.At(side.centre);
      svg->Text({middle.x, middle.y + 0.35 * font}, std::to_string(i + 1),
                Font(font, "class=\"number\""));
    }
  }
  for (const FloorArrow& arrow : arrows) {
    const Svg::Point end = view.At(arrow.to);
    svg->Line(view.At(arrow.from), end, "class=\"arrow\"");
    svg->Text({end.x, end.y + 16}, arrow.text, "font-weight=\"bold\" text-anchor=\"middle\"");
  }
}

Structure SeenFromBehind(const Structure& structure) {
  const Pose turn(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitY()));
  std::vector<Box> boxes = structure.boxes();
  for (Box& box : boxes) box.structure_from_box = turn * box.structure_from_box;
  return Structure::FromBoxes(structure.name(), boxes);
}

/// A plan from above: x to the right, z downwards.
class Cell {
 public:
  Cell(double left, double top, double width, double height, double pixels, Svg* svg)
      : left_(left),
        top_(top),
        width_(width),
        height_(height),
        pixels_(pixels),
        svg_(svg),
        size_(std::min({width, height, kFullCell}) / kFullCell) {}

  static double TextSize(double width, double height) {
    return std::min({width, height, kFullCell}) / kFullCell;
  }
  static constexpr double kHead = 76, kSide = 46, kBelow = 26;  // px at the full size: texts

  void Head(const std::string& title, const std::vector<std::string>& lines) {
    constexpr double kFrontMark = 108;  // px
    const double room = width_ - 14 * size_;
    svg_->Rectangle({left_ + 2, top_ + 2}, width_ - 4, height_ - 4, "class=\"cell\"");
    svg_->Text({left_ + 8 * size_, top_ + 18 * size_},
               Fitted(title, room - kFrontMark * size_, kBold * 13 * size_),
               Font(13 * size_, "font-weight=\"bold\""));
    svg_->Text({left_ + width_ - 8 * size_, top_ + 18 * size_}, "front →  right ↓",
               Font(kText * size_, "text-anchor=\"end\""));
    for (std::size_t i = 0; i < lines.size(); ++i) {
      svg_->Text({left_ + 8 * size_, top_ + (34 + 14 * static_cast<double>(i)) * size_},
                 Fitted(lines[i], room, kText * size_), Font(kText * size_));
    }
  }
  void Centre(const Eigen::AlignedBox3d& shown) { shown_ = shown; }
  Svg::Point At(const Eigen::Vector3d& p) const {
    const Eigen::Vector3d from = p - shown_.center();
    return {left_ + width_ / 2 + pixels_ * from.x(),
            top_ + (kHead * size_ + height_ - kBelow * size_) / 2 + 7 * size_ + pixels_ * from.z()};
  }
  void Draw(const Box& box, const std::string& attributes) {
    std::vector<Svg::Point> points;
    for (const Eigen::Vector3d& corner : Outline(box)) points.push_back(At(corner));
    svg_->Polygon(points, attributes);
  }
  /// Draws the names of the sides around the plan.
  void Sides(const std::array<std::string, 4>& front_back_right_left,
             const Eigen::Vector3d& about) {
    const Svg::Point high = At(shown_.max()), low = At(shown_.min()), middle = At(about);
    const double font = kText * size_, gap = 5 * size_;
    const auto& [front, back, right, left] = front_back_right_left;
    svg_->Text({high.x + gap, middle.y + 0.35 * font}, front, Font(font));
    svg_->Text({low.x - gap, middle.y + 0.35 * font}, back, Font(font, "text-anchor=\"end\""));
    svg_->Text({middle.x, high.y + font + gap / 2}, right, Font(font, "text-anchor=\"middle\""));
    svg_->Text({middle.x, low.y - gap}, left, Font(font, "text-anchor=\"middle\""));
  }
  void Number(const Eigen::Vector3d& at, std::size_t number) {
    const Svg::Point p = At(at);
    svg_->Text({p.x, p.y + 6 * size_}, std::to_string(number),
               Font(18 * size_, "text-anchor=\"middle\" font-weight=\"bold\""));
  }
  void Cross(const Eigen::Vector3d& at) {
    const Svg::Point p = At(at);
    svg_->Line({p.x - 6, p.y}, {p.x + 6, p.y}, "class=\"origin\"");
    svg_->Line({p.x, p.y - 6}, {p.x, p.y + 6}, "class=\"origin\"");
  }

 private:
  double left_, top_, width_, height_, pixels_;
  Svg* svg_;
  double size_;
  Eigen::AlignedBox3d shown_;
};

std::string Beyond(double metres) {
  if (std::abs(metres) < kTouching / 2) return "flush";
  return Millimetres(std::abs(metres)) + (metres > 0 ? " out" : " in");
}

std::string StandsOn(const Structure& structure, const std::vector<BuildStep>& steps,
                     const BuildStep& step) {
  std::string text =
      step.on.empty() ? step.on_floor ? "on the floor" : "on nothing (check y)" : "on";
  for (const int on : step.on) {
    const auto at = std::find_if(steps.begin(), steps.end(),
                                 [&](const BuildStep& other) { return other.box == on; });
    text += fmt::format(" {} {}", at - steps.begin() + 1,
                        structure.boxes()[static_cast<std::size_t>(on)].name);
    if (on != step.on.back()) text += ",";
  }
  if (std::abs(step.yaw_deg) >= 0.05) {
    text += fmt::format(", {:.3g}° {}", std::abs(step.yaw_deg),
                        step.yaw_deg > 0 ? "counterclockwise" : "clockwise");
  }
  return text;
}

/// The box over which a step's overhang is shown.
std::optional<int> Reference(const std::vector<BuildStep>& steps, std::size_t i) {
  if (!steps[i].on.empty()) return steps[i].on.front();
  if (steps[i].on_floor && i > 0) return steps.front().box;
  return std::nullopt;
}

void DrawSteps(const Structure& structure, const std::vector<BuildStep>& steps, Svg* svg) {
  const auto box_of = [&](int b) -> const Box& {
    return structure.boxes()[static_cast<std::size_t>(b)];
  };
  Eigen::AlignedBox3d floor;
  for (const BuildStep& step : steps) {
    if (step.on_floor) floor.extend(BoundsOf(box_of(step.box)));
  }
  std::vector<Eigen::AlignedBox3d> shown{floor};
  for (std::size_t i = 0; i < steps.size(); ++i) {
    shown.push_back(BoundsOf(box_of(steps[i].box)));
    if (const auto other = Reference(steps, i)) shown.back().extend(BoundsOf(box_of(*other)));
  }

  const auto count = shown.size();
  std::size_t columns = 1;
  double size = 0;
  for (std::size_t c = 1; c <= count; ++c) {
    const double rows = std::ceil(static_cast<double>(count) / static_cast<double>(c));
    const double cell = std::min((kWidth - 2 * kMargin) / static_cast<double>(c),
                                 (kStepsBottom - kStepsTop) / rows);
    if (cell > size + 1) {
      size = cell;
      columns = c;
    }
  }
  const double width = (kWidth - 2 * kMargin) / static_cast<double>(columns);
  const double height = (kStepsBottom - kStepsTop) /
                        std::ceil(static_cast<double>(count) / static_cast<double>(columns));
  const double text = Cell::TextSize(width, height);
  double pixels = std::numeric_limits<double>::infinity();
  for (const Eigen::AlignedBox3d& all : shown) {
    pixels = std::min({pixels, (width - 2 * Cell::kSide * text) / all.sizes().x(),
                       (height - (Cell::kHead + Cell::kBelow + 14) * text) / all.sizes().z()});
  }

  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t row = k / columns, column = k % columns;
    Cell cell(kMargin + width * static_cast<double>(column),
              kStepsTop + height * static_cast<double>(row), width, height, pixels, svg);
    cell.Centre(shown[k]);
    if (k == 0) {
      cell.Head("On the floor",
                {fmt::format("origin (+) {} from its front edge,", Millimetres(floor.max().x())),
                 fmt::format("{} from its right edge, {} above", Millimetres(floor.max().z()),
                             Millimetres(-structure.FloorHeight()))});
      for (const BuildStep& step : steps) {
        if (step.on_floor) cell.Draw(box_of(step.box), "fill=\"#fff\" stroke=\"#222\"");
      }
      cell.Sides({Millimetres(floor.sizes().z()), "", Millimetres(floor.sizes().x()), ""},
                 floor.center());
      cell.Cross(Eigen::Vector3d::Zero());
      continue;
    }
    const BuildStep& step = steps[k - 1];
    const Box& box = box_of(step.box);
    cell.Head(fmt::format("{} {}", k, box.name), {Edges(step), StandsOn(structure, steps, step),
                                                  "measured: ______ × ______ × ______"});
    const auto other = Reference(steps, k - 1);
    cell.Draw(box, fmt::format("fill=\"{}\" stroke=\"#222\"", Tint(k - 1, 1)));
    if (other) {
      cell.Draw(box_of(*other), "class=\"below\"");
      const Overhang& over = step.overhang;
      cell.Sides({Beyond(over.front), Beyond(over.back), Beyond(over.right), Beyond(over.left)},
                 box.structure_from_box.translation());
    }
    cell.Number(box.structure_from_box.translation(), k);
  }
}

}  // namespace

std::string BuildSheet(const Structure& structure) {
  if (!structure.IsOfBoxes()) {
    throw DataError(
        fmt::format("{}: only a stack of boxes has a build sheet, and this structure is a mesh",
                    structure.name()));
  }
  const std::vector<BuildStep> steps = BuildSteps(structure);
  Svg svg(kWidth, kHeight,
          ".cell{fill:none;stroke:#bbb}.below{fill:none;stroke:#222;stroke-dasharray:5 3}"
          ".number{font-weight:bold;text-anchor:middle}.arrow{stroke:#222;stroke-width:2}"
          ".origin{stroke:#d55e00;stroke-width:2}");
  const double room = kWidth - 2 * kMargin;
  svg.Text({kMargin, 58}, Fitted("How to build " + structure.name(), room, kBold * 22),
           Font(22, "font-weight=\"bold\""));
  svg.Text({kMargin, 80},
           fmt::format("{} {}, {} mm high. Build from 1 to {}. All lengths are in millimetres.",
                       steps.size(), steps.size() == 1 ? "box" : "boxes",
                       Millimetres(structure.Height()), steps.size()));
  constexpr double kMiddle = kWidth / 2, kHalfGap = kBetweenViews / 2;
  DrawView(structure, steps, {"front (+x)", "right (+z)"}, kMargin + kHalfGap, kMiddle - kHalfGap,
           &svg);
  DrawView(SeenFromBehind(structure), steps, {"back (-x)", "left (-z)"}, kMiddle + kHalfGap,
           kWidth - kMargin - kHalfGap, &svg);
  DrawSteps(structure, steps, &svg);
  const std::array<std::string, 4> notes = {
      "Plans are seen from above. Dashed: the box below. (A second box on the floor is measured "
      "from "
      "box 1.)",
      "“120 out”: this edge stands 120 mm beyond the dashed one. “120 in”: it is set back by 120 "
      "mm. “flush”: neither.",
      "Measure to a few millimetres, tape or glue the boxes together, and measure again when the "
      "stack stands.",
      fmt::format("structure {}, sha256 {}", structure.name(), structure.Hash().substr(0, 16))};
  for (std::size_t i = 0; i < notes.size(); ++i) {
    svg.Text({kMargin, kStepsBottom + 18 + 15 * static_cast<double>(i)},
             Fitted(notes[i], room, kText), Font(kText));
  }
  return svg.Finished();
}

}  // namespace volalign
