#include "trajectory/drive_of_map.hpp"

#include <stillmap/maps/frames.hpp>

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <map>
#include <string>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Between poses so near in time a path is smooth, and better known than the drive's own poses.
constexpr std::int64_t kNearNs = 500'000'000;

/// Motions of the path and of the drive's own poses that differ by less are the same [m, rad].
constexpr double kSameMotionM = 1e-3;
constexpr double kSameMotionRad = 1e-4;

std::optional<std::size_t> index_at(const maps::Drive& drive, std::int64_t stamp_ns) {
  const auto& stamps = drive.contents().stamps_ns;
  const auto at = std::ranges::lower_bound(stamps, stamp_ns);
  if (at == stamps.end() || *at != stamp_ns) return std::nullopt;
  return static_cast<std::size_t>(at - stamps.begin());
}

/// Whether the path moves between two of its poses as the drive's own poses do.
bool keeps_motion(const maps::Drive& drive, const maps::StampedPose& from,
                  const maps::StampedPose& to) {
  const auto own_from = index_at(drive, from.stamp_ns), own_to = index_at(drive, to.stamp_ns);
  if (!own_from || !own_to) return false;
  const Eigen::Isometry3d T_own =
      drive.T_map_lidar(*own_from).inverse() * drive.T_map_lidar(*own_to);
  const Eigen::Isometry3d T = T_own.inverse() * (from.T_map_lidar.inverse() * to.T_map_lidar);
  return T.translation().norm() < kSameMotionM &&
         maps::rotation_angle_rad(T.linear()) < kSameMotionRad;
}

/// Lines "SHA-256  NAME" of all scans of the map, in their order; empty when it lists none.
std::vector<std::string> scan_sources(const maps::MapPackage& map) {
  std::ifstream in(map.folder() / "sources.sha256");
  std::vector<std::string> lines;
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

std::string source_line(const maps::Drive& drive, std::size_t index) {
  return drive.sha256(index) + "  " + drive.contents().scan_name(index);
}

/// Index in the drive of each pose; empty when one has no scan.
std::vector<std::size_t> indices_of(const maps::Trajectory& path, const maps::Drive& drive) {
  std::map<std::int64_t, std::size_t> by_stamp;
  for (std::size_t i = 0; i < drive.size(); ++i) by_stamp.emplace(drive.stamp_ns(i), i);
  std::vector<std::size_t> indices;
  for (const maps::StampedPose& pose : path.poses()) {
    const auto found = by_stamp.find(pose.stamp_ns);
    if (found == by_stamp.end()) return {};
    indices.push_back(found->second);
  }
  return indices;
}

}  // namespace

std::optional<DriveOfMap> find_in_map(const maps::MapPackage& map, const maps::Drive& drive) {
  const std::vector<std::string> sources = scan_sources(map);
  std::size_t ordinal = 0;
  for (const maps::Trajectory& path : map.trajectories()) {
    std::vector<std::size_t> indices = indices_of(path, drive);
    bool same = !indices.empty();
    // Days of one world have the same stamps and names; three scans tell them apart.
    for (const std::size_t at : {std::size_t{0}, indices.size() / 2, indices.size() - 1}) {
      if (!same || sources.empty()) break;
      same =
          ordinal + at < sources.size() && sources[ordinal + at] == source_line(drive, indices[at]);
    }
    if (same) return DriveOfMap{path, ordinal, std::move(indices)};
    ordinal += path.size();
  }
  return std::nullopt;
}

maps::Drive on_path(const maps::Drive& drive, const maps::Trajectory& path) {
  const auto& known = path.poses();
  const auto pose_of = [&](std::size_t scan) {
    const std::int64_t stamp_ns = drive.stamp_ns(scan);
    const std::int64_t within_ns =
        std::clamp(stamp_ns, known.front().stamp_ns, known.back().stamp_ns);
    const auto after = std::ranges::lower_bound(known, within_ns, {}, &maps::StampedPose::stamp_ns);
    if (after->stamp_ns == stamp_ns) return after->T_map_lidar;
    const auto next_before = after == known.begin() ? after : after - 1;
    const bool is_near =
        stamp_ns == within_ns && after->stamp_ns - next_before->stamp_ns <= kNearNs;
    if (!drive.has_poses() || (is_near && !keeps_motion(drive, *next_before, *after)))
      return path.at(within_ns).value();
    // Its own motion from a scan of the path that stamps find again.
    const auto followed = [&](const maps::StampedPose& pose) -> std::optional<Eigen::Isometry3d> {
      const auto index = index_at(drive, pose.stamp_ns);
      if (!index) return std::nullopt;
      return pose.T_map_lidar * (drive.T_map_lidar(*index).inverse() * drive.T_map_lidar(scan));
    };
    const auto before = after == known.begin() || after->stamp_ns <= stamp_ns ? after : after - 1;
    const auto from_before = followed(*before);
    const auto from_after = followed(*after);
    if (!from_before || !from_after) return path.at(within_ns).value();
    if (before == after) return maps::renormalized(*from_before);
    const double share = static_cast<double>(stamp_ns - before->stamp_ns) /
                         static_cast<double>(after->stamp_ns - before->stamp_ns);
    return maps::renormalized(*from_before *
                              maps::exp_se3(share * maps::log_se3(maps::renormalized(
                                                        from_before->inverse() * *from_after))));
  };
  std::vector<Eigen::Isometry3d> poses;
  for (std::size_t scan = 0; scan < drive.size(); ++scan) poses.push_back(pose_of(scan));
  return drive.with_poses(std::move(poses), std::nullopt);
}

}  // namespace stillmap::mapping
