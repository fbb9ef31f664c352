#include "render/scene.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "core/base/random.h"
#include "core/base/statistics.h"
#include "core/geometry/visibility.h"

namespace volalign {
namespace {

constexpr double kSensorClearance = 0.45;   // m, half side of the square that stays free
constexpr double kWallClearance = 0.45;     // m, from the structure elsewhere: beyond all fixtures
constexpr double kCorridorHalfWidth = 0.5;  // m, of a sensor's free view of the structure
constexpr int kAttempts = 12;               // placements tried before an object is left out

Pose Upright(double x, double y, double z, double yaw) {
  Pose pose = Pose::Identity();
  pose.linear() = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitY()).toRotationMatrix();
  pose.translation() = Eigen::Vector3d(x, y, z);
  return pose;
}

/// A rectangle on the floor.
struct Footprint {
  Eigen::Vector2d centre;  // x, z
  Eigen::Vector2d axis;    // unit; the other axis is perpendicular
  Eigen::Vector2d half;    // along axis and across it
};

Footprint FootprintOf(const Pose& base, double half_x, double half_z) {
  const Eigen::Vector3d x = base.linear().col(0);
  return {Eigen::Vector2d(base.translation().x(), base.translation().z()),
          Eigen::Vector2d(x.x(), x.z()).normalized(), Eigen::Vector2d(half_x, half_z)};
}

double Reach(const Footprint& f, const Eigen::Vector2d& direction) {
  const Eigen::Vector2d across(-f.axis.y(), f.axis.x());
  return f.half.x() * std::abs(f.axis.dot(direction)) +
         f.half.y() * std::abs(across.dot(direction));
}

/// Whether one of the rectangles' four axes separates them by more than `gap`.
bool Apart(const Footprint& a, const Footprint& b, double gap) {
  const Eigen::Vector2d d = b.centre - a.centre;
  for (const Footprint* f : {&a, &b}) {
    for (const Eigen::Vector2d& axis : {f->axis, Eigen::Vector2d(-f->axis.y(), f->axis.x())}) {
      if (std::abs(d.dot(axis)) - Reach(a, axis) - Reach(b, axis) > gap) return true;
    }
  }
  return false;
}

std::vector<Footprint> BoxFootprints(const Structure& structure, const Pose& scene_from_structure) {
  std::vector<Footprint> footprints;
  for (const Box& box : structure.boxes()) {
    footprints.push_back(FootprintOf(scene_from_structure * box.structure_from_box,
                                     0.5 * box.size.x(), 0.5 * box.size.z()));
  }
  return footprints;
}

/// The floor area that only the sensor and its tripod may use.
Footprint TripodFootprint(const Pose& structure_from_sensor) {
  const Eigen::Vector3d& at = structure_from_sensor.translation();
  return {Eigen::Vector2d(at.x(), at.z()), Eigen::Vector2d::UnitX(),
          Eigen::Vector2d(kSensorClearance, kSensorClearance)};
}

/// Turns and shifts a face of an object.
void Move(const Pose& moved_from_face, SceneFace* face) {
  for (Eigen::Vector3f& corner : face->corners) {
    corner = (moved_from_face * corner.cast<double>()).cast<float>();
  }
  face->normal = moved_from_face.linear() * face->normal;
  face->offset += face->normal.dot(moved_from_face.translation());
}

/// Four walls, common yaw. Distances along +x', +z', -x', -z' of the turned axes.
struct Room {
  bool present = false;
  double yaw = 0;
  std::array<double, 4> distance{};
  double height = 3;
  bool has_ceiling = false;

  Eigen::Vector2d Direction(int wall) const {
    const double angle = yaw + 0.5 * M_PI * wall;
    return {std::cos(angle), std::sin(angle)};
  }
  bool Contains(const Footprint& f) const {
    for (int wall = 0; wall < 4; ++wall) {
      const Eigen::Vector2d n = Direction(wall);
      if (f.centre.dot(n) + Reach(f, n) > distance[static_cast<std::size_t>(wall)]) return false;
    }
    return true;
  }
};

class SceneBuilder {
 public:
  SceneBuilder(const SceneConfig& config, const Structure& structure, const SceneOptions& options,
               std::uint64_t seed, std::uint64_t index)
      : config_(config),
        structure_(structure),
        options_(options),
        seed_(seed),
        index_(index),
        floor_(structure.FloorHeight()) {
    if (options.structure_present) {
      boxes_ = BoxFootprints(structure, Pose::Identity());
      for (const OtherPlacement& place : options.elsewhere) {
        for (const Footprint& box :
             BoxFootprints(place.structure, place.structure_from_elsewhere)) {
          boxes_elsewhere_.push_back(box);
          boxes_.push_back(box);
        }
      }
    }
    for (const Pose& sensor : options.structure_from_sensors) {
      const Eigen::Vector2d at(sensor.translation().x(), sensor.translation().z());
      keep_out_.push_back(TripodFootprint(sensor));
      if (!options.structure_present) continue;
      corridors_.push_back(
          {0.5 * at, at.normalized(), Eigen::Vector2d(0.5 * at.norm(), kCorridorHalfWidth)});
      for (const OtherPlacement& place : options.elsewhere) {
        const Eigen::Vector3d& there = place.structure_from_elsewhere.translation();
        const Eigen::Vector2d to = Eigen::Vector2d(there.x(), there.z()), way = at - to;
        corridors_.push_back({0.5 * (at + to), way.normalized(),
                              Eigen::Vector2d(0.5 * way.norm(), kCorridorHalfWidth)});
      }
    }
  }

