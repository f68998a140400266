#include <stillmap/maps/map_difference.hpp>

#include <Eigen/Core>
#include <nanoflann.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <set>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>

#include "levels/shifted_points.hpp"
#include "levels/tile_file.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;
using Place = std::pair<std::int32_t, std::int32_t>;

fs::path file_of(const MapPackage& version, const MapPackage& other, double tolerance_m) {
  return version.folder() / "differences" /
         (other.digest().substr(0, 16) + "-" +
          std::to_string(MapDifference::tolerance_mm(tolerance_m)) + ".tiles");
}

std::string key_of(const MapPackage& version, const MapPackage& other, double tolerance_m) {
  return "difference 2 of " + version.digest() + " and " + other.digest() + " within " +
         std::to_string(MapDifference::tolerance_mm(tolerance_m)) + " mm";
}

/// Answers whether a point has another one near it.
class Nearness {
 public:
  explicit Nearness(const std::vector<MapPoint>& points) {
    for (const MapPoint& p : points) view_.points.emplace_back(p.x, p.y, p.z);
    if (!view_.points.empty()) tree_ = std::make_unique<Tree>(3, view_, Parameters(kLeafPoints));
  }

  [[nodiscard]] bool is_near(const MapPoint& p, double distance_m) const {
    if (!tree_) return false;
    FirstWithin found{static_cast<float>(distance_m * distance_m)};
    const Eigen::Vector3f at(p.x, p.y, p.z);
    tree_->findNeighbors(found, at.data(), nanoflann::SearchParams());
    return found.is_found;
  }

 private:
  static constexpr std::size_t kLeafPoints = 16;
  using Parameters = nanoflann::KDTreeSingleIndexAdaptorParams;

  /// Ends the search at the first point within the distance.
  struct FirstWithin {
    using DistanceType = float;
    float distance2;
    bool is_found = false;
    [[nodiscard]] std::size_t size() const { return is_found ? 1 : 0; }
    [[nodiscard]] bool full() const { return true; }
    // NOLINTBEGIN(readability-identifier-naming): nanoflann's names
    [[nodiscard]] float worstDist() const { return distance2; }
    bool addPoint(float found2, std::uint32_t /*index*/) {
      is_found = is_found || found2 <= distance2;
      return !is_found;
    }
    // NOLINTEND(readability-identifier-naming)
  };
  /// What nanoflann reads.
  struct View {
    std::vector<Eigen::Vector3f> points;
    [[nodiscard]] std::size_t kdtree_get_point_count() const { return points.size(); }
    [[nodiscard]] float kdtree_get_pt(std::size_t index, std::size_t axis) const {
      return points[index][static_cast<Eigen::Index>(axis)];
    }
    template <typename Box>
    bool kdtree_get_bbox(Box& /*box*/) const {
      return false;
    }
  };
  using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, View>, View,
                                                   3, std::uint32_t>;

  View view_;
  std::unique_ptr<Tree> tree_;
};

/// Of a tile the points of `mine` that have none of `theirs` near.
std::vector<MapPoint> only_in(const ShiftedPoints& mine, const ShiftedPoints& theirs, Place place,
                              double tolerance_m) {
  const auto [x, y] = place;
  std::vector<MapPoint> points = mine.in_tile(x, y);
  if (points.empty()) return points;
  const std::vector<MapPoint> same_tile = theirs.in_tile(x, y);
  // Most tiles of a rebuild are as they were.
  if (same_tile.size() == points.size() &&
      std::memcmp(same_tile.data(), points.data(), points.size() * sizeof(MapPoint)) == 0)
    return {};
  const Nearness near(theirs.in_tile(x, y, tolerance_m));
  std::erase_if(points, [&](const MapPoint& p) { return near.is_near(p, tolerance_m); });
  return points;
}

std::uint64_t point_bytes(const MapPackage& map) {
  return map.manifest().extent.points * sizeof(MapPoint);
}

/// Files beyond those that are kept, the oldest first; the newest stays.
void remove_oldest(const fs::path& folder, std::uint64_t most_bytes) {
  std::error_code error;
  std::vector<std::pair<fs::file_time_type, fs::path>> files;
  for (fs::directory_iterator at(folder, error); !error && at != fs::directory_iterator();
       at.increment(error)) {
    if (at->path().extension() == ".tiles")
      files.emplace_back(fs::last_write_time(at->path(), error), at->path());
  }
  std::sort(files.rbegin(), files.rend());
  constexpr std::uint64_t kAlways = std::uint64_t{1} << 20U;  // headers and tables of small ones
  most_bytes = std::max(most_bytes, kAlways);
  std::uint64_t bytes = 0;
  for (std::size_t i = 0; i < files.size(); ++i) {
    const std::uintmax_t size = fs::file_size(files[i].second, error);
    bytes += error ? 0 : size;
    if (i >= MapDifference::kKept || (i > 0 && bytes > most_bytes))
      fs::remove(files[i].second, error);
  }
}

