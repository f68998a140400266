#include "reference/octomap_cleaner.hpp"

#include "reference/block_grid.hpp"
#include "reference/scan_space.hpp"
#include "reference/voxel_ray.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <octomap/OcTree.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <bit>
#include <memory>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

using reference::BlockBits;
using reference::BlockIndex;

/// Enough that the serial end never waits, few enough for memory.
constexpr std::size_t kScansPerThread = 2;

/// What one scan says of a block's voxels with map points.
struct BlockUpdate {
  std::uint32_t block = 0;
  BlockBits missed{};
  BlockBits hit{};
};
using ScanUpdate = std::vector<BlockUpdate>;

/// What one thread works in.
struct OctomapWorkspace {
  reference::ScanSpace space;
  reference::ScanRays rays;
};

/// The voxels of the map's points, and the tree that judges them.
class OccupiedMap {
 public:
  /// @param points  outlives this.
  OccupiedMap(const CleaningPoints& points, const OctomapOptions& options)
      : points_(points),
        voxel_m_(options.voxel_m),
        tree_(options.voxel_m),
        hit_(octomap::logodds(options.hit_probability)),
        miss_(octomap::logodds(options.miss_probability)) {
    tree_.setClampingThresMin(options.min_probability);
    tree_.setClampingThresMax(options.max_probability);
    BlockIndex::Hint hint;
    for (const Eigen::Vector3f& p : points.positions) {
      const Eigen::Vector3i voxel = voxel_at(p);
      const std::uint32_t number = index_.add(reference::block_of(voxel), hint);
      if (number == occupied_.size()) occupied_.emplace_back();
      occupied_[number][static_cast<std::size_t>(voxel.z() & 7)] |= reference::column_bit(voxel);
    }
    place_keys();
  }

  /// Safe from several threads, between calls of `apply` or not.
  [[nodiscard]] ScanUpdate update_of(const reference::ScanSpace& space) const {
    ScanUpdate update;
    for (std::size_t i = 0; i < space.size(); ++i) {
      const std::uint32_t number = index_.find(space.position(i));
      if (number == BlockIndex::kNone) continue;
      const reference::ScanSpace::Block& seen = space.block(i);
      BlockUpdate block{number, {}, {}};
      std::uint64_t any = 0;
      for (std::size_t z = 0; z < 8; ++z) {
        block.hit[z] = seen.hit[z] & occupied_[number][z];
        block.missed[z] = seen.free[z] & ~seen.hit[z] & occupied_[number][z];
        any |= block.hit[z] | block.missed[z];
      }
      if (any != 0) update.push_back(block);
    }
    return update;
  }

  void apply(const ScanUpdate& update) {
    for (const BlockUpdate& block : update) {
      const Eigen::Vector3i first = 8 * index_.block(block.block);
      for (int z = 0; z < 8; ++z) {
        const auto word = static_cast<std::size_t>(z);
        add(first, z, block.missed[word], miss_);
        add(first, z, block.hit[word], hit_);
      }
    }
  }

  [[nodiscard]] std::vector<std::uint8_t> flags() const {
    std::vector<std::uint8_t> flags(points_.positions.size(), 0);
    for (std::size_t i = 0; i < flags.size(); ++i) {
      if (points_.is_ground[i] != 0) continue;
      const octomap::OcTreeNode* node = tree_.search(key_of(voxel_at(points_.positions[i])));
      flags[i] = node != nullptr && !tree_.isNodeOccupied(node) ? 1 : 0;
    }
    return flags;
  }

 private:
  /// The library's keys are 16 bits wide: they count from the map's lowest corner.
  void place_keys() {
    Eigen::Vector3i low = voxel_at(points_.positions.front()), high = low;
    for (const Eigen::Vector3f& p : points_.positions) {
      low = low.cwiseMin(voxel_at(p));
      high = high.cwiseMax(voxel_at(p));
    }
    first_voxel_ = low;
    const int widest = (high - low).maxCoeff();
    if (widest > 0xFFFF) {
      throw std::invalid_argument(
          fmt::format("octomap: found a map of {} voxels, expected at most 65536", widest + 1));
    }
  }

  [[nodiscard]] octomap::OcTreeKey key_of(const Eigen::Vector3i& voxel) const {
    const Eigen::Vector3i key = voxel - first_voxel_;
    return {static_cast<octomap::key_type>(key.x()), static_cast<octomap::key_type>(key.y()),
            static_cast<octomap::key_type>(key.z())};
  }