  SceneMesh Build() {
    if (options_.structure_present) mesh_.AppendStructure(structure_);
    AddRoom();
    AddDistractors();
    AddClutter();
    AddTripods();
    AddOccluder();
    TiltRoom();
    return std::move(mesh_);
  }

 private:
  void TiltRoom() {
    const Pose& turn = options_.structure_from_room;
    if (turn.isApprox(Pose::Identity(), 0)) return;
    for (SceneFace& face : mesh_.faces) {
      if (!mesh_.objects[static_cast<std::size_t>(face.object)].is_structure) Move(turn, &face);
    }
  }

  SceneObject Material(RandomStream& random) const {
    SceneObject object;
    const bool dark = random.Chance(config_.dark_probability);
    object.reflectivity =
        static_cast<float>(dark ? random.Uniform(0.01, 0.06) : random.Uniform(0.25, 0.9));
    object.texture = static_cast<float>(random.Uniform());
    return object;
  }

  void BoxAt(const Pose& base, const Eigen::Vector3d& centre, const Eigen::Vector3d& size) {
    Pose pose = base;
    pose.translation() = base * centre;
    mesh_.AppendBox(pose, size);
  }

  bool Free(const Footprint& f, double gap, bool keep_corridors) const {
    const auto apart = [&f](const std::vector<Footprint>& others, double distance) {
      return std::all_of(others.begin(), others.end(),
                         [&](const Footprint& o) { return Apart(f, o, distance); });
    };
    return apart(boxes_, gap) && apart(keep_out_, 0) && apart(placed_, 0) &&
           (!keep_corridors || apart(corridors_, 0)) && (!room_.present || room_.Contains(f));
  }

  void AddRoom() {
    RandomStream random(seed_, index_, "room");
    room_ = DrawRoom(random);
    if (!room_.present) return;
    AppendShell(random);
    AppendBaseboardsAndFixtures(random);
  }

  Room DrawRoom(RandomStream& random) const {
    Room room;
    room.present = random.Chance(options_.room_probability);
    room.yaw = random.Uniform(0, 0.5 * M_PI);
    for (int wall = 0; wall < 4; ++wall) {
      double& d = room.distance[static_cast<std::size_t>(wall)];
      d = random.Uniform(config_.wall_distance_m[0], config_.wall_distance_m[1]);
      for (const Pose& sensor : options_.structure_from_sensors) {
        const Eigen::Vector2d at(sensor.translation().x(), sensor.translation().z());
        d = std::max(d, at.dot(room.Direction(wall)) + kSensorClearance);
      }
      for (const Footprint& box : boxes_elsewhere_) {
        const Eigen::Vector2d n = room.Direction(wall);
        d = std::max(d, box.centre.dot(n) + Reach(box, n) + kWallClearance);
      }
    }
    room.has_ceiling = random.Chance(config_.ceiling_probability);
    room.height = random.Uniform(config_.ceiling_height_m[0], config_.ceiling_height_m[1]);
    for (const Pose& sensor : options_.structure_from_sensors) {
      room.height = std::max(room.height, sensor.translation().y() - floor_ + 0.2);
    }
    room.height = std::max(room.height, structure_.Height() + 0.1);
    if (!room.has_ceiling) room.height += 3;
    return room;
  }

