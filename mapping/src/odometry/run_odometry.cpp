#include "odometry/run_odometry.hpp"

#include "core/ordered_pipeline.hpp"
#include "odometry/hidden_gaps.hpp"

#include <stillmap/maps/imu.hpp>

#include <fmt/format.h>
#include <stillmap/localization/thinning.hpp>

#include <memory>
#include <optional>
#include <span>
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
  maps::turn_to_stamp(scan.cloud);
  scan.stamp_ns = -scan.stamp_ns;
  for (float& offset_s : scan.cloud.time_offsets_s) offset_s = -offset_s;
  return scan;
}

maps::Scan without_points(const maps::Scan& scan) {
  maps::Scan empty;
  empty.index = scan.index;
  empty.stamp_ns = scan.stamp_ns;
  empty.source = scan.source;
  return empty;
}

/// Methods expect the vehicle near the origin, where the reference stands. Other lidars meet it
/// farther away. As for one lidar, a quarter of all points is no vehicle.
maps::Scan without_own_vehicle(maps::Scan scan) {
  maps::PointCloud& cloud = scan.cloud;
  if (cloud.lidars.empty()) return scan;
  std::vector<std::uint8_t> keep(cloud.size());
  std::size_t kept = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    keep[i] = cloud.lidars[i] == 0 || cloud.ray(i).norm() >= localization::kOwnVehicleM ? 1 : 0;
    kept += keep[i];
  }
  if (4 * kept > 3 * cloud.size()) cloud.keep_only(keep);
  return scan;
}

/// Tells how the sensor turned from one scan to another, where the drive has an IMU.
void tell_turn(const maps::Drive& drive, std::size_t from, std::size_t to, Odometry& odometry) {
  const std::shared_ptr<const maps::Imu>& imu = drive.contents().imu;
  if (!imu || !imu->fit) return;
  const auto R_from_to = maps::turn_between_stamps(*imu->readings, *imu->fit, drive.stamp_ns(from),
                                                   drive.stamp_ns(to));
  if (R_from_to) odometry.turned(*R_from_to);
}

/// How a drive starts.
struct DriveStart {
  /// At the first scan.
  std::optional<Eigen::Matrix<double, 6, 1>> twist_lidar;
  /// The first scan shows nothing of what those after it see.
  bool first_is_hidden = false;
};

/// The scans of a drive's start, the last one first.
/// @param scans    of the drive. @param matched  how many of them fitted the others.
DriveStart followed_backward(const maps::Drive& drive, std::span<const maps::Scan> scans,
                             std::size_t& matched) {
  const std::unique_ptr<Odometry> backward = make_odometry(odometry_names().front());
  DriveStart start;
  matched = 0;
  for (std::size_t i = scans.size(); i-- > 0;) {
    maps::Scan scan = reversed(scans[i]);
    // Sent again: it was taken when the scan before it was.
    const bool is_again =
        i > 0 && !scan.cloud.empty() && scan.cloud.positions == scans[i - 1].cloud.positions;
    if (is_again) scan.cloud = {};
    if (i + 1 < scans.size()) tell_turn(drive, scans[i + 1].index, scan.index, *backward);
    const OdometryPose pose = backward->add(*backward->prepare(scan));
    if (pose.status != OdometryStatus::kPredicted) {
      ++matched;
      start.twist_lidar = -pose.twist_lidar;
    } else if (!pose.hidden && !is_again) {
      start.twist_lidar.reset();
    }
    start.first_is_hidden = pose.hidden;
  }
  return start;
}

/// The drive's first scans are followed backward by `default`, so that there is a map and a speed
/// when the first one's turn comes. The last of them may be the hidden one, which none of the
/// others fits; then the one before it comes first.
DriveStart start_of(const maps::Drive& drive, std::size_t scans, const ReadScan& read) {
  if (scans < kStartScans) return {};
  std::vector<maps::Scan> first;
  for (std::size_t i = 0; i < kStartScans; ++i) first.push_back(read(i));
  DriveStart best;
  std::size_t most = 0;
  for (std::size_t size = kStartScans; size > kStartScans / 2 && most < size / 2; --size) {
    std::size_t matched = 0;
    DriveStart start = followed_backward(drive, std::span(first).first(size), matched);
    if (size < kStartScans && matched <= most) continue;
    best = std::move(start);
    most = matched;
  }
  return best;
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
    return without_own_vehicle(followed.read ? followed.read(scan) : followed.drive.read(scan));
  };
  if (cancel) throw Cancelled();
  const DriveStart start = start_of(followed.drive, scans, read_scan);
  if (start.twist_lidar) odometry->start_with(*start.twist_lidar);
  std::vector<OdometryPose> poses;
  poses.reserve(scans);
  process_in_order(
      scans, threads,
      [&](std::size_t i) {
        PreparedScan out;
        out.scan = read_scan(i);
        // As one that saw nothing: the scans after it tell more.
        const bool is_hidden = i == 0 && start.first_is_hidden;
        out.prepared = odometry->prepare(is_hidden ? without_points(out.scan) : out.scan);
        return out;
      },
      [&](const PreparedScan& scan) {
        const std::size_t index = followed.begin + poses.size();
        if (followed.expects_given_poses && !poses.empty())
          odometry->expect(followed.drive.T_map_lidar(index - 1).inverse() *
                           followed.drive.T_map_lidar(index));
        if (!poses.empty()) tell_turn(followed.drive, index - 1, index, *odometry);
        poses.push_back(odometry->add(*scan.prepared));
        if (poses.size() == 1 && start.first_is_hidden) poses.front().hidden = true;
        if (followed.take) followed.take(index, scan.scan, poses.back());
        if (progress) progress("odometry", poses.size(), scans);
      },
      cancel);
  std::vector<std::int64_t> stamps_ns;
  for (std::size_t i = 0; i < scans; ++i)
    stamps_ns.push_back(followed.drive.stamp_ns(followed.begin + i));
  interpolate_hidden(stamps_ns, poses);
  return poses;
}

}  // namespace stillmap::mapping
