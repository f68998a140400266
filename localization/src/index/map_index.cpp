#include <stillmap/localization/map_index.hpp>

#include "index/index_file.hpp"
#include "index/index_window.hpp"
#include "index/own_error.hpp"
#include "index/place_rows.hpp"
#include "index/voxel_build.hpp"
#include "index_grid.hpp"
#include "map_level.hpp"

#include <stillmap/localization/aligner.hpp>
#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <list>
#include <map>
#include <mutex>
#include <numeric>
#include <optional>
#include <stdexcept>
#include <utility>

namespace stillmap::localization {
namespace {

/// Windows that are kept for the next query: one is made in some ten microseconds.
constexpr std::size_t kMostWindows = 32;

void require_usable(const MapIndexOptions& options) {
  const std::vector<std::string> broken = options.violations();
  if (!broken.empty()) throw std::invalid_argument(fmt::format("{}", fmt::join(broken, "; ")));
}

/// What is wrong with the coarsest edge; nothing when regions are whole numbers of blocks.
std::optional<std::string> uneven_edge(const MapIndexOptions& options) {
  const double coarsest_m = edge_of_level(options, 0);
  const double blocks = std::max(1.0, std::round(RegionBuilder::kBlockM / coarsest_m));
  if (std::abs(RegionBuilder::kBlockM / coarsest_m - blocks) < 1e-9 * blocks) return std::nullopt;
  return fmt::format(
      "finest_voxel_m: {} with {} levels makes voxels of {} m, which do not divide {} m: take {}",
      options.finest_voxel_m, options.levels, coarsest_m, RegionBuilder::kBlockM,
      std::ldexp(RegionBuilder::kBlockM / blocks, 1 - options.levels));
}

void add_region(RootContent& root, maps::RegionId id, const IndexKey& key, const RegionView& view) {
  RegionRow row{.id = id, .voxels = 0, .finest_voxels = view.levels.back().voxels.size()};
  for (const CellBlocks::Part& level : view.levels) row.voxels += level.voxels.size();
  std::copy_n(key.source.begin(), std::min(key.source.size(), row.source.size()),
              row.source.begin());
  root.regions.push_back(row);
}

void require_voxels(const RootContent& root, const MapIndexOptions& options,
                    const std::string& source) {
  const bool any = std::any_of(root.regions.begin(), root.regions.end(),
                               [](const RegionRow& row) { return row.finest_voxels > 0; });
  if (any) return;
  throw maps::InputError(source, "none",
                         fmt::format("a voxel of {} m with {} measured points or more",
                                     options.finest_voxel_m, options.min_points));
}

/// Relative to the index's origin.
Eigen::AlignedBox3d bounds_of(const maps::MapPackage& map, const MapIndexOptions& options) {
  return map.manifest().extent.from_origin.translated(
      Eigen::Vector3d(0.0, 0.0, below_origin_m(options)));
}

Eigen::Vector3d origin_of(const maps::MapPackage& map, const MapIndexOptions& options) {
  return map.manifest().origin - Eigen::Vector3d(0.0, 0.0, below_origin_m(options));
}

/// Their lowest corner, so that a small cloud lies in one region.
Eigen::Vector3d origin_of(const std::vector<Eigen::Vector3d>& points_map) {
  if (points_map.empty()) return Eigen::Vector3d::Zero();
  Eigen::Vector3d min = points_map.front();
  for (const Eigen::Vector3d& p : points_map) {
    if (!p.allFinite()) throw std::invalid_argument("map points: a point is not finite");
    min = min.cwiseMin(p);
  }
  return min;
}

}  // namespace

std::vector<std::string> MapIndexOptions::violations() const {
  std::vector<std::string> broken;
  const bool edge_fits = finest_voxel_m >= 0.1 && finest_voxel_m <= 4.0;
  if (!edge_fits) {
    broken.push_back(fmt::format("finest_voxel_m: {}, in [0.1, 4]", finest_voxel_m));
  }
  const bool levels_fit = levels >= 1 && levels <= 6;
  if (!levels_fit) broken.push_back(fmt::format("levels: {}, in [1, 6]", levels));
  if (edge_fits && levels_fit) {
    if (const auto uneven = uneven_edge(*this)) broken.push_back(*uneven);
  }
  if (min_points < 3) broken.push_back(fmt::format("min_points: {}, >= 3", min_points));
  return broken;
}

/// The root, the regions that are open, and the windows made of them.
class MapIndex::Regions {
 public:
  using Region = std::shared_ptr<const OpenRegion>;