  /// Floor, walls and, perhaps, the ceiling.
  void AppendShell(RandomStream& random) {
    const auto corner = [this](int wall, double y) {
      const auto w = static_cast<std::size_t>(wall % 4);
      const auto next = static_cast<std::size_t>((wall + 1) % 4);
      const Eigen::Vector2d p = room_.distance[w] * room_.Direction(wall) +
                                room_.distance[next] * room_.Direction(wall + 1);
      return Eigen::Vector3d(p.x(), floor_ + y, p.y());
    };
    const auto plain = [&random](double low_texture) {
      SceneObject object;
      object.reflectivity = static_cast<float>(random.Uniform(0.25, 0.9));
      object.texture = static_cast<float>(random.Uniform(low_texture, 1));
      return object;
    };
    mesh_.BeginObject(plain(0.3));
    mesh_.AppendQuad({corner(0, 0), corner(1, 0), corner(2, 0), corner(3, 0)},
                     Eigen::Vector3d::UnitY());
    const double h = room_.height;
    const SceneObject wall_paint = plain(0);
    for (int wall = 0; wall < 4; ++wall) {
      mesh_.BeginObject(wall_paint);
      const Eigen::Vector2d n = -room_.Direction(wall);
      mesh_.AppendQuad({corner(wall + 3, 0), corner(wall, 0), corner(wall, h), corner(wall + 3, h)},
                       Eigen::Vector3d(n.x(), 0, n.y()));
    }
    const SceneObject ceiling = plain(0);
    if (room_.has_ceiling) {
      mesh_.BeginObject(ceiling);
      mesh_.AppendQuad({corner(0, h), corner(1, h), corner(2, h), corner(3, h)},
                       -Eigen::Vector3d::UnitY());
    }
  }

  /// Adds baseboards and fixtures along the walls: doors, windows, boards and shelves.
  void AppendBaseboardsAndFixtures(RandomStream& random) {
    const bool baseboard = random.Chance(0.5);
    const double baseboard_height = random.Uniform(0.06, 0.25);
    SceneObject rubber;
    rubber.reflectivity = static_cast<float>(random.Uniform(0.01, 0.1));
    for (int wall = 0; wall < 4; ++wall) {
      const double left = room_.distance[static_cast<std::size_t>((wall + 3) % 4)];
      const double right = room_.distance[static_cast<std::size_t>((wall + 1) % 4)];
      if (baseboard) {
        mesh_.BeginObject(rubber);
        AddOnWall(wall, 0, 0.5 * baseboard_height, 2 * (right + left), baseboard_height, 0.02);
      }
      const int fixtures = random.Below(4);
      for (int i = 0; i < fixtures; ++i) {
        mesh_.BeginObject(Material(random));
        const double width = random.Uniform(0.3, 1.8), height = random.Uniform(0.2, 1.6);
        const double along = random.Uniform(-left, right);
        const double depth = random.Uniform(0.01, 0.3);
        const double up = random.Uniform(0.3, 2.2);
        AddOnWall(wall, along, up, width, height, depth);
      }
    }
  }

  void AddOnWall(int wall, double along, double up, double width, double height, double depth) {
    const Eigen::Vector2d n = room_.Direction(wall), t = room_.Direction(wall + 1);
    const Eigen::Vector2d p =
        (room_.distance[static_cast<std::size_t>(wall)] - 0.5 * depth) * n + along * t;
    // A rotation of -angle about y takes x to (cos, sin) in (x, z).
    const double yaw = -(room_.yaw + 0.5 * M_PI * wall);
    mesh_.AppendBox(Upright(p.x(), floor_ + std::max(up, 0.5 * height), p.y(), yaw),
                    Eigen::Vector3d(depth, height, width));
  }

  /// Draws a place for a footprint: anywhere in the room, half of the time along a wall.
  Pose DrawPlace(RandomStream& random, double half_x, double half_z) const {
    const auto inside = [&](int wall, double margin) {
      return std::max(0.3, room_.distance[static_cast<std::size_t>(wall)] - margin);
    };
    const double reach = std::hypot(half_x, half_z);
    const bool at_wall = random.Chance(0.5);
    const int wall = random.Below(4);
    const double free_yaw = random.Uniform(0, 2 * M_PI);
    const double s = random.Uniform(), t = random.Uniform();
    const Eigen::Vector2d n = room_.Direction(wall), along = room_.Direction(wall + 1);
    const double low = -inside((wall + 3) % 4, reach), high = inside((wall + 1) % 4, reach);
    const double side = low + (high - low) * s;
    if (at_wall) {
      const Eigen::Vector2d p = inside(wall, half_z + 0.03) * n + side * along;
      return Upright(p.x(), floor_, p.y(), -(room_.yaw + 0.5 * M_PI * wall) + 0.5 * M_PI);
    }
    const double back = -inside((wall + 2) % 4, reach), front = inside(wall, reach);
    const Eigen::Vector2d p = (back + (front - back) * t) * n + side * along;
    return Upright(p.x(), floor_, p.y(), free_yaw);
  }

  /// A piece of furniture on its footprint: half extents and height, m.
  struct Piece {
    Pose base;
    double half_x = 0, half_z = 0, height = 0;
    double wx() const { return 2 * half_x; }
    double wz() const { return 2 * half_z; }
  };

  void AddClutter() {
    RandomStream random(seed_, index_, "clutter");
    const int low = config_.clutter_count[0], high = config_.clutter_count[1];
    const int count = low + random.Below(std::max(high - low, 0) + 1);
    for (int i = 0; i < count; ++i) AddFurniture(random);
  }

