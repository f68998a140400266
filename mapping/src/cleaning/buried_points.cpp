#include "cleaning/buried_points.hpp"

#include <stillmap/maps/median.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

/// How far below the ground a ray must run [m], and more of it with the range: a pose that is
/// 0.3 degrees off.
constexpr double kBuriedM = 0.1;
constexpr double kBuriedPerM = 0.005;
/// A cell of the ground [m].
constexpr double kRayStepM = 0.25;
/// What its scan took for ground is more likely ground that poses moved.
constexpr double kBuriedGroundM = 0.4;
/// Ground that may hide something was measured often (a weight of 0.3: by one scan from 15 m, by
/// several from farther away), and lies no farther from the sensor than this [m]: beyond, single
/// returns from slopes and bushes make it, and a wall that is seen over it would go.
constexpr std::uint8_t kLeastConfidence255 = 240;
constexpr double kHidesWithinM = 35.0;
/// What lies less behind the place where its ray went below the ground may be the face of a wall
/// or a kerb, whose cell has the height of its top [m].
constexpr double kBehindM = 0.35;
/// Ground does not rise by more from one measured place to the next; beyond, another surface begins
/// [m, m/m, m].
constexpr double kJumpM = 0.5;
constexpr double kSteepest = 0.6;
constexpr double kLongestGapM = 4.0;

/// Ground points that are compared with the fused ground: one of so many, up to this range [m].
constexpr std::size_t kComparedStride = 16;
constexpr float kComparedM = 25.0F;
constexpr std::size_t kFewestCompared = 50;

/// Heights of the ground are looked up once for squares of this edge around the sensor [m], up to
/// this far.
constexpr double kSquareM = 1.0;
constexpr int kSquares = 200;

class BuriedRays {
 public:
  BuriedRays(const FusedGround& ground, const Eigen::Isometry3d& T_local_lidar)
      : sheets_(ground.sheets()), ground_(ground), T_local_lidar_(T_local_lidar) {}

  /// Shifts the scan onto the fused ground. @return false when that cannot be done.
  bool level(std::span<const Eigen::Vector3f> positions, const std::vector<bool>& is_ground) {
    std::vector<double> off_m;
    std::size_t seen = 0;
    for (std::size_t i = 0; i < positions.size(); ++i) {
      if (!is_ground[i] || positions[i].squaredNorm() > kComparedM * kComparedM) continue;
      if (seen++ % kComparedStride != 0) continue;
      const Eigen::Vector3d p = T_local_lidar_ * positions[i].cast<double>();
      if (const auto z = measured(p, p.z())) off_m.push_back(*z - p.z());
    }
    if (off_m.size() <= kFewestCompared) return false;
    T_local_lidar_.translation().z() += maps::median(std::move(off_m));
    sensor_ = T_local_lidar_.translation();
    const auto below = ground_.at(sensor_.x(), sensor_.y(), sensor_.z());
    if (!below || below->z > sensor_.z()) return false;
    start_z_ = below->z;
    heights_.assign(static_cast<std::size_t>(kSquares) * kSquares, kNotAsked);
    return true;
  }

  [[nodiscard]] bool buried(const Eigen::Vector3f& p_lidar, bool is_ground) {
    const Eigen::Vector3d p = T_local_lidar_ * p_lidar.cast<double>();
    const double least_m = is_ground ? kBuriedGroundM : kBuriedM;
    return p.z() < height_around(p) - least_m && passes_below_ground(p, least_m);
  }

 private:
  static constexpr float kNotAsked = std::numeric_limits<float>::max();

  [[nodiscard]] std::optional<double> measured(const Eigen::Vector3d& p, double z) const {
    if (!(p.head<2>().cwiseAbs().maxCoeff() < kMaxGroundCell * kGroundCellM)) return std::nullopt;
    const auto place = sheets_.find(ground_cell_of(p.x()), ground_cell_of(p.y()), z);
    if (!place) return std::nullopt;
    const GroundNode& node = sheets_.node(*place);
    if (node.state != GroundState::kKnown || node.confidence_255 < kLeastConfidence255)
      return std::nullopt;
    return static_cast<double>(node.z);
  }

  /// Of the ground in the square of a point, as the sensor sees it; where none is known, that below
  /// the sensor.
  [[nodiscard]] double height_around(const Eigen::Vector3d& p) {
    const auto x = static_cast<int>(std::floor((p.x() - sensor_.x()) / kSquareM)) + kSquares / 2;
    const auto y = static_cast<int>(std::floor((p.y() - sensor_.y()) / kSquareM)) + kSquares / 2;
    if (x < 0 || y < 0 || x >= kSquares || y >= kSquares)
      return -std::numeric_limits<double>::max();
    float& height = heights_[static_cast<std::size_t>(y * kSquares + x)];
    if (height == kNotAsked) {
      const auto sample =
          ground_.at(sensor_.x() + (x - kSquares / 2 + 0.5) * kSquareM,
                     sensor_.y() + (y - kSquares / 2 + 0.5) * kSquareM, sensor_.z());
      height = static_cast<float>(sample ? sample->z : start_z_);
    }
    return static_cast<double>(height);
  }

  [[nodiscard]] bool passes_below_ground(const Eigen::Vector3d& p, double least_m) const {
    const Eigen::Vector3d way = p - sensor_;
    const double flat_m = way.head<2>().norm();
    const double end_m = std::min(flat_m - kBehindM, kHidesWithinM);
    const int steps = end_m > 0.0 ? static_cast<int>(std::ceil(end_m / kRayStepM)) : 0;
    double last_z = start_z_, last_at_m = 0.0;
    for (int i = 1; i <= steps; ++i) {
      const double at_m = std::min(i * kRayStepM, end_m);
      const double share = at_m / flat_m;
      const Eigen::Vector3d q = sensor_ + share * way;
      const auto z = measured(q, std::max(q.z(), last_z));
      if (!z) continue;
      const bool connected =
          *z - last_z <= kJumpM + kSteepest * std::min(at_m - last_at_m, kLongestGapM);
      const double depth_m = *z - q.z();
      if (connected && depth_m >= least_m + kBuriedPerM * share * way.norm()) return true;
      if (!connected && depth_m > 0.0) continue;
      last_z = *z;
      last_at_m = at_m;
    }
    return false;
  }

  const GroundSheets& sheets_;
  const FusedGround& ground_;
  Eigen::Isometry3d T_local_lidar_;
  Eigen::Vector3d sensor_ = Eigen::Vector3d::Zero();
  double start_z_ = 0.0;
  std::vector<float> heights_;
};

}  // namespace

std::vector<std::uint8_t> find_buried_points(std::span<const Eigen::Vector3f> positions,
                                             const std::vector<bool>& is_ground,
                                             const Eigen::Isometry3d& T_local_lidar,
                                             const FusedGround& ground) {
  if (is_ground.size() != positions.size())
    throw std::invalid_argument("is_ground: expected one flag a point");
  std::vector<std::uint8_t> flags(positions.size());
  BuriedRays rays(ground, T_local_lidar);
  if (!rays.level(positions, is_ground)) return flags;
  for (std::size_t i = 0; i < positions.size(); ++i)
    flags[i] = rays.buried(positions[i], is_ground[i]) ? 1 : 0;
  return flags;
}

}  // namespace stillmap::mapping