  /// @param package  empty: no files.
  Regions(const MapIndexOptions& options, std::filesystem::path package)
      : options_(options), package_(std::move(package)) {}

  /// @throws as `IndexStorage` and `root_view`.
  void set_root(IndexStorage bytes, const IndexKey& key) { root_.emplace(std::move(bytes), key); }
  [[nodiscard]] const OpenRoot& root() const { return *root_; }
  [[nodiscard]] bool has_files() const { return !package_.empty(); }

  /// Keeps a region that lies in no file.
  Region keep(maps::RegionId id, std::vector<CacheLine> lines, const IndexKey& key) {
    auto region = std::make_shared<const OpenRegion>(IndexStorage(std::move(lines)), key);
    kept_[id] = region;
    return region;
  }
  /// @throws maps::InputError, maps::StorageError.
  [[nodiscard]] Region map_file(maps::RegionId id, const IndexKey& key) const {
    return std::make_shared<const OpenRegion>(IndexStorage(region_file_of(package_, options_, id)),
                                              key);
  }
  /// Builds a region and puts it into its file, or else into memory.
  /// @return null when it has no voxel. @param kept_because  why not into the file.
  Region build(const MapRegions& map, maps::RegionId id, const IndexKey& key,
               std::string& kept_because) {
    const RegionContent content = content_of(map, id);
    if (content.voxels.empty()) return nullptr;
    const maps::SectionFile sections = sections_of(key, content);
    if (!has_files()) return keep(id, sections.lines(), key);
    try {
      publish_file(region_file_of(package_, options_, id), sections);
      // From here on the system may drop pages that nobody uses.
      return map_file(id, key);
    } catch (const maps::InputError& error) {
      kept_because = error.what();
    } catch (const maps::StorageError& error) {
      kept_because = error.what();
    }
    return keep(id, sections.lines(), key);
  }

  /// Null when the index has no such region.
  [[nodiscard]] Region region(maps::RegionId id) {
    const std::scoped_lock lock(mutex_);
    return locked_region(id);
  }

  [[nodiscard]] std::shared_ptr<const IndexWindow> window(const Eigen::Vector3d& origin,
                                                          maps::RegionId middle) {
    const std::scoped_lock lock(mutex_);
    const auto known = std::find_if(windows_.begin(), windows_.end(),
                                    [&](const auto& window) { return window.first == middle; });
    if (known != windows_.end()) {
      windows_.splice(windows_.begin(), windows_, known);
      return known->second;
    }
    IndexWindow::Regions nine;
    for (std::int32_t x = middle.x - 1; x <= middle.x + 1; ++x) {
      for (std::int32_t y = middle.y - 1; y <= middle.y + 1; ++y)
        if (Region region = locked_region({x, y})) nine.emplace_back(maps::RegionId{x, y}, region);
    }
    auto window = std::make_shared<const IndexWindow>(origin, middle, std::move(nine), options_);
    windows_.emplace_front(middle, window);
    if (windows_.size() > kMostWindows) windows_.pop_back();
    return window;
  }

