#include "rebuild/map_comparison.hpp"

#include "consistency/surface_cells.hpp"
#include "core/ordered_pipeline.hpp"
#include "core/point_cells.hpp"
#include "core/share_of.hpp"

#include <stillmap/maps/cell_table.hpp>
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>
#include <vector>

namespace stillmap::mapping {
namespace {

constexpr double kCellM = 1.0;
/// Half a lane and a wheel; and as far as a street's ground is seen densely by a spinning sensor.
constexpr double kDrivenM = 2.0;
constexpr double kNearPathM = 15.0;
/// Key frames of a slow sensor are some metres apart; farther apart nobody knows what lies between.
constexpr double kMostBetweenM = 10.0;

/// Longer than anything that walks or drives stays in a voxel of a decimetre.
constexpr std::int64_t kStandsNs = 1'000'000'000;
constexpr double kGrownM = 0.3;
constexpr double kFarM = 0.2;
constexpr double kFarVoxels = 2.0;

/// Cells of a plane, each by its two numbers.
class Cells {
 public:
  static std::int64_t number(double metres) {
    return static_cast<std::int64_t>(std::floor(metres / kCellM));
  }
  static std::uint64_t key(std::int64_t x, std::int64_t y) { return maps::plane_cell_key(x, y); }
  void insert(const Eigen::Vector3d& p) { insert(key(number(p.x()), number(p.y()))); }
  /// Those whose middle is within the radius.
  void insert_disc(const Eigen::Vector3d& p, double radius_m) {
    const auto reach = static_cast<std::int64_t>(std::ceil(radius_m / kCellM));
    const std::int64_t cx = number(p.x()), cy = number(p.y());
    for (std::int64_t x = cx - reach; x <= cx + reach; ++x) {
      for (std::int64_t y = cy - reach; y <= cy + reach; ++y) {
        const double dx = (static_cast<double>(x) + 0.5) * kCellM - p.x();
        const double dy = (static_cast<double>(y) + 0.5) * kCellM - p.y();
        if (dx * dx + dy * dy <= radius_m * radius_m) insert(key(x, y));
      }
    }
  }
  [[nodiscard]] bool hold(std::uint64_t key) const { return table_.contains(key); }
  [[nodiscard]] const std::vector<std::uint64_t>& keys() const { return keys_; }

 private:
  void insert(std::uint64_t key) {
    if (table_.insert(key).second) keys_.push_back(key);
  }

