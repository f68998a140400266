#include "reference/removert.hpp"

#include "reference/map_blocks.hpp"
#include "reference/range_image.hpp"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <limits>
#include <mutex>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Pixel edges of the passes in ring spacings; the last one reverts.
constexpr std::array kPixels = {1.0, 2.5 / 2.2, 1.25, 1.375};
constexpr std::size_t kRevert = kPixels.size() - 1;
/// Smallest discrepancy that counts, over the scan's range.
constexpr float kDiscrepancy = 0.05F;
/// Smaller blocks are culled better, larger ones are fewer [m].
constexpr double kBlockM = 1.0;
/// No sensor has rings further apart [rad].
constexpr double kLargestSpacingRad = 0.1;

struct ScanImages {
  Eigen::Isometry3f T_lidar_local = Eigen::Isometry3f::Identity();
  /// One a pass.
  std::array<RangeImage, kPixels.size()> images;
};

/// What scans say about a point of the map.
enum Verdict : std::uint8_t { kNotCompared = 0, kObjected = 1, kAgreed = 2 };

/// What is nearest in each pixel of the map.
struct MapImage {
  std::vector<float> range_m;
  std::vector<std::uint32_t> point;
};

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

std::vector<Spherical> directions_of(const PosedScan& scan) {
  std::vector<Spherical> result;
  result.reserve(scan.positions.size());
  Directions directions;
  for (std::size_t begin = 0; begin < scan.positions.size(); begin += Directions::kMost) {
    const std::size_t count = std::min(scan.positions.size() - begin, Directions::kMost);
    directions.set(Eigen::Isometry3f::Identity(), scan.positions.data() + begin, count);
    for (std::size_t i = 0; i < count; ++i) result.push_back(directions[i]);
  }
  return result;
}

class Run {
 public:
  Run(const ScanSource& scans, const ProgressCallback& progress, const CancelFlag& cancel)
      : scans_(scans),
        progress_(progress),
        cancel_(cancel),
        total_(scans.size() * (1 + kPixels.size())) {}

  void read_scans() {
    const double spacing_rad = std::min(find_spacing(), kLargestSpacingRad);
    views_.resize(scans_.size());
    tbb::parallel_for(std::size_t{0}, scans_.size(), [&](std::size_t i) {
      if (cancel_) throw Cancelled();
      const PosedScan scan = scans_.read(i);
      const std::vector<Spherical> directions = directions_of(scan);
      views_[i].T_lidar_local = scan.T_local_lidar.inverse().cast<float>();
      for (std::size_t pass = 0; pass < kPixels.size(); ++pass) {
        views_[i].images[pass] = RangeImage(directions, kPixels[pass] * spacing_rad);
      }
      report();
    });
  }

  /// All scans against a map. @return the verdicts, joined bit by bit, in the order of the map.
  std::vector<std::uint8_t> compare(const MapBlocks& map, std::size_t pass) {
    tbb::enumerable_thread_specific<std::vector<std::uint8_t>> of_threads(
        [&] { return std::vector<std::uint8_t>(map.positions.size(), kNotCompared); });
    tbb::enumerable_thread_specific<MapImage> images;
    tbb::parallel_for(std::size_t{0}, views_.size(), [&](std::size_t i) {
      if (cancel_) throw Cancelled();
      compare_scan(map, views_[i].T_lidar_local, views_[i].images[pass], pass == kRevert,
                   images.local(), of_threads.local());
      report();
    });
    std::vector<std::uint8_t> verdicts(map.positions.size(), kNotCompared);
    for (const std::vector<std::uint8_t>& some : of_threads) {
      for (std::size_t i = 0; i < some.size(); ++i) verdicts[i] |= some[i];
    }
    return verdicts;
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

  /// @param with_agreement  whether agreement matters, or objections only.
  static void compare_scan(const MapBlocks& map, const Eigen::Isometry3f& T_lidar_local,
                           const RangeImage& scan, bool with_agreement, MapImage& image,
                           std::vector<std::uint8_t>& verdicts) {
    // A pixel starts at the range from which on a map point does not matter, so that only nearer
    // ones get in.
    const float reach = 1.0F + (with_agreement ? kDiscrepancy : -kDiscrepancy);
    image.range_m.resize(scan.nearest_m().size());
    image.point.assign(scan.nearest_m().size(), kNone);
    std::transform(scan.nearest_m().begin(), scan.nearest_m().end(), image.range_m.begin(),
                   [reach](float range_m) { return reach * range_m; });
    const float margin = 1.0001F * reach;
    const Eigen::Matrix3f R_abs = T_lidar_local.linear().cwiseAbs();
    for (const MapBlocks::Block& block : map.blocks) {
      const Eigen::Vector3f centre = T_lidar_local * block.centre;
      const Eigen::Vector3f half_edge = R_abs * block.half_edge;
      const float nearest_m = (centre.cwiseAbs() - half_edge).cwiseMax(0.0F).norm();
      if (nearest_m > margin * scan.farthest_m()) continue;
      if (nearest_m > margin * scan.farthest_behind(centre, half_edge)) continue;
      project(map, block, T_lidar_local, scan, image);
    }
    for (std::size_t pixel = 0; pixel < image.point.size(); ++pixel) {
      if (image.point[pixel] == kNone) continue;
      const float scan_m = scan.nearest_m()[pixel];
      const bool objects = scan_m - image.range_m[pixel] > kDiscrepancy * scan_m;
      verdicts[image.point[pixel]] |= objects ? kObjected : kAgreed;
    }
  }

  static void project(const MapBlocks& map, const MapBlocks::Block& block,
                      const Eigen::Isometry3f& T_lidar_local, const RangeImage& scan,
                      MapImage& image) {
    Directions directions;
    for (std::uint32_t begin = block.begin; begin < block.end;) {
      const std::size_t count = std::min<std::size_t>(block.end - begin, Directions::kMost);
      directions.set(T_lidar_local, map.positions.data() + begin, count);
      for (std::size_t i = 0; i < count; ++i) {
        const int pixel = scan.pixel_of(directions[i]);
        if (pixel < 0) continue;
        const auto at = static_cast<std::size_t>(pixel);
        if (!(directions[i].range_m < image.range_m[at])) continue;
        image.range_m[at] = directions[i].range_m;
        image.point[at] = begin + static_cast<std::uint32_t>(i);
      }
      begin += static_cast<std::uint32_t>(count);
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
  MapBlocks map = all;
  for (std::size_t pass = 0; pass < kRevert; ++pass) {
    const std::vector<std::uint8_t> verdicts = run.compare(map, pass);
    std::vector<std::uint8_t> stays(dynamic.size(), 0);
    for (std::size_t i = 0; i < verdicts.size(); ++i) {
      const bool objected = (verdicts[i] & kObjected) != 0;
      (objected ? dynamic : stays)[map.given_index[i]] = 1;
    }
    map = map.subset(stays);
  }
  map = all.subset(dynamic);
  const std::vector<std::uint8_t> verdicts = run.compare(map, kRevert);
  for (std::size_t i = 0; i < verdicts.size(); ++i) {
    if (verdicts[i] == kAgreed) dynamic[map.given_index[i]] = 0;
  }
  return dynamic;
}

}  // namespace stillmap::mapping
