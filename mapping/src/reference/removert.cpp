#include "reference/removert.hpp"

#include "reference/map_blocks.hpp"
#include "reference/range_image.hpp"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <limits>
#include <mutex>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Pixel edges in ring spacings.
constexpr std::array kRemovePixels = {1.0, 1.25, 5.0 / 3.0};
constexpr std::array kRevertPixels = {2.5};
constexpr std::size_t kPasses = kRemovePixels.size() + kRevertPixels.size();
/// Smallest discrepancy that counts, over the scan's range.
constexpr float kDiscrepancy = 0.05F;
/// Smaller blocks are culled better, larger ones are fewer [m].
constexpr double kBlockM = 1.0;
/// No sensor of ours is finer or coarser [rad].
constexpr double kLargestPixelRad = 0.2;

struct ScanImages {
  Eigen::Isometry3f T_lidar_local = Eigen::Isometry3f::Identity();
  /// One a pass.
  std::vector<RangeImage> images;
};

/// What is nearest in each pixel of the map.
struct MapImage {
  std::vector<float> range_m;
  std::vector<std::uint32_t> point;
};

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

std::vector<Spherical> directions_of(const PosedScan& scan) {
  std::vector<Spherical> directions(scan.positions.size());
  std::transform(scan.positions.begin(), scan.positions.end(), directions.begin(), spherical_of);
  return directions;
}

class Run {
 public:
  Run(const ScanSource& scans, const ProgressCallback& progress, const CancelFlag& cancel)
      : scans_(scans), progress_(progress), cancel_(cancel), total_(scans.size() * (kPasses + 1)) {}

  void read_scans() {
    const double spacing_rad = find_spacing();
    views_.resize(scans_.size());
    tbb::parallel_for(std::size_t{0}, scans_.size(), [&](std::size_t i) {
      if (cancel_) throw Cancelled();
      const PosedScan scan = scans_.read(i);
      views_[i].T_lidar_local = scan.T_local_lidar.inverse().cast<float>();
      const std::vector<Spherical> directions = directions_of(scan);
      const auto add = [&](double pixels) {
        views_[i].images.emplace_back(directions, std::min(pixels * spacing_rad, kLargestPixelRad));
      };
      std::for_each(kRemovePixels.begin(), kRemovePixels.end(), add);
      std::for_each(kRevertPixels.begin(), kRevertPixels.end(), add);
      report();
    });
  }

  /// Points that stand in front of what some scan saw, sets their flags.
  void object(const MapBlocks& map, std::size_t pass, std::vector<std::uint8_t>& dynamic) {
    tbb::enumerable_thread_specific<std::vector<std::uint8_t>> flags(
        [&] { return std::vector<std::uint8_t>(map.positions.size(), 0); });
    tbb::enumerable_thread_specific<MapImage> images;
    tbb::parallel_for(std::size_t{0}, views_.size(), [&](std::size_t i) {
      if (cancel_) throw Cancelled();
      object_of_scan(map, views_[i].T_lidar_local, views_[i].images[pass], images.local(),
                     flags.local());
      report();
    });
    for (const std::vector<std::uint8_t>& some : flags) {
      for (std::size_t i = 0; i < some.size(); ++i) {
        if (some[i] != 0) dynamic[map.given_index[i]] = 1;
      }
    }
  }

 private:
  double find_spacing() const {
    for (std::size_t i = 0; i < scans_.size(); ++i) {
      if (cancel_) throw Cancelled();
      const PosedScan scan = scans_.read(i);
      if (!scan.positions.empty()) return ring_spacing_rad(directions_of(scan));
    }
    return ring_spacing_rad({});
  }

  static void object_of_scan(const MapBlocks& map, const Eigen::Isometry3f& T_lidar_local,
                             const RangeImage& scan, MapImage& image,
                             std::vector<std::uint8_t>& flags) {
    // A pixel starts at the range from which on a map point agrees with the scan, so that only
    // nearer ones get in.
    image.range_m.resize(scan.nearest_m().size());
    image.point.assign(scan.nearest_m().size(), kNone);
    std::transform(scan.nearest_m().begin(), scan.nearest_m().end(), image.range_m.begin(),
                   [](float range_m) { return range_m - kDiscrepancy * range_m; });
    for (const MapBlocks::Block& block : map.blocks) {
      const Eigen::Vector3f centre = T_lidar_local * block.centre;
      const float limit_m =
          (1.0F - kDiscrepancy) * 1.0001F * scan.farthest_behind(centre, block.radius_m);
      if (centre.norm() - block.radius_m > limit_m) continue;
      for (std::uint32_t i = block.begin; i < block.end; ++i) {
        const Eigen::Vector3f p = T_lidar_local * map.positions[i];
        if (p.squaredNorm() > limit_m * limit_m) continue;
        const Spherical direction = spherical_of(p);
        const int pixel = scan.pixel_of(direction);
        if (pixel < 0) continue;
        const auto at = static_cast<std::size_t>(pixel);
        if (!(direction.range_m < image.range_m[at])) continue;
        image.range_m[at] = direction.range_m;
        image.point[at] = i;
      }
    }
    for (const std::uint32_t point : image.point) {
      if (point != kNone) flags[point] = 1;
    }
  }

  void report() {
    const std::lock_guard lock(mutex_);
    ++done_;
    if (progress_) progress_("clean", done_, total_);
  }

  const ScanSource& scans_;
  const ProgressCallback& progress_;
  const CancelFlag& cancel_;
  std::size_t total_;
  std::size_t done_ = 0;
  std::mutex mutex_;
  std::vector<ScanImages> views_;
};

}  // namespace

std::vector<std::uint8_t> Removert::moved(const CleaningPoints& points, const ScanSource& scans,
                                          const ProgressCallback& progress,
                                          const CancelFlag& cancel) const {
  std::vector<std::uint8_t> dynamic(points.positions.size(), 0);
  const MapBlocks all = MapBlocks::of(points.positions, kBlockM);
  Run run(scans, progress, cancel);
  run.read_scans();
  std::size_t pass = 0;
  MapBlocks map = all;
  for (; pass < kRemovePixels.size(); ++pass) {
    run.object(map, pass, dynamic);
    std::vector<std::uint8_t> left(dynamic.size());
    std::transform(dynamic.begin(), dynamic.end(), left.begin(),
                   [](std::uint8_t flag) { return flag == 0 ? 1 : 0; });
    map = map.subset(left);
  }
  for (; pass < kPasses; ++pass) {
    const MapBlocks removed = all.subset(dynamic);
    std::fill(dynamic.begin(), dynamic.end(), std::uint8_t{0});
    run.object(removed, pass, dynamic);
  }
  return dynamic;
}

}  // namespace stillmap::mapping