  maps::CellTable table_;
  std::vector<std::uint64_t> keys_;
};

bool is_ground(maps::PointKind kind) { return kind != maps::PointKind::kMeasured; }

/// Of level 0. @param choice  may be empty.
std::vector<maps::TileId> chosen(const maps::MapPackage& map, const TileChoice& choice) {
  std::vector<maps::TileId> ids;
  for (const maps::TileEntry& entry : map.tiles())
    if (entry.id.level == 0 && (!choice || choice(entry.id))) ids.push_back(entry.id);
  return ids;
}

template <typename Visit>
void for_each_point(const maps::MapPackage& map, const TileChoice& tiles, const CancelFlag& cancel,
                    const Visit& visit) {
  for (const maps::TileId id : chosen(map, tiles)) {
    if (cancel) throw Cancelled();
    const maps::MapTile tile = map.tile(id);
    for (const maps::MapPoint& point : tile) visit(tile.position(point), point.kind);
  }
}

/// @param T  takes the package's points to the frame of the cells.
Cells ground_of(const maps::MapPackage& map, const Eigen::Isometry3d& T, const TileChoice& tiles,
                const CancelFlag& cancel) {
  Cells cells;
  for_each_point(map, tiles, cancel, [&](const Eigen::Vector3d& p, maps::PointKind kind) {
    if (is_ground(kind)) cells.insert(T * p);
  });
  return cells;
}

/// The way along the poses, a point each cell; of a map that no drive made, its places.
Cells along(const maps::MapPackage& map, const Eigen::Isometry3d& T, double radius_m) {
  Cells cells;
  const std::vector<maps::Trajectory> paths = map.trajectories();
  if (paths.empty()) {
    for (const Eigen::Isometry3d& place : map.places())
      cells.insert_disc(T * place.translation(), radius_m);
  }
  for (const maps::Trajectory& path : paths) {
    for (std::size_t i = 0; i < path.size(); ++i) {
      const Eigen::Vector3d to = T * path.poses()[i].T_map_lidar.translation();
      cells.insert_disc(to, radius_m);
      if (i == 0) continue;
      const Eigen::Vector3d from = T * path.poses()[i - 1].T_map_lidar.translation();
      const double way_m = (to - from).norm();
      if (!(way_m <= kMostBetweenM)) continue;
      for (double s = kCellM; s < way_m; s += kCellM)
        cells.insert_disc(from + s / way_m * (to - from), radius_m);
    }
  }
  return cells;
}

/// Boxes of removed objects in the frame of the new map's points, by tile.
class RemovedBoxes {
 public:
  explicit RemovedBoxes(const maps::MapPackage& map) {
    for (const maps::MapObject& object : map.objects()) {
      for (const maps::MapObject::Placement& place : object.placements)
        add({.centre = place.centre_map, .size_m = object.size_m, .yaw_rad = place.yaw_rad});
    }
  }
  [[nodiscard]] bool hold(const Eigen::Vector3d& p_map) const {
    const Tile tile = tile_of(p_map);
    const std::vector<maps::Box>* boxes =
        by_tile_.find(maps::plane_cell_key(tile.first, tile.second));
    return boxes != nullptr && std::any_of(boxes->begin(), boxes->end(), [&](const maps::Box& box) {
             return box.contains(p_map, kGrownM);
           });
  }

