#include "place_search.hpp"

#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>

namespace stillmap::localization {
namespace {

using std::numbers::pi_v;

// Places are looked at this far apart [m].
constexpr double kSpacingM = 3.0;
// Poses farther than this outside the map's bounds saw nothing of it [m].
constexpr double kPlaceMarginM = 100.0;
constexpr int kHeadings = 60;
// Share of all places and headings that the second round looks at, and the least number of them.
// Less and the right one is lost among the many that fit as well on coarse cells.
constexpr std::size_t kWidePart = 6;
constexpr std::size_t kLeastAfterWide = 900;
constexpr std::size_t kAfterMiddle = 30;
constexpr std::size_t kPoints = 160;
constexpr float kPlaceReachM = 35.0F;

// Mounts that are tilted by less keep the lidar's z as their upward axis [rad].
constexpr double kTiltedRad = 0.2;

// Length of the mean of the upward axes of one sensor: hills of 10 degrees leave 0.985.
constexpr double kLeastAlike = 0.97;

/// From the mean of the map's upward axis in the lidar: hills even out, mounts do not.
Eigen::Matrix3d levelling(const std::vector<Eigen::Isometry3d>& T_map_lidar) {
  Eigen::Vector3d up_lidar = Eigen::Vector3d::Zero();
  for (const Eigen::Isometry3d& T : T_map_lidar) up_lidar += T.linear().row(2).transpose();
  // Sensors that are mounted in different ways share no frame; each pose has its own then.
  if (up_lidar.norm() < kLeastAlike * static_cast<double>(T_map_lidar.size()))
    return Eigen::Matrix3d::Identity();
  const double tilt_rad = std::atan2(up_lidar.head<2>().norm(), up_lidar.z());
  if (!(tilt_rad > kTiltedRad)) return Eigen::Matrix3d::Identity();
  return maps::turn_between(up_lidar, Eigen::Vector3d::UnitZ()).toRotationMatrix();
}

/// Upright frame at a place: z is the levelled pose's own, x as near to the map's x as that allows.
Eigen::Isometry3f without_heading(const Eigen::Isometry3d& T) {
  const Eigen::Vector3d up = T.linear().col(2);
  // Along the map's x there is none nearer than another.
  const bool along_x = std::abs(up.x()) > 0.999;
  const Eigen::Vector3d y =
      up.cross(along_x ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitX()).normalized();
  Eigen::Isometry3d level = Eigen::Isometry3d::Identity();
  level.linear() << y.cross(up), y, up;
  level.translation() = T.translation();
  return level.cast<float>();
}

/// Takes places that are `kSpacingM` or more from all those taken, by cells of that size.
class PlacesApart {
 public:
  bool take(const Eigen::Vector3d& p) {
    const Eigen::Array3i cell = (p / kSpacingM).array().floor().cast<int>();
    for (int around = 0; around < 27; ++around) {
      const Eigen::Array3i step(around / 9 - 1, around / 3 % 3 - 1, around % 3 - 1);
      const auto found = taken_.find(key(cell + step));
      if (found == taken_.end()) continue;
      for (const Eigen::Vector3d& q : found->second) {
        if ((p - q).squaredNorm() < kSpacingM * kSpacingM) return false;
      }
    }
    taken_[key(cell)].push_back(p);
    return true;
  }

