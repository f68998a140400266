#include "road.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "random.hpp"

namespace stillmap::simulation {
namespace {

constexpr double kStep = 0.25;
// One bend of kBendLength every kBendEvery metres; the first one lies inside even a short drive.
constexpr double kFirstBend = 25.0;
constexpr double kBendLength = 60.0;
constexpr double kBendEvery = 95.0;
// Grade of the street and how it changes along it.
constexpr double kClimb = 0.03;
constexpr double kClimbChange = 0.008;
constexpr double kClimbPeriod = 170.0;
constexpr double kCrown = 0.025;
constexpr double kPavementRise = 0.02;
// The street's grade is found from points this far apart [m].
constexpr double kNormalStep = 0.5;

/// Share of a bend's turn done at `u` in [0, 1]: its curvature is a raised cosine, without a jump
/// at either end.
double turn_share(double u) {
  return u - std::sin(2.0 * std::numbers::pi * u) / (2.0 * std::numbers::pi);
}

/// Heading of the straight before bend `i`; signs alternate so that the street never meets itself.
double straight_heading(std::uint64_t seed, std::size_t i) {
  Random random(key_of(seed, Stream::kRoad, i + 1));
  const double sign = (scrambled(seed) & 1U) == (i & 1U) ? 1.0 : -1.0;
  return sign * random.uniform(0.3, 0.45);
}

double height_across(double d) {
  const double out = std::abs(d);
  using S = StreetSection;
  if (out <= S::kKerb) return -kCrown * out;
  const double kerb_top = -kCrown * S::kKerb + S::kKerbHeight;
  return kerb_top + kPavementRise * (std::min(out, S::kPavementEnd) - S::kKerb);
}

}  // namespace

Road::Road(std::uint64_t seed, double begin_m, double end_m)
    : seed_(seed), begin_m_(std::floor(begin_m)), end_m_(std::ceil(end_m)) {
  if (!(begin_m <= 0.0 && end_m > 0.0)) throw std::invalid_argument("a road holds s = 0");
  Random random(key_of(seed, Stream::kRoad));
  climb_phase_rad_ = random.uniform(0.0, 2.0 * std::numbers::pi);
  const auto before = static_cast<std::size_t>(-begin_m_ / kStep);
  const auto after = static_cast<std::size_t>(end_m_ / kStep);
  middle_.assign(before + after + 1, Eigen::Vector2d::Zero());
  const auto step = [&](double s) {
    return Eigen::Vector2d(kStep * std::cos(heading_rad(s)), kStep * std::sin(heading_rad(s)));
  };
  for (std::size_t i = before; i + 1 < middle_.size(); ++i) {
    middle_[i + 1] = middle_[i] + step((static_cast<double>(i - before) + 0.5) * kStep);
  }
  for (std::size_t i = before; i > 0; --i) {
    middle_[i - 1] = middle_[i] - step(-(static_cast<double>(before - i) + 0.5) * kStep);
  }
}

double Road::heading_rad(double s) const {
  const double from_first = s - kFirstBend;
  if (from_first < 0.0) return straight_heading(seed_, 0);
  const auto bend = static_cast<std::size_t>(from_first / kBendEvery);
  const double u =
      std::min(1.0, (from_first - static_cast<double>(bend) * kBendEvery) / kBendLength);
  const double before = straight_heading(seed_, bend);
  return before + turn_share(u) * (straight_heading(seed_, bend + 1) - before);
}

double Road::height(double s) const {
  const double wave = 2.0 * std::numbers::pi / kClimbPeriod;
  return kClimb * s +
         kClimbChange / wave * (std::sin(wave * s + climb_phase_rad_) - std::sin(climb_phase_rad_));
}

Eigen::Vector2d Road::middle(double s) const {
  const double at =
      std::clamp((s - begin_m_) / kStep, 0.0, static_cast<double>(middle_.size() - 2));
  const auto i = static_cast<std::size_t>(at);
  return middle_[i] + (at - static_cast<double>(i)) * (middle_[i + 1] - middle_[i]);
}

Eigen::Vector3d Road::surface(double s, double d) const {
  const double heading = heading_rad(s);
  const Eigen::Vector2d xy = middle(s) + d * Eigen::Vector2d(-std::sin(heading), std::cos(heading));
  return {xy.x(), xy.y(), height(s) + height_across(d)};
}

Eigen::Isometry3d Road::T_world_upright(double s, double d, double yaw_rad) const {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() =
      Eigen::AngleAxisd(heading_rad(s) + yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  T.translation() = surface(s, d);
  return T;
}

Eigen::Isometry3d Road::T_world_ground(double s, double d, double yaw_rad) const {
  const Eigen::Vector3d along = surface(s + kNormalStep, d) - surface(s - kNormalStep, d);
  const Eigen::Vector3d across = surface(s, d + kNormalStep) - surface(s, d - kNormalStep);
  const Eigen::Vector3d up = along.cross(across).normalized();
  const Eigen::Vector3d forward = along.normalized();
  Eigen::Matrix3d R;
  R << forward, up.cross(forward), up;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = R * Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ());
  T.translation() = surface(s, d);
  return T;
}

}  // namespace stillmap::simulation
