#include "evaluation/labels/before_and_after.hpp"

#include "evaluation/labels/thinned_map.hpp"

#include <limits>

namespace stillmap::mapping {
namespace {

constexpr int kPictureSide = 1600;

/// Lines are drawn this often beside each other, so that they can be seen in a picture made
/// smaller.
constexpr int kLines = 3;
constexpr double kBetweenLinesM = 0.12;

/// A box where the object was first, and the way that it went.
void draw(TopView& view, const maps::MapObject& object, const Eigen::Vector3d& origin) {
  if (object.points_removed == 0 || object.placements.empty()) return;
  const bool moving = object.motion == maps::ObjectMotion::kMoving;
  const Colour colour = moving ? kMovingColour : kParkedColour;
  const maps::MapObject::Placement& first = object.placements.front();
  for (int line = 0; line < kLines; ++line) {
    const double beside = kBetweenLinesM * line;
    const maps::Box box{.centre = first.centre_map - origin,
                        .size_m = object.size_m + Eigen::Vector3d::Constant(2.0 * beside),
                        .yaw_rad = first.yaw_rad};
    view.add_box(box, Eigen::Isometry3d::Identity(), colour);
    for (std::size_t i = 1; moving && i < object.placements.size(); ++i) {
      const Eigen::Vector2d from = (object.placements[i - 1].centre_map - origin).head<2>();
      const Eigen::Vector2d to = (object.placements[i].centre_map - origin).head<2>();
      view.add_line(from.array() + beside, to.array() + beside, colour);
    }
  }
}

}  // namespace

TopView empty_view(const maps::MapPackage& map) {
  Eigen::Vector2d min = Eigen::Vector2d::Constant(std::numeric_limits<double>::max());
  Eigen::Vector2d max = -min;
  for (const maps::TileEntry& tile : map.tiles()) {
    min = min.cwiseMin(tile.from_origin().min().head<2>());
    max = max.cwiseMax(tile.from_origin().max().head<2>());
  }
  // As the preview: a map of one point has no extent of its own.
  return {min - Eigen::Vector2d::Ones(), max + Eigen::Vector2d::Ones(), kPictureSide};
}

BeforeAndAfter::BeforeAndAfter(const maps::MapPackage& map) : map_(map), before_(empty_view(map)) {}

void BeforeAndAfter::add_scan(const std::vector<Eigen::Vector3f>& positions) {
  for (const Eigen::Vector3f& p : positions) before_.add_point(p.cast<double>());
}

MapPictures BeforeAndAfter::finish() {
  TopView after = empty_view(map_);
  for_each_point(
      map_, [&](const Eigen::Vector3f& p, maps::PointKind) { after.add_point(p.cast<double>()); });
  for (const maps::MapObject& object : map_.objects()) {
    draw(before_, object, map_.manifest().origin);
    draw(after, object, map_.manifest().origin);
  }
  return {before_.png(), after.png()};
}

}  // namespace stillmap::mapping
