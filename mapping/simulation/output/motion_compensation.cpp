#include "output/motion_compensation.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::simulation {
namespace {

constexpr double kStepS = 0.002;

/// Where the lidar is every other millisecond around the stamp, seen from where it is at the stamp.
class NearbyPath {
 public:
  NearbyPath(const TruePath& T_world_lidar, double stamp_s, float first_s, float last_s)
      : first_step_(static_cast<long>(std::floor(first_s / kStepS))) {
    const Eigen::Isometry3d T_stamp_world = T_world_lidar(stamp_s).inverse();
    const long last_step = static_cast<long>(std::floor(last_s / kStepS)) + 1;
    for (long step = first_step_; step <= last_step; ++step) {
      const Eigen::Isometry3d T =
          T_stamp_world * T_world_lidar(stamp_s + kStepS * static_cast<double>(step));
      nodes_.push_back({T.translation(), Eigen::Quaterniond(T.linear())});
      // Of the two quaternions of a rotation, the one near the last.
      Eigen::Quaterniond& q = nodes_.back().rotation;
      if (nodes_.size() > 1 && q.dot(nodes_[nodes_.size() - 2].rotation) < 0.0) q.coeffs() *= -1.0;
    }
  }

  [[nodiscard]] Eigen::Vector3d moved(const Eigen::Vector3d& p, double time_s) const {
    const double steps = time_s / kStepS - static_cast<double>(first_step_);
    const auto i = static_cast<std::size_t>(
        std::clamp(std::floor(steps), 0.0, static_cast<double>(nodes_.size() - 2)));
    const double share = steps - static_cast<double>(i);
    const Node& a = nodes_[i];
    const Node& b = nodes_[i + 1];
    // In so short a time the turn is so small that the straight way between the two is the arc.
    Eigen::Quaterniond rotation = a.rotation;
    rotation.coeffs() += share * (b.rotation.coeffs() - a.rotation.coeffs());
    return rotation.normalized() * p + (a.translation + share * (b.translation - a.translation));
  }

 private:
  struct Node {
    Eigen::Vector3d translation;
    Eigen::Quaterniond rotation;
  };
  long first_step_;
  std::vector<Node> nodes_;
};

}  // namespace

std::vector<Eigen::Vector3f> positions_at_stamp(const TruePath& T_world_lidar, double stamp_s,
                                                const LabelledPoints& points) {
  if (points.positions.empty()) return {};
  const auto [first, last] =
      std::minmax_element(points.time_offsets_s.begin(), points.time_offsets_s.end());
  const NearbyPath path(T_world_lidar, stamp_s, *first, *last);
  std::vector<Eigen::Vector3f> moved;
  moved.reserve(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    moved.push_back(
        path.moved(points.positions[i].cast<double>(), points.time_offsets_s[i]).cast<float>());
  }
  return moved;
}

}  // namespace stillmap::simulation