 private:
  /// Its voxels lie beside the files, or else in memory.
  [[nodiscard]] RegionContent content_of(const MapRegions& map, maps::RegionId id) const {
    if (!has_files()) return map.build(id, {});
    const std::filesystem::path folder = region_file_of(package_, options_, id).parent_path();
    std::error_code ignored;
    std::filesystem::create_directory(folder, ignored);
    try {
      return map.build(id, folder);
    } catch (const maps::StorageError&) {
      // The disk is full, or does not map files for writing.
      return map.build(id, {});
    }
  }
  [[nodiscard]] Region locked_region(maps::RegionId id) {
    const std::span<const RegionRow> rows = root_->view.regions;
    const auto row = std::partition_point(rows.begin(), rows.end(),
                                          [&](const RegionRow& r) { return r.id < id; });
    if (row == rows.end() || row->id != id) return nullptr;
    if (const auto kept = kept_.find(id); kept != kept_.end()) return kept->second;
    std::weak_ptr<const OpenRegion>& open = open_[id];
    if (Region region = open.lock()) return region;
    const IndexKey key{std::string(row->source.begin(), row->source.end()), options_};
    Region region;
    try {
      region = map_file(id, key);
    } catch (const maps::InputError&) {
      region = built_again(id, key);
    } catch (const maps::StorageError&) {
      region = built_again(id, key);
    }
    open = region;
    return region;
  }
  /// Somebody removed or damaged the file.
  [[nodiscard]] Region built_again(maps::RegionId id, const IndexKey& key) {
    const auto map = maps::MapPackage::open(package_);
    const MapRegions regions(*map, options_);
    if (regions.source_of(id) != key.source) {
      throw maps::InputError(package_.string(), "another map than the one that was opened",
                             "the same one: open it again");
    }
    std::string kept_because;
    return build(regions, id, key, kept_because);
  }

