#include "bags/place_on_earth.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/geodesy.hpp>
#include <stillmap/maps/median.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace stillmap::maps {
namespace {

constexpr std::size_t kLeastFixes = 10;
constexpr double kLeastReachM = 10.0;
constexpr double kMostResidual = 0.02;
constexpr int kRounds = 50;

GeodeticOrigin middle_of(const std::vector<FixOnPath>& fixes) {
  const auto median_of = [&](double GeodeticOrigin::*value) {
    std::vector<double> values;
    for (const FixOnPath& fix : fixes) values.push_back(fix.place.*value);
    return median(std::move(values));
  };
  return {median_of(&GeodeticOrigin::latitude_deg), median_of(&GeodeticOrigin::longitude_deg),
          median_of(&GeodeticOrigin::altitude_m)};
}

/// The same points in both frames, a column each.
struct Pairs {
  Eigen::Matrix3Xd enu;
  Eigen::Matrix3Xd map;

  [[nodiscard]] Eigen::Index size() const { return enu.cols(); }
};

/// Root mean square distance from the middle, in the plane.
double reach_m(const Eigen::Matrix3Xd& points) {
  const Eigen::Matrix2Xd flat = points.topRows<2>();
  return std::sqrt((flat.colwise() - flat.rowwise().mean()).colwise().squaredNorm().mean());
}

/// Best turn about z and shift in the plane.
Eigen::Isometry3d fit(const Pairs& pairs, const Eigen::VectorXd& weights) {
  const double sum = weights.sum();
  const Eigen::Vector3d middle_enu = pairs.enu * weights / sum;
  const Eigen::Vector3d middle_map = pairs.map * weights / sum;
  double along = 0.0;
  double across = 0.0;
  for (Eigen::Index i = 0; i < pairs.size(); ++i) {
    const Eigen::Vector3d e = pairs.enu.col(i) - middle_enu;
    const Eigen::Vector3d p = pairs.map.col(i) - middle_map;
    along += weights[i] * (p.x() * e.x() + p.y() * e.y());
    across += weights[i] * (p.x() * e.y() - p.y() * e.x());
  }
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::AngleAxisd(std::atan2(across, along), Eigen::Vector3d::UnitZ()).matrix();
  T.translation().head<2>() = (middle_enu - T.linear() * middle_map).head<2>();
  return T;
}

std::vector<double> distances_m(const Pairs& pairs, const Eigen::Isometry3d& T_enu_map) {
  const Eigen::Matrix3Xd off = pairs.enu - T_enu_map * pairs.map;
  const Eigen::VectorXd norms = off.topRows<2>().colwise().norm();
  return {norms.begin(), norms.end()};
}

Eigen::Isometry3d fit_robustly(const Pairs& pairs) {
  constexpr double kLeastScaleM = 0.01;
  Eigen::VectorXd weights = Eigen::VectorXd::Ones(pairs.size());
  Eigen::Isometry3d T = fit(pairs, weights);
  for (int round = 0; round < kRounds; ++round) {
    const std::vector<double> distances = distances_m(pairs, T);
    const double scale_m = std::max(median(distances), kLeastScaleM);
    for (Eigen::Index i = 0; i < pairs.size(); ++i) {
      const double ratio = distances[static_cast<std::size_t>(i)] / scale_m;
      weights[i] = 1.0 / (1.0 + ratio * ratio);
    }
    T = fit(pairs, weights);
  }
  return T;
}

}  // namespace

PlaceOnEarth place_on_earth(const std::vector<FixOnPath>& fixes, const std::string& source) {
  if (fixes.size() < kLeastFixes)
    throw InputError(
        source, fmt::format("{} fixes beside the poses", fixes.size()),
        fmt::format("at least {}: record both together, or leave out gnss=TOPIC", kLeastFixes));
  PlaceOnEarth found;
  found.origin = middle_of(fixes);
  const auto count = static_cast<Eigen::Index>(fixes.size());
  Pairs pairs{Eigen::Matrix3Xd(3, count), Eigen::Matrix3Xd(3, count)};
  for (Eigen::Index i = 0; i < count; ++i) {
    const FixOnPath& fix = fixes[static_cast<std::size_t>(i)];
    pairs.enu.col(i) = T_enu_enu(found.origin, fix.place).translation();
    pairs.map.col(i) = fix.p_map;
  }
  const double reach = reach_m(pairs.map);
  if (!(reach >= kLeastReachM))
    throw InputError(
        source, fmt::format("poses that reach {:.1f} m from their middle", reach),
        fmt::format("{} m and more, as the heading is unknown else: leave out gnss=TOPIC",
                    kLeastReachM));
  found.T_enu_map = fit_robustly(pairs);
  found.residual_m = median(distances_m(pairs, found.T_enu_map));
  if (!(found.residual_m <= kMostResidual * reach))
    throw InputError(
        source,
        fmt::format("fixes {:.2f} m off the poses at the median, which reach {:.1f} m "
                    "from their middle",
                    found.residual_m, reach),
        fmt::format("at most {} % of that, as the heading is unknown else: check the poses and the "
                    "fixes, or leave out gnss=TOPIC",
                    100.0 * kMostResidual));
  const Eigen::VectorXd heights = (pairs.enu - found.T_enu_map * pairs.map).row(2);
  found.T_enu_map.translation().z() = median(std::vector<double>(heights.begin(), heights.end()));
  return found;
}

}  // namespace stillmap::maps
