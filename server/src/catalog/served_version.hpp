#pragma once

#include "catalog/aligners.hpp"

#include <stillmap/localization/aligner.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace stillmap::server {

enum class MapState : std::uint8_t {
  kOpened,   ///< its points can be read; nobody has asked for poses
  kLoading,  ///< its package is being fetched, or its aligners are being made
  kReady,
  kFailed,
};

/// `localization::seen_from`, read when somebody asks first: loading a map does not wait for its
/// trajectories. Safe from several threads.
class SeenFrom {
 public:
  /// @throws maps::InputError, maps::StorageError: the package may have been removed meanwhile.
  [[nodiscard]] const std::vector<Eigen::Isometry3d>& poses(const maps::MapPackage& map) {
    read(map);
    return T_map_lidar_;
  }
  /// Distance from a place to the nearest of them [m], to half a metre; infinite without any.
  /// @throws as `poses`.
  [[nodiscard]] double distance_m(const maps::MapPackage& map, const Eigen::Vector3d& p_map) {
    read(map);
    double nearest_m2 = std::numeric_limits<double>::infinity();
    for (const Eigen::Vector3d& place : p_map_places_)
      nearest_m2 = std::min(nearest_m2, (place - p_map).squaredNorm());
    return std::sqrt(nearest_m2);
  }

 private:
  void read(const maps::MapPackage& map) {
    constexpr double kApartM = 0.5;
    std::call_once(once_, [&] {
      T_map_lidar_ = localization::seen_from(map);
      for (const Eigen::Isometry3d& T : T_map_lidar_)
        if (p_map_places_.empty() || (T.translation() - p_map_places_.back()).norm() > kApartM)
          p_map_places_.push_back(T.translation());
    });
  }

  std::once_flag once_;
  std::vector<Eigen::Isometry3d> T_map_lidar_;
  /// Without those where the vehicle stood.
  std::vector<Eigen::Vector3d> p_map_places_;
};

/// One version of a map as requests see it. Its tiles stay usable while it is held, whatever
/// becomes of the version meanwhile.
struct ServedVersion {
  std::string map;
  std::string version;
  /// Null while it is being fetched, and when it could not be opened.
  std::shared_ptr<const maps::MapPackage> package{};
  /// Of its package, as the store has it.
  std::string digest{};
  /// As of `PackageStore::copy_of`, before it was opened: what was made of a damaged copy is not
  /// what a mended one makes.
  std::uint64_t copy = 0;
  /// The map's, when this was found to be what it serves; 0 for a version that was asked for by
  /// its name.
  std::int64_t revision = 0;
  MapState state = MapState::kOpened;
  /// Why it failed; empty otherwise.
  std::string failure{};
  /// How scans are localized in it, filled when ready.
  localization::LocalizationOptions localization{};
  /// Filled when ready. Last: they use the package.
  std::shared_ptr<const Aligners> aligners{};
  /// When ready.
  std::shared_ptr<SeenFrom> seen_from{};

  /// Names what it holds, as no other content and no other copy of it does.
  [[nodiscard]] std::string content() const {
    return package->digest() + "@" + std::to_string(copy);
  }
};

}  // namespace stillmap::server
