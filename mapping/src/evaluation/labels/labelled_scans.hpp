#pragma once

#include "evaluation/labels/map_voxels.hpp"
#include "evaluation/labels/semantic_classes.hpp"
#include "evaluation/labels/true_ground.hpp"

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace stillmap::mapping {

/// What became of a scan's point in the unthinned map.
enum class InMap : std::uint8_t {
  kGone,       ///< deleted, or cleaned away
  kMeasured,   ///< there as it was measured
  kProjected,  ///< there, moved to the ground
};

/// The labelled points of one scan, those that the build dropped left out. N entries each.
struct LabelledScan {
  /// From the map's origin, map frame [m].
  Eigen::Vector3f sensor = Eigen::Vector3f::Zero();
  std::vector<Eigen::Vector3f> positions;
  std::vector<ClassIndex> classes;
  /// 1 = within 50 m of the sensor.
  std::vector<std::uint8_t> is_near;
  /// All `kGone` for a drive that is not in the map.
  std::vector<InMap> in_map;
  /// 1 = the build found it to be ground. Likewise.
  std::vector<std::uint8_t> is_ground;
  /// Of points of parked objects: over the true ground [m], NaN where that is not known; else 0.
  std::vector<float> heights_m;
  /// Left out.
  std::size_t dropped = 0;

  [[nodiscard]] std::size_t size() const { return positions.size(); }
};

/// The labelled scans of a drive as a map's build took them: same ranges, deskewing and poses.
/// Those that are in the map, or all of a drive that is not.
class LabelledScans {
 public:
  /// @throws maps::InputError when the drive has no labels, is not in the map and has no poses, or
  /// the map does not say what a build says.
  LabelledScans(const maps::MapPackage& map, const maps::Drive& drive, DriveTruth& truth);

  [[nodiscard]] std::size_t size() const { return scans_.size(); }
  [[nodiscard]] bool drive_in_map() const { return in_map_; }
  [[nodiscard]] std::size_t index(std::size_t scan) const { return scans_.at(scan).index; }
  [[nodiscard]] const Eigen::Isometry3d& T_map_lidar(std::size_t scan) const {
    return scans_.at(scan).T_map_lidar;
  }
  /// T that takes map points to the frame of the true ground, at a scan.
  [[nodiscard]] Eigen::Isometry3d T_truth_map(std::size_t scan) const;

  /// What is worth its time to find out of a scan.
  enum class Depth {
    kPositions,  ///< without `in_map`, `is_ground` and `heights_m`, which are empty
    kPlaces,     ///< without `heights_m`
    kAll,
  };
  /// @throws maps::InputError for labels that are no classes, counts that differ and the like.
  [[nodiscard]] LabelledScan read(std::size_t scan, Depth depth) const;

 private:
  struct Entry {
    /// In the drive, and over all drives of the map.
    std::size_t index = 0;
    std::size_t ordinal = 0;
    Eigen::Isometry3d T_map_lidar = Eigen::Isometry3d::Identity();
  };
  [[nodiscard]] std::vector<Entry> scans_in_map() const;
  [[nodiscard]] std::vector<Entry> all_scans() const;
  [[nodiscard]] std::vector<maps::PointFate> fates_of(const Entry& entry,
                                                      const maps::Scan& scan) const;
  [[nodiscard]] float parked_height_m(ClassIndex index, const Eigen::Vector3d& p_truth) const;
  [[nodiscard]] std::vector<std::uint32_t> labels_of(const maps::Scan& scan) const;
  void collect_labelled_ground();

  const maps::MapPackage& map_;
  const maps::Drive& drive_;
  DriveTruth& truth_;
  MapVoxels voxels_;
  std::array<double, 2> range_m_;
  bool in_map_ = false;
  std::vector<Entry> scans_;
};

/// Number of an option of a build. @throws maps::InputError naming the map when there is none.
[[nodiscard]] double number_option(const maps::MapPackage& map, const std::string& name);

}  // namespace stillmap::mapping
