#include <stillmap/maps/pose_disagreement.hpp>

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <sstream>
#include <string>

#include <stillmap/maps/package_files.hpp>

namespace stillmap::maps {

BentPlaces bent_places(std::span<const PoseDisagreement> of_pose) {
  constexpr float kBentM = 0.06F;
  BentPlaces bent;
  for (std::size_t pose = 0; pose < of_pose.size(); ++pose) {
    if (of_pose[pose].m > kBentM) ++bent.poses;
    if (!(of_pose[pose].m > bent.worst_m)) continue;
    bent.worst = pose;
    bent.worst_m = of_pose[pose].m;
  }
  return bent;
}

void write_pose_disagreements(const std::filesystem::path& package,
                              std::span<const PoseDisagreement> of_pose, std::size_t drive) {
  const std::filesystem::path file = package / disagreement_path(drive);
  std::ofstream out(file, std::ios::binary);
  for (const PoseDisagreement& each : of_pose)
    out << fmt::format("{:.4f} {:.5f}\n", each.m, each.rad);
  out << std::flush;
  if (!out) throw StorageError(file.string(), std::strerror(errno));
}

namespace {

/// Appends the lines of a file, one for each of so many poses.
void read_file(const std::filesystem::path& file, std::size_t poses,
               std::vector<PoseDisagreement>& found) {
  std::ifstream in(file, std::ios::binary);
  std::size_t lines = 0;
  for (std::string line; std::getline(in, line); ++lines) {
    std::istringstream numbers(line);
    PoseDisagreement each;
    const bool is_whole = (numbers >> each.m >> each.rad) && (numbers >> std::ws).eof();
    if (!is_whole || !(each.m >= 0.0F && each.rad >= 0.0F && std::isfinite(each.m + each.rad)))
      throw InputError(fmt::format("{}: line {}", file.string(), lines + 1), line,
                       "metres and radians, 0 or more");
    found.push_back(each);
  }
  if (lines != poses)
    throw InputError(file.string(), fmt::format("{} lines", lines),
                     fmt::format("one for each of the {} poses", poses));
}

}  // namespace

std::vector<PoseDisagreement> read_pose_disagreements(const MapPackage& map) {
  if (!map.manifest().files.contains(disagreement_path(0))) return {};
  std::vector<PoseDisagreement> found;
  std::size_t poses = 0, drive = 0;
  for (const Trajectory& trajectory : map.trajectories()) {
    // Schema 1 has one file for all drives.
    poses += trajectory.size();
    if (map.manifest().schema == 1) continue;
    read_file(map.folder() / disagreement_path(drive++), trajectory.size(), found);
  }
  if (map.manifest().schema == 1) read_file(map.folder() / disagreement_path(0), poses, found);
  return found;
}

}  // namespace stillmap::maps
