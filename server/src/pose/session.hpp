#pragma once

#include "catalog/map_catalog.hpp"
#include "pose/session_events.hpp"
#include "pose/session_line.hpp"

#include <stillmap/localization/tracker.hpp>

#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>

namespace stillmap::server {

/// One vehicle that is followed through one version of a map, which it keeps loaded. Safe from
/// several threads.
class Session {
 public:
  using Clock = std::chrono::steady_clock;

  /// @param map  ready. @param owner  key that opened it, empty without keys.
  Session(std::string id, std::string owner, ServedVersion map, AlignmentQueue& queue);
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  [[nodiscard]] const std::string& id() const { return id_; }
  [[nodiscard]] const std::string& owner() const { return owner_; }
  [[nodiscard]] const ServedVersion& map() const { return map_; }
  [[nodiscard]] SessionLine& line() { return line_; }
  [[nodiscard]] SessionEvents& events() { return events_; }

  /// As `Tracker::track`; a change of status becomes an event.
  [[nodiscard]] localization::TrackedPose track(
      std::int64_t stamp_ns, const maps::PointCloud& scan_lidar,
      const std::optional<localization::OdometryStep>& odometry);
  /// Forgets where the vehicle was. @param prior  with its covariance; none: the next scan is
  /// looked for everywhere. Waits for the scan that is being aligned.
  void initialize(const std::optional<localization::Prior>& prior);

  /// The map serves this version now; one that differs from the last one noted becomes an event.
  void note_active_version(const std::string& version);
  /// Ends scans that wait and streams. @param reason  `deleted` or `expired`.
  void close(const std::string& reason);

  struct Summary {
    std::uint64_t scans = 0;
    std::optional<localization::PoseStatus> status{};
    std::optional<std::int64_t> stamp_ns{};
    std::string active_version{};
    std::chrono::duration<double> idle{};
  };
  [[nodiscard]] Summary summary(Clock::time_point now) const;

  void touch(Clock::time_point now);
  [[nodiscard]] Clock::time_point last_used() const;

 private:
  std::string id_;
  std::string owner_;
  ServedVersion map_;
  SessionLine line_;
  SessionEvents events_;
  /// Held while a scan is aligned.
  std::mutex tracker_mutex_;
  localization::Tracker tracker_;
  mutable std::mutex mutex_;
  Summary summary_;
  Clock::time_point last_used_ = Clock::now();
};

}  // namespace stillmap::server
