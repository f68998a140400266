#include <fmt/format.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <iterator>
#include <string>

#include "exports/exporters.hpp"
#include "exports/output_file.hpp"

namespace stillmap::maps {
namespace {

Trajectory chosen_trajectory(ExportJob& job) {
  const std::vector<Trajectory> trajectories = job.map.trajectories();
  const std::string name = job.map.folder().string();
  if (trajectories.empty())
    throw InputError(name, "no trajectory",
                     "a map that was built from a drive: choose another format");
  if (!job.options.drive && trajectories.size() > 1)
    throw InputError(
        name, fmt::format("{} trajectories", trajectories.size()),
        fmt::format("one: choose it with --drive, from 0 to {}", trajectories.size() - 1));
  const std::size_t drive = job.options.drive.value_or(0);
  if (drive >= trajectories.size())
    throw InputError(name, fmt::format("drive {}", drive),
                     fmt::format("0 to {}", trajectories.size() - 1));
  std::vector<StampedPose> poses = trajectories[drive].poses();
  for (StampedPose& pose : poses) pose.T_map_lidar.translation() -= job.result.origin;
  job.result.counts["poses"] = poses.size();
  return Trajectory(std::move(poses));
}

}  // namespace

void export_kitti(ExportJob& job) {
  const Trajectory trajectory = chosen_trajectory(job);
  OutputFile file(job.target);
  for (const StampedPose& pose : trajectory.poses()) {
    std::string line;
    for (Eigen::Index row = 0; row < 3; ++row)
      for (Eigen::Index column = 0; column < 4; ++column)
        fmt::format_to(std::back_inserter(line), "{}{}", line.empty() ? "" : " ",
                       pose.T_map_lidar.matrix()(row, column));
    file.write(line + "\n");
  }
  file.close();
}

void export_tum(ExportJob& job) { write_tum_trajectory(job.target, chosen_trajectory(job)); }

}  // namespace stillmap::maps