  MapIndexOptions options_;
  std::filesystem::path package_;
  std::optional<OpenRoot> root_;
  std::mutex mutex_;
  std::map<maps::RegionId, Region> kept_;
  std::map<maps::RegionId, std::weak_ptr<const OpenRegion>> open_;
  /// The one that was asked for last comes first.
  std::list<std::pair<maps::RegionId, std::shared_ptr<const IndexWindow>>> windows_;
};

MapIndex::MapIndex(const Eigen::Vector3d& origin, const MapIndexOptions& options)
    : origin_(origin), options_(options) {}

MapIndex::~MapIndex() = default;

Eigen::AlignedBox3d MapIndex::bounds() const { return root().bounds.translated(origin_); }

std::size_t MapIndex::voxel_count() const {
  const auto rows = root().regions;
  return std::accumulate(rows.begin(), rows.end(), std::size_t{0},
                         [](std::size_t sum, const RegionRow& row) { return sum + row.voxels; });
}

const RootView& MapIndex::root() const { return regions_->root().view; }

std::shared_ptr<const IndexWindow> MapIndex::around(const Eigen::Vector3d& p_map) const {
  const Eigen::Vector3d p = p_map - origin_;
  // NaN is far from everything, too.
  if (!(p.cwiseAbs().maxCoeff() < kFarthestRegionM)) {
    return std::make_shared<const IndexWindow>(origin_, maps::RegionId{}, IndexWindow::Regions{},
                                               options_);
  }
  return around(region_at(p.x(), p.y()));
}

std::shared_ptr<const IndexWindow> MapIndex::around(maps::RegionId region) const {
  return regions_->window(origin_, region);
}

void MapIndex::verify() const {
  const IndexStorage& root_bytes = regions_->root().storage;
  verify_root(root_bytes.bytes(), root_bytes.name());
  for (const RegionRow& row : root().regions) {
    const auto region = regions_->region(row.id);
    verify_region(region->storage.bytes(), region->storage.name());
  }
}

std::shared_ptr<const MapIndex> MapIndex::open(const maps::MapPackage& map,
                                               const MapIndexOptions& options) {
  require_usable(options);
  std::shared_ptr<MapIndex> index(new MapIndex(origin_of(map, options), options));
  index->regions_ = std::make_unique<Regions>(options, map.folder());
  const std::filesystem::path file = root_file_of(map.folder(), options);
  try {
    index->regions_->set_root(IndexStorage(file), {map.digest(), options});
    index->file_ = file;
    return index;
  } catch (const maps::InputError& error) {
    index->rebuilt_because_ = error.what();
  } catch (const maps::StorageError& error) {
    index->rebuilt_because_ = error.what();
  }
  index->build_from(map);
  return index;
}

void MapIndex::begin_with(const maps::MapPackage& map, const maps::MapPackage& other,
                          const MapIndexOptions& options) {
  for (const maps::RegionId id : map.regions()) {
    const std::filesystem::path from = region_file_of(other.folder(), options, id);
    const std::filesystem::path to = region_file_of(map.folder(), options, id);
    std::error_code error;
    std::filesystem::create_directories(to.parent_path(), error);
    std::filesystem::create_hard_link(from, to, error);
    if (error) std::filesystem::copy_file(from, to, error);
  }
}

std::shared_ptr<const MapIndex> MapIndex::build(const maps::MapPackage& map,
                                                const MapIndexOptions& options) {
  require_usable(options);
  std::shared_ptr<MapIndex> index(new MapIndex(origin_of(map, options), options));
  index->regions_ = std::make_unique<Regions>(options, std::filesystem::path());
  index->build_from(map);
  return index;
}

void MapIndex::build_from(const maps::MapPackage& map) {
  const MapRegions tiles(map, options_);
  RootContent root;
  root.bounds = bounds_of(map, options_);
  for (const maps::RegionId id : tiles.regions()) {
    const IndexKey key{tiles.source_of(id), options_};
    Regions::Region region;
    try {
      // A region whose tiles are as they were keeps its file.
      if (regions_->has_files()) region = regions_->map_file(id, key);
    } catch (const maps::InputError&) {
    } catch (const maps::StorageError&) {
    }
    if (!region) region = regions_->build(tiles, id, key, kept_in_memory_because_);
    if (region) add_region(root, id, key, region->view);
  }
  require_voxels(root, options_, map.folder().string());
  const Places places = places_of(seen_from(map), origin_, root.bounds.translated(origin_));
  root.places = places.rows;
  root.R_level_lidar = places.R_level_lidar;
  root.own_errors = own_errors_of(map);
  // Views are of windows, and windows look regions up in the root: one without places comes first.
  RootContent without_places = root;
  without_places.places.clear();
  const IndexKey key{map.digest(), options_};
  regions_->set_root(IndexStorage(sections_of(key, without_places).lines()), key);
  root.views = views_of(root.places, *this);
  set_root(root, key, map.folder());
}

std::shared_ptr<const MapIndex> MapIndex::build(const std::vector<Eigen::Vector3d>& points_map,
                                                const MapIndexOptions& options) {
  require_usable(options);
  std::shared_ptr<MapIndex> index(new MapIndex(origin_of(points_map), options));
  index->regions_ = std::make_unique<Regions>(options, std::filesystem::path());
  const IndexKey key{"", options};
  std::vector<Eigen::Vector3d> points;
  points.reserve(points_map.size());
  RootContent root;
  for (const Eigen::Vector3d& p_map : points_map) {
    points.push_back(p_map - index->origin_);
    root.bounds.extend(points.back());
  }
  for (const auto& [id, content] : build_regions(points, options)) {
    const auto region = index->regions_->keep(id, sections_of(key, content).lines(), key);
    add_region(root, id, key, region->view);
  }
  require_voxels(root, options, "map points");
  index->set_root(root, key, {});
  return index;
}

void MapIndex::set_root(const RootContent& root, const IndexKey& key,
                        const std::filesystem::path& package) {
  const maps::SectionFile sections = sections_of(key, root);
  if (regions_->has_files() && kept_in_memory_because_.empty()) {
    const std::filesystem::path file = root_file_of(package, options_);
    try {
      publish_file(file, sections);
      regions_->set_root(IndexStorage(file), key);
      file_ = file;
      return;
    } catch (const maps::InputError& error) {
      kept_in_memory_because_ = error.what();
    } catch (const maps::StorageError& error) {
      kept_in_memory_because_ = error.what();
    }
  }
  regions_->set_root(IndexStorage(sections.lines()), key);
}

}  // namespace stillmap::localization
