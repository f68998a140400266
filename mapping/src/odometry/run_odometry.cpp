#include "odometry/run_odometry.hpp"

#include "build/ordered_pipeline.hpp"

#include <fmt/format.h>

#include <time.h>

#include <algorithm>
#include <chrono>
#include <memory>
#include <optional>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

/// As many scans tell how the drive starts: half a second.
constexpr std::size_t kStartScans = 6;

/// CPU time of this thread: unlike the wall's it does not count what others do meanwhile.
double thread_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

struct PreparedScan {
  maps::Scan scan;
  std::unique_ptr<Odometry::Prepared> prepared;
  double seconds = 0.0;
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
  const std::unique_ptr<Odometry> backward = make_odometry(odometry_names().front());
  OdometryPose pose;
  for (std::size_t i = std::min(scans, kStartScans); i-- > 0;)
    pose = backward->add(*backward->prepare(reversed(read(i))));
  if (scans < kStartScans || pose.status == OdometryStatus::kPredicted) return std::nullopt;
  return -pose.twist_lidar;
}

}  // namespace

OdometryRun run_odometry(const maps::Drive& drive, std::size_t begin, std::size_t end,
                         std::string_view method, int threads, const ProgressCallback& progress,
                         const CancelFlag& cancel, const ReadScan& read,
                         const TakePlacedScan& take) {
  if (begin > end || end > drive.size()) {
    throw std::invalid_argument(
        fmt::format("scans: found {} to {}, expected some of 0 to {}", begin, end, drive.size()));
  }
  const auto started = std::chrono::steady_clock::now();
  const std::unique_ptr<Odometry> odometry = make_odometry(method);
  const auto read_scan = [&](std::size_t i) {
    return read ? read(begin + i) : drive.read(begin + i);
  };
  if (cancel) throw Cancelled();
  if (const auto twist = start_twist(end - begin, read_scan)) odometry->start_with(*twist);
  OdometryRun run;
  run.poses.reserve(end - begin);
  process_in_order(
      end - begin, threads,
      [&](std::size_t i) {
        PreparedScan out;
        out.scan = read_scan(i);
        const double before = thread_seconds();
        out.prepared = odometry->prepare(out.scan);
        out.seconds = thread_seconds() - before;
        return out;
      },
      [&](const PreparedScan& scan) {
        const double before = thread_seconds();
        run.poses.push_back(odometry->add(*scan.prepared));
        run.add_seconds += thread_seconds() - before;
        run.prepare_seconds += scan.seconds;
        if (take) take(begin + run.poses.size() - 1, scan.scan, run.poses.back());
        if (progress) progress("odometry", run.poses.size(), end - begin);
      },
      cancel);
  run.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  return run;
}

}  // namespace stillmap::mapping