 private:
  using Tile = std::pair<std::int64_t, std::int64_t>;
  static Tile tile_of(const Eigen::Vector3d& p) {
    return {static_cast<std::int64_t>(std::floor(p.x() / maps::kTileSizeM)),
            static_cast<std::int64_t>(std::floor(p.y() / maps::kTileSizeM))};
  }
  void add(const maps::Box& box) {
    const Eigen::Vector3d reach =
        Eigen::Vector3d::Constant(0.5 * box.size_m.head<2>().norm() + kGrownM);
    const Tile low = tile_of(box.centre - reach), high = tile_of(box.centre + reach);
    for (std::int64_t x = low.first; x <= high.first; ++x) {
      for (std::int64_t y = low.second; y <= high.second; ++y)
        by_tile_[maps::plane_cell_key(x, y)].push_back(box);
    }
  }
  maps::CellMap<std::vector<maps::Box>> by_tile_;
};

/// When a scan was taken. Stamps of two drives may be of two clocks.
struct ScanTime {
  std::size_t drive = 0;
  std::int64_t stamp_ns = 0;
};

std::vector<ScanTime> scan_times(const maps::MapPackage& map) {
  std::vector<ScanTime> times;
  const std::vector<maps::Trajectory> paths = map.trajectories();
  for (std::size_t drive = 0; drive < paths.size(); ++drive) {
    for (const maps::StampedPose& pose : paths[drive].poses())
      times.push_back({drive, pose.stamp_ns});
  }
  return times;
}

/// The measured points, from the map's origin.
PointCells measured_of(const maps::MapPackage& map, double far_m, const TileChoice& tiles,
                       const CancelFlag& cancel) {
  std::vector<Eigen::Vector3f> points;
  for_each_point(map, tiles, cancel, [&](const Eigen::Vector3d& p, maps::PointKind kind) {
    if (maps::is_measured(kind)) points.emplace_back((p - map.manifest().origin).cast<float>());
  });
  return {std::move(points), far_m};
}

/// Whether it was seen for long enough; between two drives lies longer than that.
bool stood(const maps::PointHistory& history, const std::vector<ScanTime>& times) {
  if (history.last_scan >= times.size() || history.first_scan > history.last_scan) return false;
  const ScanTime& first = times[history.first_scan];
  const ScanTime& last = times[history.last_scan];
  return first.drive != last.drive || last.stamp_ns - first.stamp_ns >= kStandsNs;
}

/// Tiles of a previous version by the tiles of the new one that they reach into.
std::map<maps::TileId, std::vector<maps::TileId>> tiles_under(
    const maps::MapPackage& previous, const maps::MapPackage& map,
    const Eigen::Isometry3d& T_map_previous) {
  std::map<maps::TileId, std::vector<maps::TileId>> under;
  const auto number = [](double metres) {
    return static_cast<std::int32_t>(std::floor(metres / maps::kTileSizeM));
  };
  for (const maps::TileEntry& tile : previous.tiles()) {
    if (tile.id.level != 0) continue;
    const Eigen::AlignedBox3d bounds = previous.manifest().bounds_of(tile);
    Eigen::AlignedBox3d box;
    for (int corner = 0; corner < 8; ++corner) {
      const auto which = static_cast<Eigen::AlignedBox3d::CornerType>(corner);
      box.extend(T_map_previous * bounds.corner(which) - map.manifest().origin);
    }
    for (std::int32_t x = number(box.min().x()); x <= number(box.max().x()); ++x) {
      for (std::int32_t y = number(box.min().y()); y <= number(box.max().y()); ++y)
        under[{0, x, y}].push_back(tile.id);
    }
  }
  return under;
}

/// Of what a previous version has in a tile of the new one.
std::vector<SurfacePoint> previous_points(const maps::MapPackage& previous,
                                          const std::vector<maps::TileId>& tiles,
                                          const Eigen::Isometry3d& T_map_previous,
                                          const Eigen::Vector3d& map_origin, maps::TileId into) {
  const Eigen::Vector3d corner = maps::corner_of(into);
  std::vector<maps::MapPoint> moved;
  for (const maps::TileId id : tiles) {
    const maps::MapTile tile = previous.tile(id);
    for (const maps::MapPoint& point : tile) {
      const Eigen::Vector3d p = T_map_previous * tile.position(point) - map_origin;
      if (std::floor(p.x() / maps::kTileSizeM) == into.x &&
          std::floor(p.y() / maps::kTileSizeM) == into.y)
        moved.push_back(maps::moved_to(point, p - corner));
    }
  }
  return surface_points(into, {map_origin, corner, std::move(moved)});
}

/// What two versions have in common.
struct ConsistencyPair {
  ConsistencySum previous, map;
};

/// @param previous, map  cells of one tile, by key.
ConsistencyPair paired(const std::vector<SurfaceCell>& previous,
                       const std::vector<SurfaceCell>& map) {
  std::vector<SurfaceCell> before, now;
  for (auto a = previous.begin(), b = map.begin(); a != previous.end() && b != map.end();) {
    if (a->key != b->key) {
      a->key < b->key ? ++a : ++b;
      continue;
    }
    const bool either_is_planar = a->is_planar || b->is_planar;
    const bool both_have_entropy = a->entropy_points > 0 && b->entropy_points > 0;
    const auto as_one_of_a_pair = [&](SurfaceCell cell, const SurfaceCell& other) {
      cell.is_planar = either_is_planar;
      if (!other.has_thickness()) cell.thickness_m = other.thickness_m;
      cell.entropy_sum = both_have_entropy ? cell.entropy_sum / cell.entropy_points : 0.0;
      cell.entropy_points = both_have_entropy ? 1 : 0;
      return cell;
    };
    before.push_back(as_one_of_a_pair(*a, *b));
    now.push_back(as_one_of_a_pair(*b, *a));
    ++a;
    ++b;
  }
  ConsistencyPair pair;
  pair.previous.add(before);
  pair.map.add(now);
  return pair;
}

}  // namespace

double StaticLoss::rate() const { return share_of(lost, points); }

GroundCoverage ground_coverage(const maps::MapPackage& previous, const maps::MapPackage& map,
                               const Eigen::Isometry3d& T_map_previous, const CancelFlag& cancel,
                               const TileChoice& tiles) {
  const Cells found = ground_of(map, Eigen::Isometry3d::Identity(), tiles, cancel);
  const Cells before = ground_of(previous, T_map_previous, tiles, cancel);
  const Cells driven = along(previous, T_map_previous, kDrivenM);
  const Cells near_path = along(previous, T_map_previous, kNearPathM);
  GroundCoverage coverage;
  std::uint64_t driven_found = 0, near_found = 0;
  for (const std::uint64_t cell : before.keys()) {
    if (!near_path.hold(cell)) continue;
    const bool has = found.hold(cell);
    ++coverage.near_path_cells;
    near_found += has ? 1 : 0;
    if (!driven.hold(cell)) continue;
    ++coverage.driven_cells;
    driven_found += has ? 1 : 0;
  }
  coverage.driven = share_of(driven_found, coverage.driven_cells);
  coverage.near_path = share_of(near_found, coverage.near_path_cells);
  return coverage;
}

StaticLoss static_loss(const maps::MapPackage& keep, const maps::MapPackage& map,
                       const Eigen::Isometry3d& T_map_keep, const ProgressCallback& progress,
                       const CancelFlag& cancel, const TileChoice& tiles) {
  const double far_m = std::max(kFarM, kFarVoxels * map.manifest().voxel_size_m);
  const PointCells measured = measured_of(map, far_m, tiles, cancel);
  const RemovedBoxes removed(map);
  const std::vector<ScanTime> times = scan_times(keep);
  StaticLoss loss;
  std::size_t done = 0;
  const std::vector<maps::TileId> ids = chosen(keep, tiles);
  for (const maps::TileId id : ids) {
    if (cancel) throw Cancelled();
    const maps::MapTile tile = keep.tile(id);
    const std::vector<maps::PointHistory> history = keep.history(id);
    if (history.size() != tile.size())
      throw maps::InputError(keep.folder().string(), "a tile without histories",
                             "a map that says when its points were seen");
    for (std::size_t i = 0; i < tile.size(); ++i) {
      if (!maps::is_measured(tile[i].kind) || !stood(history[i], times)) continue;
      const Eigen::Vector3d p_map = T_map_keep * tile.position(tile[i]);
      if (removed.hold(p_map)) continue;
      ++loss.points;
      const Eigen::Vector3f p_local = (p_map - map.manifest().origin).cast<float>();
      if (!measured.any_within(p_local, far_m)) ++loss.lost;
    }
    if (progress) progress("compare", ++done, ids.size());
  }
  return loss;
}

ConsistencyChange consistency_change(const maps::MapPackage& previous, const maps::MapPackage& map,
                                     const Eigen::Isometry3d& T_map_previous, int threads,
                                     const ProgressCallback& progress, const CancelFlag& cancel,
                                     const TileChoice& tiles) {
  const double voxel_size_m = map.manifest().voxel_size_m;
  if (previous.manifest().voxel_size_m != voxel_size_m) return {};
  const auto under = tiles_under(previous, map, T_map_previous);
  std::vector<maps::TileId> common;
  for (const maps::TileId id : chosen(map, tiles))
    if (under.contains(id)) common.push_back(id);
  ConsistencyPair sum;
  std::size_t done = 0;
  process_in_order(
      common.size(), threads,
      [&](std::size_t i) {
        const maps::TileId id = common[i];
        const auto cells = [&](const std::vector<SurfacePoint>& points) {
          return surface_cells(points, voxel_size_m);
        };
        return paired(cells(previous_points(previous, under.at(id), T_map_previous,
                                            map.manifest().origin, id)),
                      cells(surface_points(id, map.tile(id))));
      },
      [&](const ConsistencyPair& pair) {
        sum.previous.add(pair.previous);
        sum.map.add(pair.map);
        if (progress) progress("compare", ++done, common.size());
      },
      cancel);
  return {sum.previous.result(), sum.map.result()};
}

}  // namespace stillmap::mapping
