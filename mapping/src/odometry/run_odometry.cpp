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

std::vector<OdometryPose> run_odometry(const maps::Drive& drive, std::size_t begin, std::size_t end,
                                       std::string_view method, int threads,
                                       const ProgressCallback& progress, const CancelFlag& cancel,
                                       const ReadScan& read, const TakePlacedScan& take) {
  if (begin > end || end > drive.size()) {
    throw std::invalid_argument(
        fmt::format("scans: found {} to {}, expected some of 0 to {}", begin, end, drive.size()));
  }
  const std::unique_ptr<Odometry> odometry = make_odometry(method);
  const auto read_scan = [&](std::size_t i) {
    return read ? read(begin + i) : drive.read(begin + i);
  };
  if (cancel) throw Cancelled();
  if (const auto twist = start_twist(end - begin, read_scan)) odometry->start_with(*twist);
  std::vector<OdometryPose> poses;
  poses.reserve(end - begin);
  process_in_order(
      end - begin, threads,
      [&](std::size_t i) {
        PreparedScan out;
        out.scan = read_scan(i);
        out.prepared = odometry->prepare(out.scan);
        return out;
      },
      [&](const PreparedScan& scan) {
        poses.push_back(odometry->add(*scan.prepared));
        if (take) take(begin + poses.size() - 1, scan.scan, poses.back());
        if (progress) progress("odometry", poses.size(), end - begin);
      },
      cancel);
  return poses;
}

}  // namespace stillmap::mapping
