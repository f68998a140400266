#include "registration/map_following.hpp"

#include <stillmap/maps/frames.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>

namespace stillmap::mapping {
namespace {

constexpr double kReachM = 15.0;
/// What all answers share, so that one with a tiny covariance does not stand for all [m, rad].
constexpr double kSharedM = 0.01;
constexpr double kSharedRad = 5e-4;

/// What a pose is off by, in the map's frame.
struct Correction {
  Eigen::Vector3d shift = Eigen::Vector3d::Zero(), turn = Eigen::Vector3d::Zero();
};

struct SightOnWay {
  /// Along the way [m].
  double at_m = 0.0;
  Correction correction;
  double shift_weight = 0.0, turn_weight = 0.0;
};

Eigen::Vector3d rotation_vector(const Eigen::Matrix3d& R) {
  const Eigen::AngleAxisd turn(R);
  return turn.angle() * turn.axis();
}

/// A line through weighted values along the way. At the ends of a drive, where all values lie to
/// one side, a mean would be that of another place.
class LineFit {
 public:
  void add(double along_m, const Eigen::Vector3d& value, double weight) {
    weight_ += weight;
    along_ += weight * along_m;
    along2_ += weight * along_m * along_m;
    value_ += weight * value;
    product_ += weight * along_m * value;
  }
  [[nodiscard]] Eigen::Vector3d at_0() const {
    if (!(weight_ > 0.0)) return Eigen::Vector3d::Zero();
    const double spread = weight_ * along2_ - along_ * along_;
    // Of values at one place, or nearly, there is no line.
    if (spread < kLeastSpreadM * kLeastSpreadM * weight_ * weight_) return value_ / weight_;
    return (along2_ * value_ - along_ * product_) / spread;
  }

 private:
  static constexpr double kLeastSpreadM = 1.0;
  double weight_ = 0.0, along_ = 0.0, along2_ = 0.0;
  Eigen::Vector3d value_ = Eigen::Vector3d::Zero(), product_ = Eigen::Vector3d::Zero();
};

std::vector<double> way_of(const std::vector<Eigen::Isometry3d>& poses) {
  std::vector<double> way(poses.size(), 0.0);
  for (std::size_t i = 1; i < poses.size(); ++i)
    way[i] = way[i - 1] + (poses[i].translation() - poses[i - 1].translation()).norm();
  return way;
}

/// What the sights around one of them say at its place. @param sights  by `at_m`.
Correction smoothed(const std::vector<SightOnWay>& sights, double at_m) {
  const auto by_way = [](const SightOnWay& sight, double m) { return sight.at_m < m; };
  auto at = std::lower_bound(sights.begin(), sights.end(), at_m - kReachM, by_way);
  LineFit shift, turn;
  for (; at != sights.end() && at->at_m < at_m + kReachM; ++at) {
    const double along_m = at->at_m - at_m;
    const double near = 1.0 - std::abs(along_m) / kReachM;
    shift.add(along_m, at->correction.shift, near * at->shift_weight);
    turn.add(along_m, at->correction.turn, near * at->turn_weight);
  }
  return {shift.at_0(), turn.at_0()};
}

/// Between two sights on a line, before the first and behind the last one as there.
/// @param sights  by `at_m`, at least one, smoothed.
Correction correction_at(const std::vector<SightOnWay>& sights, double at_m) {
  const auto next =
      std::lower_bound(sights.begin(), sights.end(), at_m,
                       [](const SightOnWay& sight, double m) { return sight.at_m < m; });
  if (next == sights.begin()) return next->correction;
  const SightOnWay& before = *std::prev(next);
  if (next == sights.end()) return before.correction;
  const double share = (at_m - before.at_m) / (next->at_m - before.at_m);
  const auto between = [share](const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
    return Eigen::Vector3d(from + share * (to - from));
  };
  return {between(before.correction.shift, next->correction.shift),
          between(before.correction.turn, next->correction.turn)};
}

}  // namespace

std::vector<Eigen::Isometry3d> following(std::vector<Eigen::Isometry3d> T_map_lidar,
                                         const std::vector<FoundScan>& found) {
  if (found.empty()) return T_map_lidar;
  const std::vector<double> way_m = way_of(T_map_lidar);
  std::vector<SightOnWay> sights;
  for (const FoundScan& each : found) {
    const Eigen::Isometry3d& own = T_map_lidar.at(each.scan);
    sights.push_back(
        {way_m[each.scan],
         {each.T_map_lidar.translation() - own.translation(),
          rotation_vector(each.T_map_lidar.linear() * own.linear().transpose())},
         1.0 / (kSharedM * kSharedM + each.covariance.topLeftCorner<3, 3>().trace()),
         1.0 / (kSharedRad * kSharedRad + each.covariance.bottomRightCorner<3, 3>().trace())});
  }
  std::vector<SightOnWay> smooth = sights;
  for (SightOnWay& sight : smooth) sight.correction = smoothed(sights, sight.at_m);
  for (std::size_t i = 0; i < T_map_lidar.size(); ++i) {
    const Correction correction = correction_at(smooth, way_m[i]);
    Eigen::Isometry3d& T = T_map_lidar[i];
    const double angle = correction.turn.norm();
    if (angle > 0.0)
      T.linear() =
          Eigen::AngleAxisd(angle, correction.turn / angle).toRotationMatrix() * T.linear();
    T.translation() += correction.shift;
    T = maps::renormalized(T);
  }
  return T_map_lidar;
}

std::vector<bool> known_by_map(const std::vector<Eigen::Isometry3d>& T_map_lidar,
                               const std::vector<FoundScan>& found) {
  const std::vector<double> way_m = way_of(T_map_lidar);
  std::vector<bool> known(T_map_lidar.size(), false);
  auto next = found.begin();
  for (std::size_t i = 0; i < known.size(); ++i) {
    while (next != found.end() && next->scan < i) ++next;
    const bool before = next != found.begin() && way_m[i] - way_m[(next - 1)->scan] < kReachM;
    known[i] = before || (next != found.end() && way_m[next->scan] - way_m[i] < kReachM);
  }
  return known;
}

}  // namespace stillmap::mapping