  void AddFurniture(RandomStream& random) {
    enum { kBox, kTable, kDesk, kCabinet, kChair, kPole, kBall, kPerson, kStack, kLamp, kKinds };
    using Append = void (SceneBuilder::*)(const Piece&, RandomStream&);
    constexpr std::array<Append, kKinds> kAppend = {
        &SceneBuilder::AppendBlock,       &SceneBuilder::AppendTable<false>,
        &SceneBuilder::AppendTable<true>, &SceneBuilder::AppendCabinet,
        &SceneBuilder::AppendChair,       &SceneBuilder::AppendPole,
        &SceneBuilder::AppendBall,        &SceneBuilder::AppendPerson,
        &SceneBuilder::AppendStack,       &SceneBuilder::AppendLamp};
    const int kind = random.Below(kKinds);
    const double size = random.Uniform(config_.clutter_size_m[0], config_.clutter_size_m[1]);
    const double s = random.Uniform(0.3, 1), t = random.Uniform(0.3, 1);
    Piece piece{Pose(), 0.5 * size * s, 0.5 * size * t, size};
    if (kind == kTable || kind == kDesk) {
      piece.half_x = 0.5 * std::max(0.6, size);
      piece.half_z = piece.half_x * t;
      piece.height = random.Uniform(0.4, 1.1);
    } else if (kind == kCabinet) {
      piece.half_x = 0.5 * std::max(0.3, size * s);
      piece.half_z = 0.5 * random.Uniform(0.2, 0.6);
      piece.height = random.Uniform(0.5, 2.2);
    } else if (kind == kChair) {
      piece.half_x = piece.half_z = 0.5 * random.Uniform(0.35, 0.6);
      piece.height = random.Uniform(0.7, 1.2);
    } else if (kind == kPole) {
      piece.half_x = piece.half_z = 0.5 * random.Uniform(0.03, 0.5);
      piece.height = random.Uniform(0.2, 2.2);
    } else if (kind == kBall) {
      piece.half_x = piece.half_z = 0.5 * std::min(size, 0.8);
    } else if (kind == kPerson) {
      piece.half_x = 0.28;
      piece.half_z = 0.18;
      piece.height = random.Uniform(1.45, 1.95);
    }
    Footprint footprint;
    bool free = false;
    for (int attempt = 0; attempt < kAttempts && !free; ++attempt) {
      piece.base = DrawPlace(random, piece.half_x, piece.half_z);
      footprint = FootprintOf(piece.base, piece.half_x, piece.half_z);
      free = Free(footprint, config_.clutter_clearance_m, /*keep_corridors=*/true);
    }
    if (!free) return;
    if (kind != kLamp) placed_.push_back(footprint);
    mesh_.BeginObject(Material(random));
    (this->*kAppend[static_cast<std::size_t>(kind)])(piece, random);
  }

  void AppendBlock(const Piece& piece, RandomStream& /*random*/) {
    BoxAt(piece.base, {0, 0.5 * piece.height, 0}, {piece.wx(), piece.height, piece.wz()});
  }

  void AppendPole(const Piece& piece, RandomStream& /*random*/) {
    mesh_.AppendCylinder(piece.base * Eigen::Vector3d::Zero(),
                         piece.base * Eigen::Vector3d(0, piece.height, 0), piece.half_x, 10);
  }

  void AppendLegs(const Pose& base, double half_x, double half_z, double height, double width) {
    for (const double x : {-1.0, 1.0}) {
      for (const double z : {-1.0, 1.0}) {
        BoxAt(base, {x * (half_x - 0.5 * width), 0.5 * height, z * (half_z - 0.5 * width)},
              {width, height, width});
      }
    }
  }

  /// A table with objects, or monitors, on it.
  template <bool monitors>
  void AppendTable(const Piece& piece, RandomStream& random) {
    const auto& [base, half_x, half_z, height] = piece;
    const double top = random.Uniform(0.02, 0.06);
    BoxAt(base, {0, height - 0.5 * top, 0}, {piece.wx(), top, piece.wz()});
    AppendLegs(base, half_x, half_z, height - top, random.Uniform(0.03, 0.08));
    const int things = random.Below(4);
    for (int i = 0; i < things; ++i) {
      mesh_.BeginObject(Material(random));
      const double x = random.Uniform(-0.7, 0.7) * half_x, z = random.Uniform(-0.6, 0.6) * half_z;
      if (monitors) {
        const double w = random.Uniform(0.35, 0.65), h = random.Uniform(0.25, 0.4);
        BoxAt(base, {x, height + 0.1 + 0.5 * h, z}, {w, h, 0.03});
        BoxAt(base, {x, height + 0.06, z + 0.03}, {0.06, 0.12, 0.03});
      } else {
        const double w = random.Uniform(0.08, 0.4), h = random.Uniform(0.05, 0.4);
        BoxAt(base, {x, height + 0.5 * h, z}, {w, h, random.Uniform(0.08, 0.3)});
      }
    }
  }

