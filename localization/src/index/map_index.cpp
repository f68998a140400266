#include <stillmap/localization/map_index.hpp>

#include "index/index_bytes.hpp"
#include "index/index_file.hpp"
#include "index/own_error.hpp"
#include "index/voxel_build.hpp"
#include "map_level.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/mapped_file.hpp>
#include <stillmap/maps/tile_check.hpp>

#include <fmt/format.h>

#include <optional>
#include <stdexcept>
#include <utility>

namespace stillmap::localization {
namespace {

void require_usable(const MapIndexOptions& options) {
  const std::vector<std::string> broken = options.violations();
  if (!broken.empty()) throw std::invalid_argument(fmt::format("{}", fmt::join(broken, "; ")));
}

}  // namespace

std::vector<std::string> MapIndexOptions::violations() const {
  std::vector<std::string> broken;
  if (!(finest_voxel_m >= 0.1 && finest_voxel_m <= 4.0)) {
    broken.push_back(fmt::format("finest_voxel_m: {}, in [0.1, 4]", finest_voxel_m));
  }
  if (levels < 1 || levels > 6) broken.push_back(fmt::format("levels: {}, in [1, 6]", levels));
  if (min_points < 3) broken.push_back(fmt::format("min_points: {}, >= 3", min_points));
  return broken;
}

/// The bytes that an index looks into: a mapped file, or memory of its own.
struct MapIndex::Storage {
  explicit Storage(const std::filesystem::path& file) : mapped(std::in_place, file) {}
  explicit Storage(std::vector<CacheLine> lines) : owned(std::move(lines)) {}

  [[nodiscard]] std::span<const std::byte> bytes() const {
    return mapped ? mapped->bytes() : std::as_bytes(std::span(owned));
  }

  std::optional<maps::MappedFile> mapped;
  std::vector<CacheLine> owned;
};

MapIndex::MapIndex(std::unique_ptr<const Storage> storage, const IndexKey& key,
                   const std::string& name)
    : storage_(std::move(storage)), own_error_(std::make_unique<const OwnError>()) {
  IndexView view = view_of(storage_->bytes(), key, name);
  origin_ = view.origin;
  extent_ = view.extent;
  levels_ = std::move(view.levels);
  place_grids_ = std::move(view.place_grids);
}

MapIndex::~MapIndex() = default;

std::size_t MapIndex::voxel_count() const {
  std::size_t count = 0;
  for (const Level& level : levels_) count += level.voxels.size();
  return count;
}

void MapIndex::verify() const { verify_sections(storage_->bytes(), name()); }

std::string MapIndex::name() const { return file_.empty() ? "map index" : file_.string(); }

std::shared_ptr<MapIndex> MapIndex::map_file(const std::filesystem::path& file,
                                             const IndexKey& key) {
  std::shared_ptr<MapIndex> index(
      new MapIndex(std::make_unique<const Storage>(file), key, file.string()));
  index->file_ = file;
  return index;
}

std::shared_ptr<const MapIndex> MapIndex::open(const maps::MapPackage& map,
                                               const MapIndexOptions& options) {
  require_usable(options);
  std::shared_ptr<MapIndex> index = open_voxels(map, options);
  index->own_error_ = std::make_unique<const OwnError>(map);
  return index;
}

std::shared_ptr<MapIndex> MapIndex::open_voxels(const maps::MapPackage& map,
                                                const MapIndexOptions& options) {
  const IndexKey key{map.digest(), options};
  const std::filesystem::path file = index_file_of(map.folder(), options);
  std::string rebuilt_because;
  try {
    return map_file(file, key);
  } catch (const maps::InputError& error) {
    rebuilt_because = error.what();
  } catch (const maps::StorageError& error) {
    rebuilt_because = error.what();
  }
  // The file outlives this process, and nobody compares it with the points again.
  maps::require_whole_tiles(map);
  std::vector<CacheLine> lines = to_bytes(key, build_voxels(map, options));
  std::shared_ptr<MapIndex> index;
  std::string kept_in_memory_because;
  try {
    publish_file(file, std::as_bytes(std::span(lines)));
    // From here on the system may drop pages that nobody uses.
    index = map_file(file, key);
  } catch (const maps::InputError& error) {
    kept_in_memory_because = error.what();
  } catch (const maps::StorageError& error) {
    kept_in_memory_because = error.what();
  }
  if (!index) {
    index.reset(new MapIndex(std::make_unique<const Storage>(std::move(lines)), key, "map index"));
  }
  index->rebuilt_because_ = std::move(rebuilt_because);
  index->kept_in_memory_because_ = std::move(kept_in_memory_because);
  return index;
}

std::shared_ptr<const MapIndex> MapIndex::build(const maps::MapPackage& map,
                                                const MapIndexOptions& options) {
  require_usable(options);
  const IndexKey key{map.digest(), options};
  std::shared_ptr<MapIndex> index(
      new MapIndex(std::make_unique<const Storage>(to_bytes(key, build_voxels(map, options))), key,
                   "map index"));
  index->own_error_ = std::make_unique<const OwnError>(map);
  return index;
}

std::shared_ptr<const MapIndex> MapIndex::build(const std::vector<Eigen::Vector3d>& points_map,
                                                const MapIndexOptions& options) {
  require_usable(options);
  const IndexKey key{"", options};
  return std::shared_ptr<const MapIndex>(new MapIndex(
      std::make_unique<const Storage>(to_bytes(key, build_voxels(points_map, options))), key,
      "map index"));
}

}  // namespace stillmap::localization
