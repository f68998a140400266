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
                              std::span<const PoseDisagreement> of_pose) {
  const std::filesystem::path file = package / kDisagreementName;
  std::ofstream out(file, std::ios::binary);
  for (const PoseDisagreement& each : of_pose)
    out << fmt::format("{:.4f} {:.5f}\n", each.m, each.rad);
  out << std::flush;
  if (!out) throw StorageError(file.string(), std::strerror(errno));
}

std::vector<PoseDisagreement> read_pose_disagreements(const MapPackage& map) {
  if (!map.manifest().files.contains(kDisagreementName)) return {};
  const std::filesystem::path file = map.folder() / kDisagreementName;
  std::ifstream in(file, std::ios::binary);
  std::vector<PoseDisagreement> found;
  for (std::string line; std::getline(in, line);) {
    std::istringstream numbers(line);
    PoseDisagreement each;
    const bool is_whole = (numbers >> each.m >> each.rad) && (numbers >> std::ws).eof();
    if (!is_whole || !(each.m >= 0.0F && each.rad >= 0.0F && std::isfinite(each.m + each.rad)))
      throw InputError(fmt::format("{}: line {}", file.string(), found.size() + 1), line,
                       "metres and radians, 0 or more");
    found.push_back(each);
  }
  std::size_t poses = 0;
  for (const Trajectory& drive : map.trajectories()) poses += drive.poses().size();
  if (found.size() != poses)
    throw InputError(file.string(), fmt::format("{} lines", found.size()),
                     fmt::format("one for each of the map's {} poses", poses));
  return found;
}

}  // namespace stillmap::maps