  /// A cabinet: closed, or open shelves.
  void AppendCabinet(const Piece& piece, RandomStream& random) {
    const auto& [base, half_x, half_z, height] = piece;
    if (random.Chance(0.5)) return AppendBlock(piece, random);
    const int boards = 2 + random.Below(4);
    for (int i = 0; i <= boards; ++i) {
      BoxAt(base, {0, 0.015 + (height - 0.03) * i / boards, 0}, {piece.wx(), 0.03, piece.wz()});
    }
    for (const double x : {-1.0, 1.0}) {
      BoxAt(base, {x * (half_x - 0.01), 0.5 * height, 0}, {0.02, height, piece.wz()});
    }
  }

  void AppendChair(const Piece& piece, RandomStream& /*random*/) {
    const auto& [base, half_x, half_z, height] = piece;
    const double seat = std::min(0.5, 0.55 * height);
    BoxAt(base, {0, seat, 0}, {piece.wx(), 0.06, piece.wz()});
    BoxAt(base, {0, 0.5 * (seat + height), half_z - 0.03}, {piece.wx(), height - seat, 0.05});
    AppendLegs(base, half_x, half_z, seat - 0.03, 0.04);
  }

  /// A ball on the floor or on a stick.
  void AppendBall(const Piece& piece, RandomStream& random) {
    const double radius = piece.half_x;
    const double raised = random.Chance(0.3) ? random.Uniform(0, 1.5) : 0;
    mesh_.AppendSphere(piece.base * Eigen::Vector3d(0, radius + raised, 0), radius, 10);
    if (raised > 0) {
      mesh_.AppendCylinder(piece.base * Eigen::Vector3d::Zero(),
                           piece.base * Eigen::Vector3d(0, raised, 0), 0.03, 6);
    }
  }

  void AppendPerson(const Piece& piece, RandomStream& random) {
    const Pose& base = piece.base;
    const double hip = 0.5 * piece.height, shoulder = 0.8 * piece.height;
    const double sway = random.Uniform(-0.15, 0.15);
    for (const double side : {-1.0, 1.0}) {
      mesh_.AppendCapsule(base * Eigen::Vector3d(side * 0.1, 0.06, side * sway),
                          base * Eigen::Vector3d(side * 0.09, hip, 0), 0.08, 7);
      const double hand_z = random.Uniform(-0.2, 0.2);
      const double hand_x = random.Uniform(0.2, 0.3);
      mesh_.AppendCapsule(base * Eigen::Vector3d(side * 0.21, shoulder - 0.04, 0),
                          base * Eigen::Vector3d(side * hand_x, hip, hand_z), 0.05, 6);
    }
    mesh_.AppendCapsule(base * Eigen::Vector3d(0, hip + 0.05, 0),
                        base * Eigen::Vector3d(0, shoulder - 0.12, 0), 0.17, 9);
    mesh_.AppendSphere(base * Eigen::Vector3d(0, piece.height - 0.12, 0), 0.12, 9);
  }

  /// One to three boxes, each turned a little.
  void AppendStack(const Piece& piece, RandomStream& random) {
    double y = 0;
    const int boxes = 1 + random.Below(3);
    for (int i = 0; i < boxes; ++i) {
      const double h = piece.height / 3 * random.Uniform(0.6, 1);
      Pose turned = piece.base;
      turned.linear() *=
          Eigen::AngleAxisd(random.Uniform(-0.2, 0.2), Eigen::Vector3d::UnitY()).toRotationMatrix();
      BoxAt(turned, {0, y + 0.5 * h, 0},
            {piece.wx() * random.Uniform(0.7, 1), h, piece.wz() * random.Uniform(0.7, 1)});
      y += h;
    }
  }

  /// A lamp that hangs from the ceiling.
  void AppendLamp(const Piece& piece, RandomStream& random) {
    const double end = random.Uniform(1.9, 2.3);
    const double top = std::max(room_.height, end + 0.1);
    mesh_.AppendCylinder(piece.base * Eigen::Vector3d(0, end, 0),
                         piece.base * Eigen::Vector3d(0, top, 0), random.Uniform(0.015, 0.05), 6);
    BoxAt(piece.base, {0, end, 0},
          {0.3 * piece.wx() + 0.1, random.Uniform(0.04, 0.2), 0.3 * piece.wz() + 0.1});
  }

