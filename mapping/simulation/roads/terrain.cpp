#include "roads/terrain.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "geometry/random.hpp"

namespace stillmap::simulation {
namespace {

using std::numbers::pi;

constexpr double kCrown = 0.025;
// Beyond this depth into the carriageway the crown is flat, so that crossings have no ridge.
constexpr double kCrownReach = 4.0;
constexpr double kPavementGrade = 0.02;
constexpr double kLoweredKerb = 0.03;
constexpr double kKerbVaries = 0.35;
constexpr double kKerbWave_m = 9.0;
// A verge falls to a ditch and rises again.
constexpr double kDitchDepth = 0.45;
constexpr double kDitchMiddle = 3.5;
constexpr double kDitchHalfWidth = 2.5;

/// Weights of the three lattice points of a quadratic B-spline, `t` in [-0.5, 0.5] from the middle.
std::array<double, 3> spline_weights(double t) {
  return {0.5 * (0.5 - t) * (0.5 - t), 0.75 - t * t, 0.5 * (0.5 + t) * (0.5 + t)};
}

double height_across(const RoadEdge& edge, const RoadPlace& place) {
  const double out = place.outside_m;
  if (out <= 0.0) return kCrown * kCrownReach * std::tanh(-out / kCrownReach);
  const RoadSection& section = edge.section;
  const int side = place.offset_m > 0.0 ? 0 : 1;
  if (section.pavement_width <= 0.0 && section.kerb_height <= 0.0) {
    const double from_middle = std::abs(out - kDitchMiddle) / kDitchHalfWidth;
    return from_middle < 1.0 ? -0.5 * kDitchDepth * (1.0 + std::cos(pi * from_middle)) : 0.0;
  }
  const bool lowered = edge.has_drive(side, place.station_m) && section.kerb_height > kLoweredKerb;
  // Kerbs sink and roads are laid anew: their height varies along the street.
  const double kerb =
      lowered ? kLoweredKerb
              : section.kerb_height * (1.0 + kKerbVaries * std::sin(place.station_m / kKerbWave_m));
  if (out < Terrain::kKerbWidth) return kerb * out / Terrain::kKerbWidth;
  return kerb + kPavementGrade * std::min(out - Terrain::kKerbWidth, section.pavement_width);
}

}  // namespace

Terrain::Terrain(const RoadNetwork& network, const Relief& relief, std::uint64_t seed,
                 const std::vector<Eigen::Vector2d>& around, double reach_m)
    : network_(network), relief_(relief), seed_(seed) {
  spread(around, reach_m);
}

double Terrain::hill(const Eigen::Vector2d& p) const {
  double height = 0.0;
  Random random(key_of(seed_, Stream::kGround));
  // Three waves of thirds of the grade, so that their sum never exceeds it.
  for (int wave = 0; wave < 3; ++wave) {
    const double length = relief_.hill_length_m * random.uniform(0.7, 1.5);
    const double heading = random.uniform(0.0, 2.0 * pi);
    const double phase = random.uniform(0.0, 2.0 * pi);
    const double k = 2.0 * pi / length;
    const double along = std::cos(heading) * p.x() + std::sin(heading) * p.y();
    height += relief_.max_grade / (3.0 * k) * std::sin(k * along + phase);
  }
  return height;
}

double Terrain::along_road(const RoadEdge& edge, std::size_t point) const {
  const double s = edge.stations_m[point];
  const double left = edge.length_m() - s;
  Random random(key_of(seed_, Stream::kGround,
                       1 + static_cast<std::uint64_t>(&edge - network_.edges().data())));
  const double length = random.uniform(20.0, 40.0);
  // Dips fade out at the ends, where roads meet.
  const double fade = std::clamp(std::min(s, left) / 20.0, 0.0, 1.0);
  return hill(edge.points[point]) +
         fade * relief_.dip_m * std::sin(2.0 * pi * s / length + random.uniform(0.0, 2.0 * pi));
}

void Terrain::spread(const std::vector<Eigen::Vector2d>& around, double reach_m) {
  for (const Eigen::Vector2d& p : around) bounds_.extend(p);
  bounds_.min() = (bounds_.min().array() - reach_m - 3.0).floor();
  bounds_.max() = (bounds_.max().array() + reach_m + 3.0).ceil();
  columns_ = static_cast<std::int64_t>(bounds_.sizes().x()) + 1;
  rows_ = static_cast<std::int64_t>(bounds_.sizes().y()) + 1;
  lattice_.assign(static_cast<std::size_t>(columns_ * rows_),
                  std::numeric_limits<float>::quiet_NaN());
  std::vector<std::uint8_t> wanted(lattice_.size(), 0);
  const auto reach = static_cast<std::int64_t>(reach_m) + 2;
  for (const Eigen::Vector2d& p : around) {
    const Eigen::Vector2d at = p - bounds_.min();
    const auto x0 = static_cast<std::int64_t>(at.x());
    const auto y0 = static_cast<std::int64_t>(at.y());
    for (std::int64_t y = std::max<std::int64_t>(0, y0 - reach);
         y <= std::min(rows_ - 1, y0 + reach); ++y) {
      const auto dy = static_cast<double>(y - y0);
      const double half = std::sqrt(std::max(0.0, static_cast<double>(reach * reach) - dy * dy));
      const std::int64_t x1 = std::max<std::int64_t>(0, x0 - static_cast<std::int64_t>(half));
      const std::int64_t x2 = std::min(columns_ - 1, x0 + static_cast<std::int64_t>(half));
      if (x1 <= x2) {
        std::fill(wanted.begin() + y * columns_ + x1, wanted.begin() + y * columns_ + x2 + 1, 1);
      }
    }
  }
  // Each middle line point adds to the lattice points around it.
  constexpr int kSpread = 44;
  std::vector<float> weights(lattice_.size(), 0.0F);
  std::vector<float> sums(lattice_.size(), 0.0F);
  for (const RoadEdge& edge : network_.edges()) {
    for (std::size_t i = 0; i < edge.points.size(); ++i) {
      const Eigen::Vector2d at = edge.points[i] - bounds_.min();
      if (at.x() < -kSpread || at.y() < -kSpread ||
          at.x() > static_cast<double>(columns_ + kSpread) ||
          at.y() > static_cast<double>(rows_ + kSpread)) {
        continue;
      }
      const auto z = static_cast<float>(along_road(edge, i));
      const auto x0 = static_cast<std::int64_t>(std::lround(at.x()));
      const auto y0 = static_cast<std::int64_t>(std::lround(at.y()));
      for (std::int64_t y = std::max<std::int64_t>(0, y0 - kSpread);
           y <= std::min(rows_ - 1, y0 + kSpread); ++y) {
        for (std::int64_t x = std::max<std::int64_t>(0, x0 - kSpread);
             x <= std::min(columns_ - 1, x0 + kSpread); ++x) {
          const auto k = static_cast<std::size_t>(y * columns_ + x);
          if (wanted[k] == 0) continue;
          const Eigen::Vector2d to(static_cast<double>(x) - at.x(),
                                   static_cast<double>(y) - at.y());
          const double near = to.squaredNorm() + 2.0;
          const auto w = static_cast<float>(1.0 / (near * near));
          weights[k] += w;
          sums[k] += w * z;
        }
      }
    }
  }
  for (std::size_t k = 0; k < lattice_.size(); ++k) {
    if (wanted[k] == 0) continue;
    const auto x = static_cast<std::int64_t>(k) % columns_;
    const auto y = static_cast<std::int64_t>(k) / columns_;
    const Eigen::Vector2d p =
        bounds_.min() + Eigen::Vector2d(static_cast<double>(x), static_cast<double>(y));
    // Far from every road the hill itself takes over.
    constexpr double kHillWeight = 3e-6;
    lattice_[k] = static_cast<float>((static_cast<double>(sums[k]) + kHillWeight * hill(p)) /
                                     (static_cast<double>(weights[k]) + kHillWeight));
  }
}

bool Terrain::covers(const Eigen::Vector2d& p) const {
  const Eigen::Vector2d at = p - bounds_.min();
  const auto x = static_cast<std::int64_t>(std::lround(at.x()));
  const auto y = static_cast<std::int64_t>(std::lround(at.y()));
  if (x < 1 || y < 1 || x > columns_ - 2 || y > rows_ - 2) return false;
  for (const std::int64_t dy : {-1, 1}) {
    for (const std::int64_t dx : {-1, 1}) {
      if (std::isnan(lattice_[static_cast<std::size_t>((y + dy) * columns_ + x + dx)]))
        return false;
    }
  }
  return true;
}

double Terrain::base(const Eigen::Vector2d& p) const {
  if (!covers(p)) return hill(p);
  const Eigen::Vector2d at = p - bounds_.min();
  const auto x = static_cast<std::int64_t>(std::lround(at.x()));
  const auto y = static_cast<std::int64_t>(std::lround(at.y()));
  const auto wx = spline_weights(at.x() - static_cast<double>(x));
  const auto wy = spline_weights(at.y() - static_cast<double>(y));
  double z = 0.0;
  for (std::size_t j = 0; j < 3; ++j) {
    for (std::size_t i = 0; i < 3; ++i) {
      const auto k =
          static_cast<std::size_t>((y + static_cast<std::int64_t>(j) - 1) * columns_ + x) + i - 1;
      z += wx[i] * wy[j] * static_cast<double>(lattice_[k]);
    }
  }
  return z;
}

double Terrain::height(const Eigen::Vector2d& p, const RoadPlace& place) const {
  return base(p) + height_across(network_.edges()[place.edge], place);
}

double Terrain::height(const Eigen::Vector2d& p) const {
  const std::optional<RoadPlace> place = network_.place(p);
  return place ? height(p, *place) : base(p);
}

Eigen::Isometry3d Terrain::T_world_upright(const Eigen::Vector2d& p, double heading_rad) const {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::AngleAxisd(heading_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  T.translation() << p, height(p);
  return T;
}

Eigen::Isometry3d Terrain::T_world_standing(const Eigen::Vector2d& p, double heading_rad,
                                            double length_m, double width_m) const {
  const Eigen::Vector2d x(std::cos(heading_rad), std::sin(heading_rad));
  const Eigen::Vector2d y(-x.y(), x.x());
  std::array<double, 4> z{};
  for (std::size_t foot = 0; foot < 4; ++foot) {
    const double fore = (foot & 1U) != 0 ? 0.5 : -0.5;
    const double left = (foot & 2U) != 0 ? 0.5 : -0.5;
    z.at(foot) = height(p + fore * length_m * x + left * width_m * y);
  }
  const double rise = 0.5 * (z[1] + z[3] - z[0] - z[2]);
  const double lean = 0.5 * (z[2] + z[3] - z[0] - z[1]);
  const Eigen::Vector3d forward =
      Eigen::Vector3d(length_m * x.x(), length_m * x.y(), rise).normalized();
  const Eigen::Vector3d across(width_m * y.x(), width_m * y.y(), lean);
  const Eigen::Vector3d up = forward.cross(across).normalized();
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() << forward, up.cross(forward), up;
  T.translation() << p, 0.25 * (z[0] + z[1] + z[2] + z[3]);
  return T;
}

}  // namespace stillmap::simulation
