#pragma once

#include <stillmap/maps/map_package.hpp>

#include <cstddef>
#include <filesystem>
#include <span>
#include <vector>

namespace stillmap::maps {

/// How far the pose of a scan disagrees with the poses around it, as the motion between their scans
/// tells.
struct PoseDisagreement {
  float m = 0.0F;
  float rad = 0.0F;

  /// Of a point so far from the sensor [m].
  [[nodiscard]] float at(float range_m) const { return m + rad * range_m; }
};

/// Where a map is bent or torn: where its poses disagree by more than 0.06 m with the motion
/// between the scans over 10 m. Odometry, which tells the motion, is off by 0.5 cm in simulated
/// drives, by up to 3.2 cm in real ones.
struct BentPlaces {
  std::size_t poses = 0;
  /// The pose that disagrees most, and by how much.
  std::size_t worst = 0;
  float worst_m = 0.0F;
};
[[nodiscard]] BentPlaces bent_places(std::span<const PoseDisagreement> of_pose);

/// Writes disagreement.txt (of further drives disagreement_2.txt, ...) into the folder of a package
/// that is being made: a line a pose, metres and radians.
/// @param of_pose  one a pose of the drive, finite and not negative. @param drive  from 0.
/// @throws StorageError.
void write_pose_disagreements(const std::filesystem::path& package,
                              std::span<const PoseDisagreement> of_pose, std::size_t drive = 0);

/// One a pose of the map, as `MapPackage::trajectories` numbers them; empty when the package lists
/// none: an older program made it, or another one.
/// @throws InputError for a broken file, and for another number than the map has poses.
[[nodiscard]] std::vector<PoseDisagreement> read_pose_disagreements(const MapPackage& map);

}  // namespace stillmap::maps