 private:
  static std::array<int, 3> key(const Eigen::Array3i& cell) {
    return {cell.x(), cell.y(), cell.z()};
  }
  std::map<std::array<int, 3>, std::vector<Eigen::Vector3d>> taken_;
};

std::vector<Eigen::Vector3f> points_to_try(const Query& query, const Eigen::Matrix3f& R) {
  std::vector<Eigen::Vector3f> near;
  for (const std::size_t i : query.standing) {
    if (query.points[i].norm() < kPlaceReachM) near.push_back(R * query.points[i]);
  }
  if (near.size() <= kPoints) return near;
  std::vector<Eigen::Vector3f> some;
  for (std::size_t i = 0; i < kPoints; ++i) some.push_back(near[i * near.size() / kPoints]);
  return some;
}

template <typename Hypotheses>
void keep_best(Hypotheses& all, std::size_t count) {
  // Ties by order, so that the result does not depend on the sort.
  std::stable_sort(all.begin(), all.end(),
                   [](const auto& a, const auto& b) { return a.score > b.score; });
  if (all.size() > count) all.resize(count);
}

Eigen::Isometry3f turned(const Eigen::Isometry3f& T_index_place, float yaw_rad) {
  return T_index_place * Eigen::AngleAxisf(yaw_rad, Eigen::Vector3f::UnitZ());
}

}  // namespace

PlaceSearch::PlaceSearch(const MapIndex& index, const std::vector<Eigen::Isometry3d>& seen_from)
    : R_level_lidar_(levelling(seen_from)),
      origin_(index.origin()),
      wide_(index.place_grids()[0]),
      middle_(index.place_grids()[1]),
      fine_(index.place_grids()[2]) {
  PlacesApart apart;
  for (const Eigen::Isometry3d& T_map_lidar : seen_from) {
    Eigen::Isometry3d T_index_lidar = T_map_lidar;
    T_index_lidar.translation() -= origin_;
    const Eigen::Array3d at = T_index_lidar.translation().array();
    const bool beside =
        (at > -kPlaceMarginM).all() && (at < index.extent().array() + kPlaceMarginM).all();
    if (!beside || !apart.take(T_index_lidar.translation())) continue;
    T_index_lidar.rotate(R_level_lidar_.transpose());
    places_.push_back(without_heading(T_index_lidar));
  }
}

std::vector<PlaceSearch::Hypothesis> PlaceSearch::all_in(
    const Region& region, const std::vector<Eigen::Vector3f>& points) const {
  // Half a step more, so that a window between two headings is not empty.
  constexpr double kHalfHeadingRad = pi_v<double> / kHeadings;
  const Eigen::Vector2f centre = (region.centre_m - origin_.head<2>()).cast<float>();
  const auto radius_m = static_cast<float>(region.radius_m);
  std::vector<Hypothesis> all;
  all.reserve(places_.size() * kHeadings);
  PointColumns placed(points.size());
  for (std::size_t place = 0; place < places_.size(); ++place) {
    if ((places_[place].translation().head<2>() - centre).norm() > radius_m) continue;
    for (int heading = 0; heading < kHeadings; ++heading) {
      const double yaw_rad = 2.0 * pi_v<double> * heading / kHeadings;
      const double away_rad = std::remainder(yaw_rad - region.yaw_rad, 2.0 * pi_v<double>);
      if (std::abs(away_rad) > region.yaw_window_rad + kHalfHeadingRad) continue;
      Hypothesis h{.place = place, .yaw_rad = static_cast<float>(yaw_rad)};
      const Eigen::Isometry3f T = T_index_level(h);
      for (std::size_t i = 0; i < points.size(); ++i) placed.set(i, T * points[i]);
      h.score = static_cast<float>(wide_.hits(placed, Eigen::Vector3f::Zero()));
      all.push_back(h);
    }
  }
  return all;
}

void PlaceSearch::improve(std::vector<Hypothesis>& hypotheses,
                          const std::vector<Eigen::Vector3f>& points, const CellBits& cells,
                          const Steps& steps) const {
  std::vector<Eigen::Vector3f> shifts;
  for (int x = -steps.shifts; x <= steps.shifts; ++x) {
    for (int y = -steps.shifts; y <= steps.shifts; ++y) {
      shifts.emplace_back(static_cast<float>(x) * steps.shift_m,
                          static_cast<float>(y) * steps.shift_m, 0.0F);
    }
  }
  PointColumns placed(points.size());
  for (Hypothesis& h : hypotheses) {
    Hypothesis best = h;
    best.score = -1.0F;
    for (int turn = -steps.turns; turn <= steps.turns; ++turn) {
      Hypothesis tried = h;
      tried.yaw_rad += static_cast<float>(turn) * steps.turn_rad;
      const Eigen::Isometry3f T = T_index_level(tried);
      for (std::size_t i = 0; i < points.size(); ++i) placed.set(i, T * points[i]);
      for (const Eigen::Vector3f& along : shifts) {
        tried.score = static_cast<float>(cells.hits(placed, places_[h.place].linear() * along));
        if (tried.score <= best.score) continue;
        best = tried;
        best.x_m += along.x();
        best.y_m += along.y();
      }
    }
    h = best;
  }
}

Eigen::Isometry3f PlaceSearch::T_index_level(const Hypothesis& h) const {
  return turned(places_[h.place] * Eigen::Translation3f(h.x_m, h.y_m, 0.0F), h.yaw_rad);
}

bool PlaceSearch::same_place(const Hypothesis& a, const Hypothesis& b) const {
  const Eigen::Isometry3f difference = T_index_level(a).inverse() * T_index_level(b);
  return difference.translation().norm() < 2.5F &&
         std::abs(std::remainder(a.yaw_rad - b.yaw_rad, 2.0F * pi_v<float>)) < 0.15F;
}

std::vector<Eigen::Isometry3d> PlaceSearch::best_places(const Query& query, std::size_t count,
                                                        const Region& region) const {
  const std::vector<Eigen::Vector3f> points = points_to_try(query, R_level_lidar_.cast<float>());
  if (points.empty()) return {};
  std::vector<Hypothesis> all = all_in(region, points);
  keep_best(all, std::max(kLeastAfterWide, all.size() / kWidePart));
  improve(all, points, middle_, {.shifts = 2, .shift_m = 2.0F, .turns = 1, .turn_rad = 0.05F});
  keep_best(all, all.size());
  std::vector<Hypothesis> apart;
  for (const Hypothesis& h : all) {
    if (apart.size() == kAfterMiddle) break;
    const bool known = std::any_of(apart.begin(), apart.end(),
                                   [&](const Hypothesis& other) { return same_place(h, other); });
    if (!known) apart.push_back(h);
  }
  improve(apart, points, fine_, {.shifts = 2, .shift_m = 0.7F, .turns = 3, .turn_rad = 0.02F});
  keep_best(apart, apart.size());
  std::vector<Eigen::Isometry3d> places;
  std::vector<Hypothesis> kept;
  for (const Hypothesis& h : apart) {
    if (places.size() == count) break;
    const bool known = std::any_of(kept.begin(), kept.end(),
                                   [&](const Hypothesis& other) { return same_place(h, other); });
    if (known) continue;
    kept.push_back(h);
    Eigen::Isometry3d T = T_index_level(h).cast<double>();
    T.rotate(R_level_lidar_);
    T.translation() += origin_;
    places.push_back(T);
  }
  return places;
}

}  // namespace stillmap::localization