  void AddTripods() {
    RandomStream random(seed_, index_, "tripods");
    const int low = config_.tripod_count[0], high = config_.tripod_count[1];
    const int count = low + random.Below(std::max(high - low, 0) + 1);
    for (int i = 0; i < count; ++i) {
      bool free = false;
      Pose place = Pose::Identity();
      for (int attempt = 0; attempt < kAttempts && !free; ++attempt) {
        const double rho =
            random.Uniform(config_.tripod_distance_m[0], config_.tripod_distance_m[1]);
        const double phi = random.Uniform(0, 2 * M_PI);
        const double roll = random.Chance(0.5) ? 0.5 * M_PI : 0;
        const double look_x = random.Uniform(-0.2, 0.2), look_z = random.Uniform(-0.2, 0.2);
        const double height = random.Uniform(0.9, 1.5);
        place = LookAt({rho * std::cos(phi), floor_ + height, rho * std::sin(phi)},
                       {look_x, floor_ + 0.8, look_z}, roll);
        const Footprint footprint =
            FootprintOf(Upright(place.translation().x(), 0, place.translation().z(), 0), 0.3, 0.3);
        free = Free(footprint, config_.clutter_clearance_m, /*keep_corridors=*/true);
        if (free) placed_.push_back(footprint);
      }
      if (free) AppendTripod(place, floor_, &mesh_);
    }
  }

  /// Adds boxes of about the structure's sizes near it, single or in stacks of two, that do not
  /// belong to it.
  void AddDistractors() {
    RandomStream random(seed_, index_, "distractors");
    if (!random.Chance(config_.distractor_probability)) return;
    const int count = 1 + random.Below(3);
    for (int i = 0; i < count; ++i) {
      const auto& boxes = structure_.boxes();
      const bool in_front = random.Chance(0.3);
      const int storeys = in_front || random.Chance(0.6) ? 1 : 2;
      std::array<Eigen::Vector3d, 2> sizes;
      for (Eigen::Vector3d& size : sizes) {
        size = boxes[static_cast<std::size_t>(random.Below(static_cast<int>(boxes.size())))].size;
        const int turn = random.Below(3);
        size = Eigen::Vector3d(size[turn], size[(turn + 1) % 3], size[(turn + 2) % 3]);
        size *= random.Uniform(0.75, 1.25);
      }
      for (int attempt = 0; attempt < kAttempts; ++attempt) {
        const double rho = random.Uniform(0.5, 1.7), phi = random.Uniform(0, 2 * M_PI);
        const Pose base =
            Upright(rho * std::cos(phi), floor_, rho * std::sin(phi), random.Uniform(0, 2 * M_PI));
        const Footprint footprint = FootprintOf(base, 0.5 * sizes[0].x(), 0.5 * sizes[0].z());
        if (!Free(footprint, config_.clutter_clearance_m, !in_front)) continue;
        if (storeys == 2) {
          const double reach = 0.5 * std::hypot(sizes[1].x(), sizes[1].z());
          if (!Free(FootprintOf(base, reach, reach), config_.clutter_clearance_m, true)) continue;
        }
        placed_.push_back(footprint);
        double y = 0;
        for (int storey = 0; storey < storeys; ++storey) {
          const Eigen::Vector3d& size = sizes[static_cast<std::size_t>(storey)];
          SceneObject cardboard;
          cardboard.reflectivity = static_cast<float>(random.Uniform(0.4, 0.9));
          mesh_.BeginObject(cardboard);
          Pose turned = base;
          if (storey > 0) {
            turned.linear() *=
                Eigen::AngleAxisd(random.Uniform(0, 2 * M_PI), Eigen::Vector3d::UnitY())
                    .toRotationMatrix();
          }
          BoxAt(turned, {0, y + 0.5 * size.y(), 0}, size);
          y += size.y();
        }
        break;
      }
    }
  }

  /// Adds a pole, a low box or a slanted bar between the first sensor and the structure. It hides a
  /// strip of the structure.
  void AddOccluder() {
    RandomStream random(seed_, index_, "occluder");
    if (!random.Chance(config_.occluder_probability) || options_.structure_from_sensors.empty()) {
      return;
    }
    const Eigen::Vector3d eye = options_.structure_from_sensors[0].translation();
    const Eigen::Vector2d at(eye.x(), eye.z());
    const Eigen::Vector2d towards = -at.normalized();
    const Eigen::Vector2d across(-towards.y(), towards.x());
    for (int attempt = 0; attempt < kAttempts; ++attempt) {
      const int kind = random.Below(3);
      const double t = random.Uniform(0.25, 0.75);
      const double aim = random.Uniform(-0.45, 0.45);
      const double half_width = random.Uniform(0.01, 0.14) * t;
      const double low_top = random.Uniform(0.1, 0.55);
      const double lean = random.Uniform(-0.5, 0.5);
      const double top = random.Uniform(0.8, 2.2);
      const SceneObject material = Material(random);
      const Eigen::Vector2d p = (1 - t) * at + t * aim * across;
      const double half = kind == 1 ? 2.5 * half_width : half_width;
      const Pose base = Upright(p.x(), floor_, p.y(), random.Uniform(0, 2 * M_PI));
      const Footprint footprint = FootprintOf(base, half, half);
      const bool near_sensor = t * at.norm() < 0.4;
      const bool clear = std::all_of(boxes_.begin(), boxes_.end(), [&](const Footprint& box) {
        return Apart(footprint, box, config_.clutter_clearance_m);
      });
      if (near_sensor || !clear) continue;
      mesh_.BeginObject(material);
      if (kind == 0) {
        mesh_.AppendCylinder(base * Eigen::Vector3d::Zero(), base * Eigen::Vector3d(0, top, 0),
                             half, 8);
      } else if (kind == 1) {
        // Seen from the sensor, its top meets the structure at `low_top` above the floor.
        const double height = std::max(0.08, (1 - t) * (eye.y() - floor_) + t * low_top);
        BoxAt(base, {0, 0.5 * height, 0}, {2 * half, height, 2 * half});
      } else {
        const Eigen::Vector3d shift = lean * Eigen::Vector3d(across.x(), 0, across.y());
        mesh_.AppendCapsule(base * Eigen::Vector3d(0, 0.05, 0),
                            base * Eigen::Vector3d(0, top, 0) + shift, half, 6);
      }
      return;
    }
  }