DifferenceTile tile_of(const TileRow& row) {
  DifferenceTile tile;
  tile.side = static_cast<DifferenceSide>(row.group);
  tile.entry = row.entry({.level = 0, .x = row.x, .y = row.y});
  tile.counts = {
      .points = row.points, .kinds = row.kinds, .area_m2 = row.squares, .seen_free = row.seen_free};
  return tile;
}

TileId row_id(DifferenceSide side, std::int32_t x, std::int32_t y) {
  return {.level = static_cast<std::uint32_t>(side), .x = x, .y = y};
}

}  // namespace

MapDifference::MapDifference() = default;
MapDifference::~MapDifference() = default;

double MapDifference::usual_tolerance_m(const MapPackage& version, const MapPackage& other) {
  const double voxel_m = std::max(version.manifest().voxel_size_m, other.manifest().voxel_size_m);
  return std::clamp(1.5 * (voxel_m > 0.0 ? voxel_m : 0.1), kSmallestToleranceM, kLargestToleranceM);
}

std::uint32_t MapDifference::tolerance_mm(double tolerance_m) {
  if (!(tolerance_m >= kSmallestToleranceM && tolerance_m <= kLargestToleranceM)) {
    throw std::invalid_argument("tolerance_m: " + std::to_string(tolerance_m) + ", in [" +
                                std::to_string(kSmallestToleranceM) + ", " +
                                std::to_string(kLargestToleranceM) + "]");
  }
  return static_cast<std::uint32_t>(std::lround(1000.0 * tolerance_m));
}

fs::path MapDifference::make(const MapPackage& version, const MapPackage& other, double tolerance_m,
                             const DerivedWork& work) {
  const double rounded_m = tolerance_mm(tolerance_m) / 1000.0;
  fs::path file = file_of(version, other, tolerance_m);
  TileFileWriter writer(file, key_of(version, other, tolerance_m));
  const ShiftedPoints first(version, version.manifest().origin);
  const ShiftedPoints second(other, version.manifest().origin);
  std::vector<std::pair<DifferenceSide, Place>> all;
  for (const Place& place : first.tiles()) all.emplace_back(DifferenceSide::kVersion, place);
  for (const Place& place : second.tiles()) all.emplace_back(DifferenceSide::kOther, place);
  double done = 0.0;
  for (const auto& [side, place] : all) {
    const bool is_first = side == DifferenceSide::kVersion;
    const ShiftedPoints& theirs = is_first ? second : first;
    const std::vector<MapPoint> points =
        only_in(is_first ? first : second, theirs, place, rounded_m);
    if (!points.empty())
      writer.add(row_id(side, place.first, place.second), points,
                 theirs.count_seen_free(points, place.first, place.second));
    done += 1.0;
    if (work.go_on && !work.go_on(done / static_cast<double>(all.size()))) throw WorkStopped();
  }
  writer.publish();
  remove_oldest(file.parent_path(), point_bytes(version) + point_bytes(other));
  return file;
}

std::shared_ptr<const MapDifference> MapDifference::open(const MapPackage& version,
                                                         const MapPackage& other,
                                                         double tolerance_m) {
  std::shared_ptr<MapDifference> difference(new MapDifference);
  difference->file_ = std::make_unique<const TileFile>(file_of(version, other, tolerance_m),
                                                       key_of(version, other, tolerance_m));
  for (const TileRow& row : difference->file_->rows()) difference->tiles_.push_back(tile_of(row));
  return difference;
}

void MapDifference::remove(const MapPackage& version, const MapPackage& other, double tolerance_m) {
  std::error_code ignored;
  fs::remove(file_of(version, other, tolerance_m), ignored);
}

const DifferenceTile* MapDifference::find(DifferenceSide side, std::int32_t x,
                                          std::int32_t y) const {
  const auto key = [](const DifferenceTile& tile) {
    return row_id(tile.side, tile.entry.id.x, tile.entry.id.y);
  };
  const TileId wanted = row_id(side, x, y);
  const auto found =
      std::lower_bound(tiles_.begin(), tiles_.end(), wanted,
                       [&](const DifferenceTile& tile, TileId id) { return key(tile) < id; });
  return found != tiles_.end() && key(*found) == wanted ? &*found : nullptr;
}

DifferenceCounts MapDifference::total(DifferenceSide side) const {
  DifferenceCounts sum;
  for (const DifferenceTile& tile : tiles_) {
    if (tile.side != side) continue;
    sum.points += tile.counts.points;
    for (std::size_t kind = 0; kind < sum.kinds.size(); ++kind)
      sum.kinds[kind] += tile.counts.kinds[kind];
    sum.area_m2 += tile.counts.area_m2;
    sum.seen_free += tile.counts.seen_free;
  }
  return sum;
}

std::vector<MapPoint> MapDifference::points(const DifferenceTile& tile) const {
  const TileRow* row = file_->find(row_id(tile.side, tile.entry.id.x, tile.entry.id.y));
  if (row == nullptr) throw std::invalid_argument("a tile of another difference");
  return file_->read(*row);
}

}  // namespace stillmap::maps
