#pragma once

#include "catalog/map_catalog.hpp"
#include "http/session_events.hpp"
#include "pose/session_line.hpp"
#include "pose/set_poses.hpp"

#include <stillmap/localization/tracker.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <chrono>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace stillmap::server {

/// One vehicle that is followed through one version of a map, which it keeps loaded, or through the
/// maps of a set, of which it keeps the one loaded that it is in. Safe from several threads.
class Session {
 public:
  using Clock = std::chrono::steady_clock;

  /// Who follows what, and for whom.
  struct Name {
    /// The secret of whoever opened it.
    std::string id{};
    /// Key that opened it, empty without keys.
    std::string owner{};
    /// What operators see, and what roll-outs know the vehicle by; empty = operators see one made
    /// from the id, which cannot be found from it.
    std::string label{};
    /// Whether whoever opened it named the version.
    bool version_was_named = false;
    /// Whether a roll-out chose the version.
    bool is_rolled_out = false;
    /// Name of the set; empty: it stays in one map.
    std::string set{};
  };
  /// @param map  ready. In a set it may turn out to be in another one.
  Session(Name name, ServedVersion map, AlignmentQueue& queue);
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  [[nodiscard]] const std::string& id() const { return name_.id; }
  [[nodiscard]] const std::string& owner() const { return name_.owner; }
  [[nodiscard]] const std::string& label() const { return shown_label_; }
  /// As it was opened with; empty without one.
  [[nodiscard]] const std::string& vehicle() const { return name_.label; }
  [[nodiscard]] bool version_was_named() const { return name_.version_was_named; }
  [[nodiscard]] const std::string& set() const { return name_.set; }
  /// In which it is now.
  [[nodiscard]] ServedVersion map() const;
  [[nodiscard]] SessionLine& line() { return line_; }
  [[nodiscard]] SessionEvents& events() { return events_; }

  /// As the session's aligner thins a scan.
  [[nodiscard]] localization::ThinScan thin(const localization::ScanView& scan_lidar) const {
    return map().aligners->front().second->thin(scan_lidar);
  }
  struct Tracked {
    SetTrackedPose pose;
    /// In which it is.
    ServedVersion map;
  };
  /// As `track_in_set`; a change of status, and a hand-over, become events.
  [[nodiscard]] Tracked track(const SetOfRequest& set, const ScanInSet& scan);
  /// Forgets where the vehicle was. @param place  a prior with its covariance, in the frame of the
  /// set if there is one, or a fix in a set; nothing: the next scan is looked for everywhere. Waits
  /// for the scan that is being aligned; the one that waits behind it was sent from where the
  /// vehicle is not, and ends with kSuperseded.
  void initialize(const PlaceInSet& place);

  /// The map serves this version now; one that differs from the last one noted becomes an event.
  /// @param map  as of `map`; nothing happens when it is another one by now.
  void note_active_version(const std::string& map, const std::string& version);
  /// Whether the version of this map came with a roll-out that has ended otherwise than by its
  /// activation. @param map  as above.
  /// @param version  that the vehicle gets now. @param active  of the map.
  [[nodiscard]] bool lost_its_version(const std::string& map, const std::string& version,
                                      const std::string& active);
  /// Ends scans that wait and streams. @param reason  `deleted`, `expired` or `rolled_back`.
  void close(const std::string& reason);

  /// Where the vehicle was last.
  struct Place {
    std::int64_t stamp_ns = 0;
    Eigen::Isometry3d T_map_lidar = Eigen::Isometry3d::Identity();
    /// As `AlignmentResult::covariance`.
    Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
    double inlier_ratio = 0.0;
  };

  struct Summary {
    std::uint64_t scans = 0;
    std::optional<localization::PoseStatus> status{};
    std::vector<localization::Reason> reasons{};
    /// Of the newest scan that was not lost.
    std::optional<Place> place{};
    std::optional<std::int64_t> stamp_ns{};
    std::string active_version{};
    std::chrono::duration<double> idle{};
  };
  [[nodiscard]] Summary summary(Clock::time_point now) const;

  void touch(Clock::time_point now);
  [[nodiscard]] Clock::time_point last_used() const;

 private:
  void note(const Tracked& tracked);

  Name name_;
  std::string shown_label_;
  SessionLine line_;
  SessionEvents events_;
  /// Held while a scan is aligned.
  std::mutex tracker_mutex_;
  SetVehicle vehicle_;
  mutable std::mutex mutex_;
  /// That of the vehicle, for others.
  ServedVersion map_;
  Summary summary_;
  /// Of the scan that was the last to tell so.
  std::optional<std::int64_t> clock_set_back_ns_;
  Clock::time_point last_used_ = Clock::now();
};

}  // namespace stillmap::server
