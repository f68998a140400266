#include "reference/erasor.hpp"

#include <stillmap/maps/cell_table.hpp>
#include <stillmap/maps/median.hpp>

#include "core/point_cells.hpp"
#include "reference/map_blocks.hpp"
#include "reference/polar_bins.hpp"
#include "reference/region_ground.hpp"

#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr std::size_t kRemovalInterval = 4;
constexpr double kQueryVoxelM = 0.2;
constexpr std::uint32_t kFewestPoints = 6;
constexpr float kDynamicRatio = 0.2F;
constexpr float kLowestObjectM = 0.5F;
/// No bin of the map is taller.
constexpr float kTallestMapM = PolarBins::kMaxHeightM - PolarBins::kMinHeightM;
/// Ground that tells the height of the sensor [m]: nearer than any slope matters.
constexpr float kNearGroundM = 10.0F;
/// Smaller blocks are culled better, larger ones are fewer [m].
constexpr double kErasorBlockM = 2.0;

using BinFlags = std::array<std::uint8_t, PolarBins::kBins>;

/// A scan ready to be compared.
struct Query {
  Eigen::Isometry3f T_body_local = Eigen::Isometry3f::Identity();
  std::array<PseudoOccupancy, PolarBins::kBins> bins;
  /// Bins that the map may turn out to be dynamic in.
  BinFlags undecided{};
  /// All points, local frame.
  std::vector<Eigen::Vector3f> positions;
};

/// Height of the sensor over the ground around it [m]; nothing without ground near.
std::optional<float> sensor_height(const PosedScan& scan) {
  std::vector<float> heights;
  for (std::size_t i = 0; i < scan.positions.size(); ++i) {
    if (scan.is_ground[i] == 0) continue;
    if (scan.positions[i].head<2>().norm() < kNearGroundM) heights.push_back(scan.positions[i].z());
  }
  if (heights.empty()) return std::nullopt;
  return -maps::median(std::move(heights));
}

/// Nothing when the scan cannot be compared.
std::unique_ptr<Query> make_query(const PosedScan& scan) {
  const std::optional<float> height_m = sensor_height(scan);
  if (!height_m) return nullptr;
  auto query = std::make_unique<Query>();
  Eigen::Isometry3d T_body_lidar = Eigen::Isometry3d::Identity();
  T_body_lidar.translation().z() = static_cast<double>(*height_m);
  query->T_body_local = (T_body_lidar * scan.T_local_lidar.inverse()).cast<float>();
  const PointCells cells(scan.positions, kQueryVoxelM);
  for (std::size_t cell = 0; cell < cells.cells(); ++cell) {
    const PointCells::Range range = cells.cell(cell);
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    for (std::uint32_t i = range.begin; i < range.end; ++i) sum += cells.in_cell_order()[i];
    Eigen::Vector3f mean = sum / static_cast<float>(range.end - range.begin);
    mean.z() += *height_m;
    const int bin = PolarBins::bin_of(mean);
    if (bin >= 0) query->bins[static_cast<std::size_t>(bin)].add(mean.z());
  }
  for (std::size_t bin = 0; bin < PolarBins::kBins; ++bin) {
    const PseudoOccupancy& seen = query->bins[bin];
    query->undecided[bin] =
        seen.points >= kFewestPoints && seen.height_m() <= kDynamicRatio * kTallestMapM ? 1 : 0;
  }
  query->positions.reserve(scan.positions.size());
  for (const Eigen::Vector3f& p : scan.positions) {
    query->positions.push_back((scan.T_local_lidar * p.cast<double>()).cast<float>());
  }
  return query;
}

std::uint64_t voxel_key(const Eigen::Vector3f& p, double inverse_voxel) {
  const auto cell = [&](float x) {
    return static_cast<std::int64_t>(std::floor(static_cast<double>(x) * inverse_voxel));
  };
  return maps::signed_cell_key(cell(p.x()), cell(p.y()), cell(p.z()));
}

/// The map, and what is left of it.
class Comparison {
 public:
  explicit Comparison(const CleaningPoints& points)
      : map_(MapBlocks::of(points.positions, kErasorBlockM)),
        gone_(points.positions.size(), 0),
        bin_of_point_(points.positions.size(), -1),
        inverse_voxel_(1.0 / points.voxel_size_m) {}

  void compare(const Query& query) {
    const std::vector<std::size_t> near = occupy(query);
    BinFlags dynamic{};
    bool any = false;
    for (std::size_t bin = 0; bin < PolarBins::kBins; ++bin) {
      dynamic[bin] = query.undecided[bin] != 0 && is_dynamic(query.bins[bin], bins_[bin]) ? 1 : 0;
      any = any || dynamic[bin] != 0;
    }
    if (any) remove(query, dynamic, near);
  }

  /// In the order of the points as they were given.
  [[nodiscard]] std::vector<std::uint8_t> gone() const {
    std::vector<std::uint8_t> flags(gone_.size());
    for (std::size_t i = 0; i < gone_.size(); ++i) flags[map_.given_index[i]] = gone_[i];
    return flags;
  }

