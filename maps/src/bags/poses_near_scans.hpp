#pragma once

#include <stillmap/maps/trajectory.hpp>

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

namespace stillmap::maps {

/// Out of poses in any number and order, those that interpolation to some stamps needs: the last at
/// or before each stamp and the first behind it, and the two at either end. Memory grows with the
/// stamps, and no faster than with the poses.
class PosesNearScans {
 public:
  /// @param stamps_ns  of the scans, in any order.
  explicit PosesNearScans(std::vector<std::int64_t> stamps_ns);
  void add(std::int64_t stamp_ns, const Eigen::Isometry3d& T);
  /// Of equal stamps the pose that came first.
  [[nodiscard]] Trajectory trajectory() const;
  [[nodiscard]] std::size_t added() const { return added_; }

 private:
  /// Between two stamps of scans, the upper one included.
  struct Gap {
    std::optional<StampedPose> first;
    std::optional<StampedPose> last;
  };
  void keep_ends(const StampedPose& pose);

  std::vector<std::int64_t> stamps_ns_;
  /// By the number of the upper one; those with poses.
  std::map<std::size_t, Gap> gaps_;
  /// The two earliest and the two latest of all, in their order.
  std::vector<StampedPose> earliest_;
  std::vector<StampedPose> latest_;
  std::size_t added_ = 0;
};

}  // namespace stillmap::maps