  void add(const Eigen::Vector3i& first, int z, std::uint64_t bits, float log_odds) {
    for (; bits != 0; bits &= bits - 1) {
      const int bit = std::countr_zero(bits);
      const Eigen::Vector3i voxel = first + Eigen::Vector3i(bit & 7, bit >> 3, z);
      // Inner nodes are not asked for, hence lazy.
      tree_.updateNode(key_of(voxel), log_odds, true);
    }
  }

  [[nodiscard]] Eigen::Vector3i voxel_at(const Eigen::Vector3f& p) const {
    return reference::voxel_of(
        reference::in_voxels(p.cast<double>(), voxel_m_, "point of the map"));
  }

  const CleaningPoints& points_;
  double voxel_m_;
  octomap::OcTree tree_;
  float hit_;
  float miss_;
  Eigen::Vector3i first_voxel_ = Eigen::Vector3i::Zero();
  BlockIndex index_;
  /// Voxels with map points, by block.
  std::vector<BlockBits> occupied_;
};

void expect_flags(const char* of, std::size_t flags, std::size_t points) {
  if (flags == points) return;
  throw std::invalid_argument(
      fmt::format("octomap: {}: found {} ground flags, expected {}", of, flags, points));
}

void look(const PosedScan& scan, double voxel_m, OctomapWorkspace& work) {
  expect_flags("scan", scan.is_ground.size(), scan.positions.size());
  work.space.clear();
  const auto ground = [&](std::size_t i) { return scan.is_ground[i] != 0; };
  const auto surface = [&](std::size_t i) { return scan.is_ground[i] == 0; };
  reference::take_rays(scan, voxel_m, work.space, surface, work.rays);
  reference::mark_hits(work.rays, 0.0, work.space);
  reference::mark_passed(work.rays, work.space);
  reference::take_rays(scan, voxel_m, work.space, ground, work.rays);
  reference::mark_passed(work.rays, work.space);
}

}  // namespace

std::vector<std::string> OctomapOptions::violations() const {
  std::vector<std::string> broken;
  const auto within = [&](const char* name, double value, double low, double high) {
    if (!(value > low && value < high)) {
      broken.push_back(fmt::format("{}: {}, in ({}, {})", name, value, low, high));
    }
  };
  if (!(voxel_m >= 0.01 && voxel_m <= 10.0)) {
    broken.push_back(fmt::format("voxel_m: {}, in [0.01, 10]", voxel_m));
  }
  within("hit_probability", hit_probability, 0.5, 1.0);
  within("miss_probability", miss_probability, 0.0, 0.5);
  within("min_probability", min_probability, 0.0, 0.5);
  within("max_probability", max_probability, 0.5, 1.0);
  return broken;
}

OctomapCleaner::OctomapCleaner(const OctomapOptions& options) : options_(options) {
  const std::vector<std::string> broken = options.violations();
  if (!broken.empty()) throw std::invalid_argument(fmt::format("{}", fmt::join(broken, "; ")));
}

std::vector<std::uint8_t> OctomapCleaner::moved(const CleaningPoints& points,
                                                const ScanSource& scans,
                                                const ProgressCallback& progress,
                                                const CancelFlag& cancel) const {
  expect_flags("map", points.is_ground.size(), points.positions.size());
  if (points.positions.empty()) return {};
  OccupiedMap map(points, options_);
  tbb::enumerable_thread_specific<OctomapWorkspace> workspaces;
  std::size_t next = 0, done = 0;
  const auto source = [&](tbb::flow_control& control) -> std::size_t {
    if (next == scans.size()) {
      control.stop();
      return 0;
    }
    if (cancel) throw Cancelled();
    return next++;
  };
  const auto cast = [&](std::size_t scan) {
    OctomapWorkspace& work = workspaces.local();
    look(scans.read(scan), options_.voxel_m, work);
    return std::make_shared<const ScanUpdate>(map.update_of(work.space));
  };
  // Bounds make log-odds depend on the order.
  const auto sink = [&](const std::shared_ptr<const ScanUpdate>& update) {
    map.apply(*update);
    if (progress) progress("clean", ++done, scans.size());
  };
  using tbb::filter_mode;
  using Shared = std::shared_ptr<const ScanUpdate>;
  const auto threads = static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
  tbb::parallel_pipeline(kScansPerThread * threads,
                         tbb::make_filter<void, std::size_t>(filter_mode::serial_in_order, source) &
                             tbb::make_filter<std::size_t, Shared>(filter_mode::parallel, cast) &
                             tbb::make_filter<Shared, void>(filter_mode::serial_in_order, sink));
  return map.flags();
}

}  // namespace stillmap::mapping
