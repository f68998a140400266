#include "odometry/run_odometry.hpp"

#include "build/ordered_pipeline.hpp"

#include <fmt/format.h>

#include <memory>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

namespace stillmap::mapping {
namespace {

/// As many scans tell how the drive starts: half a second.
constexpr std::size_t kStartScans = 6;

struct PreparedScan {
  maps::Scan scan;
  std::unique_ptr<Odometry::Prepared> prepared;
};

/// The sweep as it would be if time ran backward.
maps::Scan reversed(maps::Scan scan) {
  scan.stamp_ns = -scan.stamp_ns;
  for (float& offset_s : scan.cloud.time_offsets_s) offset_s = -offset_s;
  return scan;
}

/// Motion at the first scan: the drive's first scans are followed backward by `default`, so that
/// there is a map and a speed when the first one's turn comes.
std::optional<Eigen::Matrix<double, 6, 1>> start_twist(std::size_t scans, const ReadScan& read) {
  if (scans < kStartScans) return std::nullopt;
  const std::unique_ptr<Odometry> backward = make_odometry(odometry_names().front());
  OdometryPose pose;
  for (std::size_t i = kStartScans; i-- > 0;)
    pose = backward->add(*backward->prepare(reversed(read(i))));
  if (pose.status == OdometryStatus::kPredicted) return std::nullopt;
  return -pose.twist_lidar;
}

}  // namespace

std::vector<OdometryPose> run_odometry(const FollowedDrive& followed, int threads,
                                       const ProgressCallback& progress, const CancelFlag& cancel) {
  const std::size_t all = followed.drive.size();
  if (followed.begin > followed.end || followed.end > all)
    throw std::invalid_argument(fmt::format("scans: found {} to {}, expected some of 0 to {}",
                                            followed.begin, followed.end, all));
  const std::size_t scans = followed.end - followed.begin;
  const std::unique_ptr<Odometry> odometry = make_odometry(followed.method);
  const auto read_scan = [&](std::size_t i) {
    const std::size_t scan = followed.begin + i;
    return followed.read ? followed.read(scan) : followed.drive.read(scan);
  };
  if (cancel) throw Cancelled();
  if (const auto twist = start_twist(scans, read_scan)) odometry->start_with(*twist);
  std::vector<OdometryPose> poses;
  poses.reserve(scans);
  process_in_order(
      scans, threads,
      [&](std::size_t i) {
        PreparedScan out;
        out.scan = read_scan(i);
        out.prepared = odometry->prepare(out.scan);
        return out;
      },
      [&](const PreparedScan& scan) {
        const std::size_t index = followed.begin + poses.size();
        if (followed.expects_given_poses && !poses.empty())
          odometry->expect(followed.drive.T_map_lidar(index - 1).inverse() *
                           followed.drive.T_map_lidar(index));
        poses.push_back(odometry->add(*scan.prepared));
        if (followed.take) followed.take(index, scan.scan, poses.back());
        if (progress) progress("odometry", poses.size(), scans);
      },
      cancel);
  return poses;
}

}  // namespace stillmap::mapping
