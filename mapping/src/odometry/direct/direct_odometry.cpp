#include "odometry/direct/direct_odometry.hpp"

#include "odometry/direct/direct_follower.hpp"

#include <cstddef>
#include <optional>
#include <utility>

namespace stillmap::mapping {
namespace {

/// After this many hidden scans in a row that match the map of the one before them, odometry
/// restarts with that map.
constexpr std::size_t kAnewScans = 5;

/// Follows a sensor through its map; and, where scans do not fit there, through one of their own,
/// which is the map once it has proved to be one.
class DirectOdometry : public Odometry {
 public:
  [[nodiscard]] std::unique_ptr<Prepared> prepare(const maps::Scan& scan) const override {
    return std::make_unique<ThinnedScan>(thinned(scan));
  }
  void start_with(const DirectFollower::Vector6d& twist_lidar) override {
    follower_.start_with(twist_lidar);
  }
  void expect(const Eigen::Isometry3d& T_before_this) override {
    follower_.expect(T_before_this);
    if (candidate_) candidate_->expect(T_before_this);
  }
  void turned(const Eigen::Matrix3d& R_before_this) override {
    follower_.turned(R_before_this);
    if (candidate_) candidate_->turned(R_before_this);
  }
  [[nodiscard]] OdometryPose add(const Prepared& prepared) override;

 private:
  DirectFollower follower_;
  std::optional<DirectFollower> candidate_;
  /// Scans in a row that fit its map.
  std::size_t fitting_ = 0;
};

OdometryPose DirectOdometry::add(const Prepared& prepared) {
  const auto& scan = dynamic_cast<const ThinnedScan&>(prepared);
  OdometryPose pose = follower_.add(scan);
  if (!pose.hidden) candidate_.reset();
  if (!pose.hidden) return pose;
  if (scan.shell || scan.sparse.size() < DirectFollower::kMinPoints) {
    // It is placed by motion there too, so that the next one is looked for from there.
    if (candidate_) (void)candidate_->add(scan);
    return pose;
  }
  if (candidate_) {
    const OdometryPose beside = candidate_->add(scan);
    if (beside.status != OdometryStatus::kPredicted && candidate_->on_surfaces()) {
      if (++fitting_ < kAnewScans) return pose;
      follower_ = std::move(*candidate_);
      candidate_.reset();
      pose.T_odom_lidar = beside.T_odom_lidar;
      pose.twist_lidar = beside.twist_lidar;
      pose.hidden = false;
      pose.begins_anew = true;
      return pose;
    }
  }
  candidate_.emplace(pose.T_odom_lidar);
  candidate_->start_with(pose.twist_lidar);
  (void)candidate_->add(scan);
  fitting_ = 0;
  return pose;
}

}  // namespace

std::unique_ptr<Odometry> make_direct_odometry() { return std::make_unique<DirectOdometry>(); }

}  // namespace stillmap::mapping
