#pragma once

#include <Eigen/Core>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace stillmap::maps {

/// Where a map point comes from.
enum class PointKind : std::uint8_t {
  kMeasured = 0,
  kGround = 1,     ///< measured, and found to be ground
  kProjected = 2,  ///< moved down from an object
  kFilled = 3,     ///< synthetic ground
};
/// Whether a kind was measured where it lies (ground or not).
[[nodiscard]] constexpr bool is_measured(PointKind kind) {
  return kind == PointKind::kMeasured || kind == PointKind::kGround;
}

/// One point of a tile, 20 bytes, little endian where it lies in a file.
struct MapPoint {
  /// [m], relative to a corner that its `MapTile` knows, most often its tile's (`corner_of`).
  float x, y, z;
  float intensity;
  /// Observations merged into this point, saturating.
  std::uint16_t observations;
  PointKind kind;
  /// Object that a projected or filled point belongs to: 1 + (n - 1) % 255 with n =
  /// `PointHistory::object`; 0 = none.
  std::uint8_t object;
};
static_assert(sizeof(MapPoint) == 20);

/// More about a map point, which queries do not need. In packages of schema 1 it lies like this in
/// a file beside the tile (little endian, 16 bytes).
struct PointHistory {
  /// Ordinals of the first and the last scan that saw it, over all drives of the map.
  std::uint32_t first_scan, last_scan;
  /// Index in objects.json plus 1 of the object that a projected or filled point belongs to; 0 =
  /// none.
  std::uint32_t object;
  /// Unit normal of the surface around it times 127, towards where it was seen from; 0 0 0 where
  /// there is none (projected, filled, or too few points around).
  std::int8_t normal[3];
  /// 255 = a perfect plane, 0 = no surface at all.
  std::uint8_t planarity;
};
static_assert(sizeof(PointHistory) == 16);

/// One cell of the tile grid: x, y = floor((p - origin) / 20 m / 2^level).
struct TileId {
  std::uint32_t level = 0;
  std::int32_t x = 0;
  std::int32_t y = 0;
  auto operator<=>(const TileId&) const = default;
};

inline constexpr double kTileSizeM = 20.0;

/// Where a tile begins, relative to the map's origin [m]; its heights count from the origin.
[[nodiscard]] inline Eigen::Vector3d corner_of(TileId id) {
  const double width_m = std::ldexp(kTileSizeM, static_cast<int>(id.level));
  return {width_m * id.x, width_m * id.y, 0.0};
}

/// The same point elsewhere. @param position  [m], rounded to floats.
[[nodiscard]] inline MapPoint moved_to(MapPoint point, const Eigen::Vector3d& position) {
  point.x = static_cast<float>(position.x());
  point.y = static_cast<float>(position.y());
  point.z = static_cast<float>(position.z());
  return point;
}

/// The decoded points of one tile, which outlive the package. Their coordinates count from a corner
/// near them, so that floats keep their digits however far the tile lies from the map's origin.
class MapTile {
 public:
  /// No points.
  MapTile() = default;
  /// @param origin  of the map. @param corner  where the points' coordinates count from, relative
  /// to the origin [m].
  MapTile(const Eigen::Vector3d& origin, const Eigen::Vector3d& corner,
          std::vector<MapPoint> points)
      : origin_(origin), corner_(corner), points_(std::move(points)) {}

  [[nodiscard]] auto begin() const { return points_.begin(); }
  [[nodiscard]] auto end() const { return points_.end(); }
  [[nodiscard]] std::size_t size() const { return points_.size(); }
  [[nodiscard]] bool empty() const { return points_.empty(); }
  [[nodiscard]] const MapPoint& operator[](std::size_t i) const { return points_[i]; }

  /// Where a point lies in the map frame [m]. @param point  one of these.
  [[nodiscard]] Eigen::Vector3d position(const MapPoint& point) const {
    return origin_ + from_origin(point);
  }
  /// The same relative to the map's origin.
  [[nodiscard]] Eigen::Vector3d from_origin(const MapPoint& point) const {
    return corner_ + Eigen::Vector3d(point.x, point.y, point.z);
  }
  /// All of them with coordinates that count from another corner. @param corner  relative to the
  /// map's origin [m]: near the points, since floats grow coarse far from it.
  [[nodiscard]] std::vector<MapPoint> points_from(const Eigen::Vector3d& corner) && {
    const Eigen::Vector3d shift = corner_ - corner;
    if (shift != Eigen::Vector3d::Zero())
      for (MapPoint& point : points_)
        point = moved_to(point, shift + Eigen::Vector3d(point.x, point.y, point.z));
    return std::move(points_);
  }

 private:
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d corner_ = Eigen::Vector3d::Zero();
  std::vector<MapPoint> points_;
};

}  // namespace stillmap::maps
