#include "reference/removert.hpp"

#include "reference/map_blocks.hpp"
#include "reference/range_image.hpp"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <limits>
#include <mutex>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Pixel edges in ring spacings.
constexpr double kRemovePixel = 1.0;
constexpr double kRevertPixel = 1.0 / 0.95;
/// Reading the scans, removing, reverting, removing.
constexpr std::size_t kRounds = 4;
/// Smallest discrepancy that counts, over the scan's range.
constexpr float kDiscrepancy = 0.05F;
/// Smaller blocks are culled better, larger ones are fewer [m].
constexpr double kBlockM = 1.0;
/// No sensor has rings further apart [rad].
constexpr double kLargestSpacingRad = 0.1;

struct ScanImages {
  Eigen::Isometry3f T_lidar_local = Eigen::Isometry3f::Identity();
  RangeImage fine;
  RangeImage coarse;
};
using ImageOfScan = RangeImage ScanImages::*;

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

std::vector<std::uint8_t> inverse_of(std::vector<std::uint8_t> flags) {
  for (std::uint8_t& flag : flags) flag = flag == 0 ? 1 : 0;
  return flags;
}

class Run {
 public:
  Run(const ScanSource& scans, const ProgressCallback& progress, const CancelFlag& cancel)
      : scans_(scans), progress_(progress), cancel_(cancel), total_(scans.size() * kRounds) {}

  void read_scans() {
    const double spacing_rad = std::min(find_spacing(), kLargestSpacingRad);
    views_.resize(scans_.size());
    tbb::parallel_for(std::size_t{0}, scans_.size(), [&](std::size_t i) {
      if (cancel_) throw Cancelled();
      const PosedScan scan = scans_.read(i);
      const std::vector<Spherical> directions = directions_of(scan);
      views_[i].T_lidar_local = scan.T_local_lidar.inverse().cast<float>();
      views_[i].fine = RangeImage(directions, kRemovePixel * spacing_rad);
      views_[i].coarse = RangeImage(directions, kRevertPixel * spacing_rad);
      report();
    });
  }

  /// Points that stand in front of what some scan saw, sets their flags.
  void object(const MapBlocks& map, ImageOfScan image_of_scan, std::vector<std::uint8_t>& dynamic) {
    tbb::enumerable_thread_specific<std::vector<std::uint8_t>> flags(
        [&] { return std::vector<std::uint8_t>(map.positions.size(), 0); });
    tbb::enumerable_thread_specific<MapImage> images;
    tbb::parallel_for(std::size_t{0}, views_.size(), [&](std::size_t i) {
      if (cancel_) throw Cancelled();
      object_of_scan(map, views_[i].T_lidar_local, views_[i].*image_of_scan, images.local(),
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
  run.object(all, &ScanImages::fine, dynamic);
  const MapBlocks removed = all.subset(dynamic);
  std::fill(dynamic.begin(), dynamic.end(), std::uint8_t{0});
  run.object(removed, &ScanImages::coarse, dynamic);
  run.object(all.subset(inverse_of(dynamic)), &ScanImages::fine, dynamic);
  return dynamic;
}

}  // namespace stillmap::mapping
