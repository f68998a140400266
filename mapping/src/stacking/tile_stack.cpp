#include "stacking/tile_stack.hpp"

#include <stillmap/maps/error.hpp>

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <system_error>
#include <utility>

namespace stillmap::mapping {
namespace {

/// A tile that so many scans have not met is one that the vehicle has left.
constexpr std::uint32_t kRecentScans = 32;

}  // namespace

bool ScanVoxels::add(const StackedPoint& point) {
  const auto place = grid_->find(point.p_map);
  if (!place) return false;
  if (last_ == nullptr || last_tile_ != place->tile) {
    last_tile_ = place->tile;
    last_ = &tiles_[place->tile];
  }
  const bool moved = !maps::is_measured(point.kind);
  last_->add({.key = place->voxel << 1U | (moved ? 1U : 0U),
              .offset = {place->offset.x(), place->offset.y(), place->offset.z()},
              .intensity = point.intensity,
              .observations = 1,
              .ground = point.kind == maps::PointKind::kGround ? 1U : 0U,
              .scans = 1,
              .first_scan = scan_,
              .last_scan = scan_,
              .object = point.object},
             true);
  return true;
}

TileStack::TileStack(std::filesystem::path scratch_file, std::size_t most_voxels)
    : scratch_file_(std::move(scratch_file)), most_voxels_(most_voxels) {
  if (most_voxels == 0) throw std::invalid_argument("voxels in memory: 0, expected > 0");
}

TileStack::~TileStack() {
  std::error_code ignored;
  if (scratch_) std::filesystem::remove(scratch_file_, ignored);
}

void TileStack::add(const ScanVoxels& scan, const std::function<bool(maps::TileId)>& wanted) {
  for (const auto& [id, voxels] : scan.tiles()) {
    if (wanted && !wanted(id)) continue;
    Tile& tile = tiles_[id];
    if (tile.written) bring_back(tile);
    const std::size_t before = tile.voxels.sums().size();
    for (const VoxelSum& sum : voxels.sums()) tile.voxels.add(sum, false);
    tile.last_scan = scan.scan();
    voxels_ += tile.voxels.sums().size() - before;
  }
  if (voxels_ > most_voxels_) spill(scan.scan());
}

void TileStack::spill(std::uint32_t scan) {
  std::vector<std::pair<std::uint32_t, maps::TileId>> oldest;
  for (const auto& [id, tile] : tiles_) {
    if (!tile.voxels.sums().empty() && tile.last_scan + kRecentScans <= scan)
      oldest.emplace_back(tile.last_scan, id);
  }
  std::sort(oldest.begin(), oldest.end());
  for (const auto& [last_scan, id] : oldest) {
    // A good part at once, so that it does not happen every scan.
    if (4 * voxels_ <= 3 * most_voxels_) return;
    write(tiles_.at(id));
  }
}

void TileStack::write(Tile& tile) {
  if (!scratch_) scratch_.reset(std::fopen(scratch_file_.c_str(), "w+b"));
  const std::vector<VoxelSum>& sums = tile.voxels.sums();
  if (!scratch_ ||
      std::fwrite(sums.data(), sizeof(VoxelSum), sums.size(), scratch_.get()) != sums.size())
    throw maps::StorageError(scratch_file_.string(), std::strerror(errno));
  tile.written = {written_, sums.size()};
  written_ += sums.size() * sizeof(VoxelSum);
  voxels_ -= sums.size();
  tile.voxels = {};
}

std::vector<maps::TileId> TileStack::tiles() const {
  std::vector<maps::TileId> ids;
  for (const auto& [id, tile] : tiles_) ids.push_back(id);
  return ids;
}

void TileStack::bring_back(Tile& tile) {
  for (const VoxelSum& sum : read_back(*tile.written)) tile.voxels.add(sum, false);
  voxels_ += tile.voxels.sums().size();
  give_back(*tile.written);
  tile.written.reset();
}

void TileStack::give_back(Part part) const {
  // Where the file system cannot, the file is as long as all that was ever written.
  (void)::fallocate(::fileno(scratch_.get()), FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE,
                    static_cast<off_t>(part.offset),
                    static_cast<off_t>(part.voxels * sizeof(VoxelSum)));
}

std::vector<VoxelSum> TileStack::read_back(Part part) const {
  std::vector<VoxelSum> sums(part.voxels);
  const auto bytes = static_cast<ssize_t>(sums.size() * sizeof(VoxelSum));
  if (std::fflush(scratch_.get()) != 0)
    throw maps::StorageError(scratch_file_.string(), std::strerror(errno));
  if (::pread(::fileno(scratch_.get()), sums.data(), static_cast<std::size_t>(bytes),
              static_cast<off_t>(part.offset)) != bytes)
    throw maps::StorageError(scratch_file_.string(), "a tile cannot be read back");
  return sums;
}

std::vector<VoxelSum> TileStack::read(maps::TileId id) const {
  const Tile& tile = tiles_.at(id);
  std::vector<VoxelSum> sums = tile.written ? read_back(*tile.written) : tile.voxels.sums();
  // Which is independent of the order in which they came.
  std::sort(sums.begin(), sums.end(),
            [](const VoxelSum& a, const VoxelSum& b) { return a.key < b.key; });
  return sums;
}

std::vector<VoxelSum> TileStack::take(maps::TileId id) {
  std::vector<VoxelSum> sums = read(id);
  tiles_.at(id).voxels = {};
  return sums;
}

}  // namespace stillmap::mapping