  const SceneConfig& config_;
  const Structure& structure_;
  const SceneOptions& options_;
  std::uint64_t seed_, index_;
  double floor_;
  Room room_;
  SceneMesh mesh_;
  std::vector<Footprint> boxes_;            // at all places of the structure
  std::vector<Footprint> boxes_elsewhere_;  // those that are not drawn
  std::vector<Footprint> keep_out_, corridors_, placed_;
};

}  // namespace

AssembledStructure Assemble(const Structure& nominal, const AssemblyConfig& config,
                            std::uint64_t seed, std::uint64_t index,
                            std::optional<double> size_scale) {
  RandomStream random(seed, index, "assembly");
  AssembledStructure out;
  out.size_scale = 1 + 0.01 * config.size_scale_percent * random.Normal();
  if (size_scale) out.size_scale = *size_scale;
  const double floor = nominal.FloorHeight();
  for (const Box& box : nominal.boxes()) {
    const Eigen::Vector3d centre = box.structure_from_box.translation();
    const double x = 1e-3 * config.position_mm * random.Normal();
    const double z = 1e-3 * config.position_mm * random.Normal();
    const double yaw = config.yaw_deg * M_PI / 180 * random.Normal();
    const double y = (centre.y() - floor) * (out.size_scale - 1);
    Pose offset = Pose::Identity();
    offset.linear() = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitY()).toRotationMatrix();
    offset.translation() = centre - offset.linear() * centre + Eigen::Vector3d(x, y, z);
    out.box_offsets.push_back(offset);
  }
  out.structure = nominal.DisplacedToDraw(out.box_offsets, out.size_scale);
  RandomStream tilt_random(seed, index, "floor");
  const double about_x = config.floor_tilt_deg * M_PI / 180 * tilt_random.Normal();
  const double about_z = config.floor_tilt_deg * M_PI / 180 * tilt_random.Normal();
  const Eigen::Vector3d pivot(0, floor, 0);
  out.structure_from_room.linear() = (Eigen::AngleAxisd(about_x, Eigen::Vector3d::UnitX()) *
                                      Eigen::AngleAxisd(about_z, Eigen::Vector3d::UnitZ()))
                                         .toRotationMatrix();
  out.structure_from_room.translation() = pivot - out.structure_from_room.linear() * pivot;
  return out;
}

SceneMesh MoveStructure(const SceneMesh& scene, const Structure& structure,
                        const Pose& new_from_scene) {
  SceneMesh moved;
  const auto is_structure = [](const SceneObject& object) { return object.is_structure; };
  if (std::any_of(scene.objects.begin(), scene.objects.end(), is_structure)) {
    moved.AppendStructure(structure);
  }
  std::vector<int> new_object(scene.objects.size(), -1);
  for (std::size_t i = 0; i < scene.objects.size(); ++i) {
    if (scene.objects[i].is_structure) continue;
    moved.BeginObject(scene.objects[i]);
    new_object[i] = static_cast<int>(moved.objects.size()) - 1;
  }
  for (SceneFace face : scene.faces) {
    const int object = new_object[static_cast<std::size_t>(face.object)];
    if (object < 0) continue;
    face.object = static_cast<std::int16_t>(object);
    Move(new_from_scene, &face);
    moved.faces.push_back(face);
  }
  return moved;
}

bool StandsInTripod(const OtherPlacement& elsewhere, const Pose& structure_from_sensor,
                    double gap) {
  const std::vector<Footprint> boxes =
      BoxFootprints(elsewhere.structure, elsewhere.structure_from_elsewhere);
  return std::any_of(boxes.begin(), boxes.end(), [&](const Footprint& box) {
    return !Apart(box, TripodFootprint(structure_from_sensor), gap);
  });
}

