#include "patching/seam.hpp"

#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <ranges>
#include <utility>
#include <vector>

namespace stillmap::mapping {
namespace {

constexpr double kNearM = 0.3;
constexpr double kKernelM = 0.03;
constexpr std::size_t kLeastPoints = 100;
constexpr double kLeastShare = 0.1;
/// So many squares of equal weight, or more that are not: one that has changed is no seam.
constexpr double kLeastSquares = 4.0;
/// Of 255: corners and bushes have normals, too.
constexpr int kLeastPlanarity = 200;
constexpr int kRounds = 8;

bool is_in(const maps::MapPoint& point, int quarter) {
  const auto half = static_cast<float>(maps::kTileSizeM / 2);
  return (point.x >= half) == ((quarter & 1) != 0) && (point.y >= half) == ((quarter & 2) != 0);
}

/// A new point and how far it is off from a surface of the map.
struct Residual {
  Eigen::Vector3d at, normal;
  double off_m = 0.0;
};

std::vector<Residual> residuals_of(const TileOfMap& before, const TileOfMap& now, int quarter) {
  std::vector<Eigen::Vector3f> points;
  std::vector<Eigen::Vector3d> normals;
  for (std::size_t i = 0; i < before.history.size(); ++i) {
    const maps::PointHistory& history = before.history[i];
    if (!maps::is_measured(before.points[i].kind) || history.planarity < kLeastPlanarity) continue;
    const Eigen::Vector3d normal(history.normal[0], history.normal[1], history.normal[2]);
    if (normal.isZero()) continue;
    points.push_back(position_of(before.points[i]));
    normals.push_back(normal.normalized());
  }
  const std::vector<Eigen::Vector3f> known = points;
  const PointCells cells(std::move(points), kNearM);
  std::vector<Residual> residuals;
  for (const maps::MapPoint& point : now.points) {
    if (!maps::is_measured(point.kind) || !is_in(point, quarter)) continue;
    const Eigen::Vector3f p = position_of(point);
    const auto nearest = cells.nearest(p, kNearM);
    if (!nearest) continue;
    const Eigen::Vector3d& normal = normals[nearest->point];
    residuals.push_back(
        {p.cast<double>(), normal, normal.dot((p - known[nearest->point]).cast<double>())});
  }
  return residuals;
}

/// What the points in a square of 1 m say together.
struct Square {
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  /// Gradient of the cost at the fit.
  Eigen::Vector3d left = Eigen::Vector3d::Zero();
};
using Squares = std::map<std::pair<int, int>, Square>;

/// What the squares tell.
struct Told {
  Eigen::Matrix3d inverse = Eigen::Matrix3d::Zero(), directions = Eigen::Matrix3d::Zero();
};

/// A^-1 in the directions that enough of the weights and enough squares tell of, 0 in the others.
Told inverse_where_told(const Squares& squares, double weights) {
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  for (const auto& [place, square] : squares) A += square.A;
  const maps::SymmetricEigen<3> eigen = maps::eigen_of(A);
  Told all;
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector3d axis = eigen.vectors.col(k);
    double squared = 0.0;
    for (const auto& [place, square] : squares) {
      const double part = axis.dot(square.A * axis);
      squared += part * part;
    }
    const double told = eigen.values[k];
    if (told < kLeastShare * weights || told * told < kLeastSquares * squared) continue;
    all.inverse += axis * axis.transpose() / told;
    all.directions += axis * axis.transpose();
  }
  return all;
}

}  // namespace

std::optional<SeamFit> seam_between(const TileOfMap& before, const TileOfMap& now, int quarter) {
  const std::vector<Residual> residuals = residuals_of(before, now, quarter);
  if (residuals.size() < kLeastPoints) return std::nullopt;
  SeamFit fit;
  fit.points = residuals.size();
  for (const Residual& each : residuals)
    fit.middle += each.at / static_cast<double>(residuals.size());
  Squares squares;
  Told told;
  for (int round = 0; round <= kRounds; ++round) {
    squares.clear();
    double weights = 0.0;
    for (const Residual& each : residuals) {
      const double left_m = each.off_m - each.normal.dot(fit.off_m);
      const double weight = 1.0 / (1.0 + left_m * left_m / (kKernelM * kKernelM));
      Square& square = squares[{static_cast<int>(each.at.x()), static_cast<int>(each.at.y())}];
      square.A += weight * each.normal * each.normal.transpose();
      square.b += weight * each.off_m * each.normal;
      square.left += weight * left_m * each.normal;
      weights += weight;
    }
    if (round == kRounds) break;
    told = inverse_where_told(squares, weights);
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    for (const auto& [place, square] : squares) b += square.b;
    fit.off_m = told.inverse * b;
  }
  fit.told = told.directions;
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const auto& [place, square] : squares) spread += square.left * square.left.transpose();
  if (const double off_m = fit.off_m.norm(); off_m > 0.0) {
    const Eigen::Vector3d along = told.inverse * fit.off_m / off_m;
    fit.sigma_m = std::sqrt(along.dot(spread * along));
  }
  return fit;
}

Eigen::Vector3d shared_shift_m(const SeamFit& place, std::span<const SeamFit> fits) {
  constexpr double kNearM = 15.0, kMostSigmaM = 0.01, kLeastTold = 0.7;
  if (place.sure_m() == 0.0) return Eigen::Vector3d::Zero();
  const Eigen::Vector3d along = place.off_m.normalized();
  std::vector<double> off_m;
  const auto x_of = [](const SeamFit& each) { return each.middle.x(); };
  const auto near =
      std::ranges::subrange(std::ranges::lower_bound(fits, place.middle.x() - kNearM, {}, x_of),
                            std::ranges::upper_bound(fits, place.middle.x() + kNearM, {}, x_of));
  for (const SeamFit& each : near) {
    if ((each.middle - place.middle).norm() > kNearM || each.sigma_m > kMostSigmaM) continue;
    if (along.dot(each.told * along) >= kLeastTold) off_m.push_back(along.dot(each.off_m));
  }
  if (off_m.size() < 2) return Eigen::Vector3d::Zero();
  const auto middle = off_m.begin() + static_cast<std::ptrdiff_t>((off_m.size() - 1) / 2);
  std::nth_element(off_m.begin(), middle, off_m.end());
  return std::clamp(*middle, 0.0, place.sure_m()) * along;
}

}  // namespace stillmap::mapping
