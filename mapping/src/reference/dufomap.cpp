#include "reference/dufomap.hpp"

#include "reference/block_grid.hpp"
#include "reference/scan_space.hpp"
#include "reference/void_region.hpp"
#include "reference/voxel_ray.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <mutex>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

using reference::BlockBits;
using reference::BlockIndex;

/// What one thread works in.
struct Workspace {
  reference::ScanSpace space;
  reference::ScanRays rays;
};

/// The blocks with map points, and which of their voxels were void.
class VoidMap {
 public:
  /// @param points  outlives this.
  VoidMap(const CleaningPoints& points, double voxel_m) : points_(points), voxel_m_(voxel_m) {
    BlockIndex::Hint hint;
    for (const Eigen::Vector3f& p : points.positions) {
      index_.add(reference::block_of(voxel_at(p)), hint);
    }
    void_.resize(index_.size());
  }

  /// Safe from several threads.
  void join(const reference::ScanSpace& space, int unknown_voxels) {
    for (std::size_t i = 0; i < space.size(); ++i) {
      const std::uint32_t number = index_.find(space.position(i));
      if (number == BlockIndex::kNone) continue;
      const BlockBits seen = reference::void_region(space, i, unknown_voxels);
      for (std::size_t z = 0; z < seen.size(); ++z) {
        if (seen[z] == 0) continue;
        std::atomic_ref(void_[number][z]).fetch_or(seen[z], std::memory_order_relaxed);
      }
    }
  }

  [[nodiscard]] std::vector<std::uint8_t> flags() const {
    std::vector<std::uint8_t> flags;
    flags.reserve(points_.positions.size());
    for (const Eigen::Vector3f& p : points_.positions) {
      const Eigen::Vector3i voxel = voxel_at(p);
      const BlockBits& bits = void_[index_.find(reference::block_of(voxel))];
      const std::uint64_t word = bits[static_cast<std::size_t>(voxel.z() & 7)];
      flags.push_back((word & reference::column_bit(voxel)) != 0 ? 1 : 0);
    }
    return flags;
  }

 private:
  [[nodiscard]] Eigen::Vector3i voxel_at(const Eigen::Vector3f& p) const {
    return reference::voxel_of(
        reference::in_voxels(p.cast<double>(), voxel_m_, "point of the map"));
  }

  const CleaningPoints& points_;
  double voxel_m_;
  BlockIndex index_;
  std::vector<BlockBits> void_;
};

}  // namespace

std::vector<std::string> DufomapOptions::violations() const {
  std::vector<std::string> broken;
  if (!(voxel_m >= 0.01 && voxel_m <= 10.0)) {
    broken.push_back(fmt::format("voxel_m: {}, in [0.01, 10]", voxel_m));
  }
  if (!(hit_distance_m >= 0.0 && hit_distance_m <= 10.0)) {
    broken.push_back(fmt::format("hit_distance_m: {}, in [0, 10]", hit_distance_m));
  }
  if (unknown_voxels < 0 || unknown_voxels > 7) {
    broken.push_back(fmt::format("unknown_voxels: {}, in [0, 7]", unknown_voxels));
  }
  return broken;
}

DufomapCleaner::DufomapCleaner(const DufomapOptions& options) : options_(options) {
  const std::vector<std::string> broken = options.violations();
  if (!broken.empty()) throw std::invalid_argument(fmt::format("{}", fmt::join(broken, "; ")));
}

std::vector<std::uint8_t> DufomapCleaner::moved(const CleaningPoints& points,
                                                const ScanSource& scans,
                                                const ProgressCallback& progress,
                                                const CancelFlag& cancel) const {
  if (points.positions.empty()) return {};
  VoidMap map(points, options_.voxel_m);
  const double hit_voxels = options_.hit_distance_m / options_.voxel_m;
  tbb::enumerable_thread_specific<Workspace> workspaces;
  std::mutex reporting;
  std::size_t done = 0;
  tbb::parallel_for(std::size_t{0}, scans.size(), [&](std::size_t scan) {
    if (cancel) throw Cancelled();
    Workspace& work = workspaces.local();
    work.space.clear();
    reference::take_rays(
        scans.read(scan), options_.voxel_m, work.space, [](std::size_t) { return true; },
        work.rays);
    reference::mark_hits(work.rays, hit_voxels, work.space);
    reference::mark_free(work.rays, options_.unknown_voxels, work.space);
    map.join(work.space, options_.unknown_voxels);
    const std::lock_guard lock(reporting);
    if (progress) progress("clean", ++done, scans.size());
  });
  return map.flags();
}

}  // namespace stillmap::mapping