 private:
  static bool is_dynamic(const PseudoOccupancy& seen, const PseudoOccupancy& map) {
    return map.height_m() > seen.height_m() && scan_ratio(map, seen) < kDynamicRatio &&
           map.height_m() > kLowestObjectM;
  }

  /// Fills the bins of the map. @return the blocks that touch an undecided bin.
  std::vector<std::size_t> occupy(const Query& query) {
    bins_.fill({});
    std::vector<std::size_t> near;
    for (std::size_t b = 0; b < map_.blocks.size(); ++b) {
      const MapBlocks::Block& block = map_.blocks[b];
      const Eigen::Vector3f centre = query.T_body_local * block.centre;
      if (!PolarBins::touches(centre, block.half_edge.norm(), query.undecided)) continue;
      near.push_back(b);
      for (std::uint32_t i = block.begin; i < block.end; ++i) {
        if (gone_[i] != 0) continue;
        const Eigen::Vector3f p = query.T_body_local * map_.positions[i];
        bin_of_point_[i] = static_cast<std::int16_t>(PolarBins::bin_of(p));
        if (bin_of_point_[i] >= 0) bins_[static_cast<std::size_t>(bin_of_point_[i])].add(p.z());
      }
    }
    return near;
  }

  void remove(const Query& query, const BinFlags& dynamic, const std::vector<std::size_t>& near) {
    std::vector<std::pair<std::int16_t, std::uint32_t>> in_bins;
    for (const std::size_t b : near) {
      for (std::uint32_t i = map_.blocks[b].begin; i < map_.blocks[b].end; ++i) {
        const std::int16_t bin = bin_of_point_[i];
        if (gone_[i] != 0 || bin < 0 || dynamic[static_cast<std::size_t>(bin)] == 0) continue;
        in_bins.emplace_back(bin, i);
      }
    }
    std::sort(in_bins.begin(), in_bins.end());
    const maps::CellTable seen = voxels_seen(query, dynamic);
    for (std::size_t begin = 0; begin < in_bins.size();) {
      std::size_t end = begin;
      std::vector<Eigen::Vector3f> region;
      for (; end < in_bins.size() && in_bins[end].first == in_bins[begin].first; ++end) {
        region.emplace_back(query.T_body_local * map_.positions[in_bins[end].second]);
      }
      const std::vector<std::uint8_t> is_ground = region_ground(region);
      for (std::size_t k = begin; k < end; ++k) {
        const std::uint32_t i = in_bins[k].second;
        if (is_ground[k - begin] != 0) continue;
        gone_[i] = seen.contains(voxel_key(map_.positions[i], inverse_voxel_)) ? 0 : 1;
      }
      begin = end;
    }
  }

  /// Voxels of the map with a point of the scan in a dynamic bin.
  [[nodiscard]] maps::CellTable voxels_seen(const Query& query, const BinFlags& dynamic) const {
    maps::CellTable voxels;
    for (const Eigen::Vector3f& p : query.positions) {
      const int bin = PolarBins::bin_of(query.T_body_local * p);
      if (bin < 0 || dynamic[static_cast<std::size_t>(bin)] == 0) continue;
      voxels.insert(voxel_key(p, inverse_voxel_));
    }
    return voxels;
  }

  MapBlocks map_;
  /// In the order of the blocks, as is bin_of_point_.
  std::vector<std::uint8_t> gone_;
  std::vector<std::int16_t> bin_of_point_;
  std::array<PseudoOccupancy, PolarBins::kBins> bins_;
  double inverse_voxel_;
};

}  // namespace

std::vector<std::uint8_t> Erasor::moved(const CleaningPoints& points, const ScanSource& scans,
                                        const ProgressCallback& progress,
                                        const CancelFlag& cancel) const {
  Comparison comparison(points);
  std::size_t next = 0;
  std::size_t done = 0;
  const auto source = [&](tbb::flow_control& control) -> std::size_t {
    if (cancel) throw Cancelled();
    if (next >= scans.size()) {
      control.stop();
      return 0;
    }
    return std::exchange(next, next + kRemovalInterval);
  };
  using Shared = std::shared_ptr<const Query>;
  const auto prepare = [&](std::size_t index) -> Shared { return make_query(scans.read(index)); };
  const auto compare = [&](const Shared& query) {
    if (query) comparison.compare(*query);
    done = std::min(done + kRemovalInterval, scans.size());
    if (progress) progress("clean", done, scans.size());
  };
  using tbb::filter_mode;
  const auto tokens = 2 * static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
  tbb::parallel_pipeline(tokens,
                         tbb::make_filter<void, std::size_t>(filter_mode::serial_in_order, source) &
                             tbb::make_filter<std::size_t, Shared>(filter_mode::parallel, prepare) &
                             tbb::make_filter<Shared, void>(filter_mode::serial_in_order, compare));
  return comparison.gone();
}

}  // namespace stillmap::mapping
