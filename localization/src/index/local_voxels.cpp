#include "local_voxels.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

namespace stillmap::localization {
namespace {

constexpr double kFinestM = 0.5;
constexpr int kLevels = 3;
/// As in `MapIndexOptions`.
constexpr std::uint32_t kMinPoints = 5;
/// A cell with so many points keeps the shape that the first scans gave it: later ones, which have
/// drifted, must fit to it instead of dragging it along. Saves most of the work too.
constexpr std::uint32_t kFullPoints = 100;
/// The sensor's place relative to the origin: farther than what it sees, so that no cell's
/// coordinate is negative.
constexpr double kLocalMarginM = 256.0;
/// The origin follows when the sensor has gone so far [m].
constexpr double kFollowM = 20.0;

/// Number of the voxel of a cell without shape.
constexpr std::uint32_t kNoVoxel = VoxelTable::kNone;

double coarsest_m() { return kFinestM * std::exp2(kLevels - 1); }

/// The same points seen from another origin. @param shift  of the origin [m].
void move(Moments& moments, const Eigen::Vector3d& shift) {
  const Eigen::Matrix3d cross = shift * moments.sum.transpose();
  moments.outer += moments.weight * shift * shift.transpose() - cross - cross.transpose();
  moments.sum -= moments.weight * shift;
}

}  // namespace

void GrowingLevel::add(const MomentGrid& scan) {
  std::vector<Numbered> fresh;
  for (const Moments& added : scan.cells) {
    const auto [index, inserted] = grid_.table.insert(added.key);
    if (inserted) {
      grid_.cells.emplace_back().key = added.key;
      numbers_.push_back(kNoVoxel);
    }
    Moments& cell = grid_.cells[index];
    if (cell.count >= kFullPoints) continue;
    cell.add(added);
    if (cell.count < kMinPoints) continue;
    if (numbers_[index] != kNoVoxel) {
      voxels_[numbers_[index]] = voxel_of(cell, edge_m_);
    } else {
      const auto [x, y, z] = cell_of_key(cell.key);
      fresh.push_back({CellBlocks::place_of(x, y, z), index});
    }
  }
  if (!fresh.empty()) insert(std::move(fresh));
}

void GrowingLevel::insert(std::vector<Numbered> fresh) {
  const auto before = [](const Numbered& a, const Numbered& b) { return a.place < b.place; };
  std::sort(fresh.begin(), fresh.end(), before);
  std::vector<Numbered> order;
  order.reserve(order_.size() + fresh.size());
  std::merge(order_.begin(), order_.end(), fresh.begin(), fresh.end(), std::back_inserter(order),
             before);
  std::vector<Voxel> voxels(order.size());
  std::vector<CellBlocks::Place> places(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    std::uint32_t& number = numbers_[order[i].cell];
    voxels[i] =
        number == kNoVoxel ? voxel_of(grid_.cells[order[i].cell], edge_m_) : voxels_[number];
    number = static_cast<std::uint32_t>(i);
    places[i] = order[i].place;
  }
  order_ = std::move(order);
  voxels_ = std::move(voxels);
  blocks_ = CellBlockTable(places, kLocalTileShift);
}

MapIndex::Level GrowingLevel::view() const {
  const auto edge_m = static_cast<float>(edge_m_);
  const CellBlocks::Part all{.tiles = blocks_.tiles(), .slots = blocks_.slots(), .voxels = voxels_};
  return {edge_m, CellBlocks({&all, 1}, kLocalTileShift, edge_m)};
}

void GrowingLevel::move(const Eigen::Vector3i& cells, const Eigen::Vector3d& place,
                        double reach_m) {
  const MomentGrid old = std::exchange(grid_, MomentGrid());
  numbers_.clear();
  order_.clear();
  voxels_.clear();
  std::vector<Numbered> kept;
  for (const Moments& cell : old.cells) {
    const auto [x, y, z] = cell_of_key(cell.key);
    const Eigen::Vector3i at = Eigen::Vector3i(x, y, z) - cells;
    const Eigen::Vector3d centre = (at.cast<double>().array() + 0.5) * edge_m_;
    if (!is_cell(at.x(), at.y(), at.z()) || !((centre - place).norm() < reach_m)) continue;
    Moments moved = cell;
    moved.key = cell_key(at.x(), at.y(), at.z());
    localization::move(moved, cells.cast<double>() * edge_m_);
    grid_.at(moved.key) = moved;
    numbers_.push_back(kNoVoxel);
    if (moved.count >= kMinPoints) {
      kept.push_back({CellBlocks::place_of(at.x(), at.y(), at.z()),
                      static_cast<std::uint32_t>(grid_.cells.size() - 1)});
    }
  }
  insert(std::move(kept));
}

LocalVoxels::LocalVoxels() {
  for (int level = 0; level < kLevels; ++level) {
    growing_.emplace_back(kFinestM * std::exp2(level));
  }
}

void LocalVoxels::follow(const Eigen::Vector3d& sensor, double reach_m) {
  if (placed_ && (sensor - centre_).norm() < kFollowM) return;
  const Eigen::Vector3d steps =
      ((sensor.array() - kLocalMarginM - origin_.array()) / coarsest_m()).floor();
  if (placed_ && !(steps.cwiseAbs().maxCoeff() * coarsest_m() < kLocalMarginM)) {
    // What was seen is out of reach altogether.
    for (GrowingLevel& level : growing_) level = GrowingLevel(level.edge_m());
    placed_ = false;
  }
  origin_ += steps * coarsest_m();
  centre_ = sensor;
  if (placed_) {
    for (GrowingLevel& level : growing_) {
      const Eigen::Vector3i cells =
          (steps * (coarsest_m() / level.edge_m())).array().round().cast<int>();
      level.move(cells, sensor - origin_, reach_m);
    }
  }
  placed_ = true;
}

void LocalVoxels::add(std::span<const Eigen::Vector3f> points_lidar,
                      const Eigen::Isometry3d& T_odom_lidar, double reach_m) {
  follow(T_odom_lidar.translation(), reach_m);
  Eigen::Isometry3d T_local_lidar = T_odom_lidar;
  T_local_lidar.translation() -= origin_;
  MomentGrid scan;
  const auto reach2 = static_cast<float>(reach_m * reach_m);
  for (const Eigen::Vector3f& p_lidar : points_lidar) {
    if (!(p_lidar.squaredNorm() < reach2)) continue;
    const Eigen::Vector3d p = T_local_lidar * p_lidar.cast<double>();
    // Coordinates are positive: a cast rounds down.
    const Eigen::Vector3i cell = (p / kFinestM).cast<int>();
    scan.at(cell_key(cell.x(), cell.y(), cell.z())).add(p, 1.0);
  }
  views_.clear();
  for (GrowingLevel& level : growing_) {
    if (&level != &growing_.front()) scan = coarser(scan);
    level.add(scan);
    views_.insert(views_.begin(), level.view());
  }
}

}  // namespace stillmap::localization
