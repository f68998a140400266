#include "drives/drive_sample.hpp"

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/median.hpp>

#include <algorithm>

namespace stillmap::maps {
namespace {

constexpr std::size_t kSamples = 10;
constexpr std::size_t kFarthestPartner = 30;
constexpr double kApartM = 1.0;
constexpr double kApartRad = 0.0873;  // 5 deg
constexpr float kLeastRangeM = 2.0F;
constexpr float kMostRangeM = 40.0F;
constexpr double kAboveGroundM = 0.3;

bool lie_apart(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  const Eigen::Isometry3d T = a.inverse() * b;
  return T.translation().norm() >= kApartM || rotation_angle_rad(T.linear()) >= kApartRad;
}

double median_range_m(const PointCloud& cloud) {
  std::vector<float> ranges;
  for (const Eigen::Vector3f& p : cloud.positions) ranges.push_back(p.norm());
  if (ranges.empty()) return 0.0;
  return median(std::move(ranges));
}

StandingPoints standing_of(const PointCloud& cloud, const std::optional<GroundPlane>& ground) {
  StandingPoints standing;
  for (const Eigen::Vector3f& p : cloud.positions) {
    const float range_m = p.norm();
    if (!(range_m >= kLeastRangeM && range_m <= kMostRangeM)) continue;
    if (ground && ground->up.dot(p.cast<double>()) + ground->height_m < kAboveGroundM) continue;
    standing.push_back(p);
  }
  return standing;
}

}  // namespace

SampledScan sample_scan(const Drive& drive, std::size_t index) {
  const Scan scan = drive.read(index);
  SampledScan sample;
  sample.index = index;
  sample.ground = find_ground_plane(scan.cloud.positions);
  sample.standing = standing_of(scan.cloud, sample.ground);
  sample.median_range_m = median_range_m(scan.cloud);
  sample.points = scan.cloud.size();
  sample.points_in_file = scan.points_in_file;
  sample.has_times = scan.cloud.empty() || !scan.cloud.time_offsets_s.empty();
  sample.times_note = scan.times_note;
  const auto& intensities = scan.cloud.intensities;
  if (!intensities.empty()) {
    const auto [low, high] = std::minmax_element(intensities.begin(), intensities.end());
    sample.intensities = {*low, *high};
  }
  return sample;
}

StandingPoints standing_points(const PointCloud& cloud) {
  return standing_of(cloud, find_ground_plane(cloud.positions));
}

std::vector<SamplePair> choose_samples(const Drive& drive) {
  return choose_samples(drive.size(), [&](std::size_t i) {
    return drive.has_poses() ? std::optional(drive.T_map_lidar(i)) : std::nullopt;
  });
}

std::vector<SamplePair> choose_samples(
    std::size_t scans,
    const std::function<std::optional<Eigen::Isometry3d>(std::size_t)>& pose_of) {
  std::vector<SamplePair> pairs;
  const std::size_t count = std::min(kSamples, scans);
  for (std::size_t k = 0; k < count; ++k) {
    SamplePair pair{(2 * k + 1) * scans / (2 * count), std::nullopt};
    const std::size_t end = std::min(scans, pair.first + 1 + kFarthestPartner);
    const auto from = pose_of(pair.first);
    for (std::size_t i = pair.first + 1; from && i < end && !pair.second; ++i)
      if (const auto to = pose_of(i); to && lie_apart(*from, *to)) pair.second = i;
    pairs.push_back(pair);
  }
  return pairs;
}

}  // namespace stillmap::maps