void AppendTripod(const Pose& structure_from_sensor, double floor_height, SceneMesh* mesh) {
  const Eigen::Vector3d at = structure_from_sensor.translation();
  const double height = std::max(0.3, at.y() - floor_height);
  SceneObject metal;
  metal.reflectivity = 0.3F;
  mesh->BeginObject(metal);
  Pose housing = structure_from_sensor;
  housing.translation() = at - 0.04 * structure_from_sensor.linear().col(2);
  mesh->AppendBox(housing, Eigen::Vector3d(0.11, 0.05, 0.07));
  const Eigen::Vector3d back = at - 0.05 * structure_from_sensor.linear().col(2);
  const Eigen::Vector3d hub(back.x(), floor_height + 0.6 * height, back.z());
  mesh->AppendCylinder(hub, Eigen::Vector3d(back.x(), at.y() - 0.03, back.z()), 0.018, 6);
  const double turn = std::atan2(at.z(), at.x());
  for (int leg = 0; leg < 3; ++leg) {
    const double angle = turn + 2 * M_PI * leg / 3;
    const Eigen::Vector3d foot(back.x() + 0.32 * height * std::cos(angle), floor_height,
                               back.z() + 0.32 * height * std::sin(angle));
    mesh->AppendCylinder(hub, foot, 0.014, 6);
  }
}

SceneMesh BuildScene(const SceneConfig& config, const Structure& structure,
                     const SceneOptions& options, std::uint64_t seed, std::uint64_t index) {
  return SceneBuilder(config, structure, options, seed, index).Build();
}

namespace {

constexpr double kBoardDistance = 0.7;    // m, horizontally from the sensor
constexpr double kBoardThickness = 0.02;  // m
constexpr double kBoardMargin = 0.3;      // m, by which a board is larger than the hidden part

/// The places where a sensor's rays to the structure pass through the board's upright plane.
struct Window {
  Eigen::Vector3d foot;  // below the sensor, on the floor
  Eigen::Vector3d forward, right;
  std::vector<double> sides, heights;  // along `right`, and above the floor, m
};

Window FindWindow(const Structure& structure, const RayTable& rays,
                  const Pose& structure_from_sensor) {
  const ExpectedView seen = CastView(structure, rays, structure_from_sensor);
  const Eigen::Vector3d& origin = structure_from_sensor.translation();
  Window window;
  window.foot = {origin.x(), structure.FloorHeight(), origin.z()};
  std::vector<Eigen::Vector3d> directions;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (int v = 0; v < rays.height; ++v) {
    for (int u = 0; u < rays.width; ++u) {
      if (seen.labels(u, v) == 0) continue;
      const Eigen::Vector2f& ray = rays.at(u, v);
      directions.push_back(structure_from_sensor.linear() *
                           Eigen::Vector3d(ray.x(), ray.y(), 1).normalized());
      mean += directions.back();
    }
  }
  if (directions.empty()) return window;
  window.forward = Eigen::Vector3d(mean.x(), 0, mean.z()).normalized();
  window.right = window.forward.cross(Eigen::Vector3d::UnitY());
  for (const Eigen::Vector3d& direction : directions) {
    const double t = kBoardDistance / window.forward.dot(direction);
    if (!(t > 0)) continue;
    window.sides.push_back(t * window.right.dot(direction));
    window.heights.push_back(origin.y() + t * direction.y() - window.foot.y());
  }
  std::sort(window.sides.begin(), window.sides.end());
  std::sort(window.heights.begin(), window.heights.end());
  return window;
}

}  // namespace

void AppendBoard(const Structure& structure, const RayTable& rays,
                 const Pose& structure_from_sensor, double share, BoardEdge edge, SceneMesh* mesh) {
  const Window window = FindWindow(structure, rays, structure_from_sensor);
  if (window.sides.empty()) return;
  double left = window.sides.front() - kBoardMargin, right = window.sides.back() + kBoardMargin;
  double top = window.heights.back() + kBoardMargin;
  if (edge == BoardEdge::kLeft) right = Quantile(window.sides, share);
  if (edge == BoardEdge::kRight) left = Quantile(window.sides, 1 - share);
  if (edge == BoardEdge::kBelow) top = Quantile(window.heights, share);
  if (!(top > 0)) return;
  Pose pose = Pose::Identity();
  pose.linear().col(0) = window.right;
  pose.linear().col(1) = Eigen::Vector3d::UnitY();
  pose.linear().col(2) = window.right.cross(Eigen::Vector3d::UnitY());
  // The face towards the sensor is in the plane of the rays' places.
  pose.translation() = window.foot + (kBoardDistance + kBoardThickness / 2) * window.forward +
                       (left + right) / 2 * window.right + Eigen::Vector3d(0, top / 2, 0);
  mesh->BeginObject(SceneObject());
  mesh->AppendBox(pose, {right - left, top, kBoardThickness});
}

}  // namespace volalign
