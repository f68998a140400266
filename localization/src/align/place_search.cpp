#include "place_search.hpp"

#include "index/index_grid.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <numeric>
#include <utility>

namespace stillmap::localization {
namespace {

using std::numbers::pi_v;

constexpr int kHeadings = 60;
// Share of all places and headings that the second round looks at, and the least number of them.
// Less and the right one is lost among the many that fit as well on coarse cells.
constexpr std::size_t kWidePart = 6;
constexpr std::size_t kLeastAfterWide = 900;
constexpr std::size_t kAfterMiddle = 30;
constexpr std::size_t kPoints = 160;
constexpr float kPlaceReachM = 35.0F;

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

/// The levelled lidar beside a place: shifted along the ground, then turned.
Eigen::Isometry3f T_place_level(float x_m, float y_m, float yaw_rad) {
  return Eigen::Translation3f(x_m, y_m, 0.0F) *
         Eigen::AngleAxisf(yaw_rad, Eigen::Vector3f::UnitZ());
}

template <typename Hypotheses>
void keep_best(Hypotheses& all, std::size_t count) {
  // Ties by order, so that the result does not depend on the sort.
  std::stable_sort(all.begin(), all.end(),
                   [](const auto& a, const auto& b) { return a.score > b.score; });
  if (all.size() > count) all.resize(count);
}

/// The windows of places that come region by region.
class WindowOfPlace {
 public:
  explicit WindowOfPlace(const MapIndex& index) : index_(index) {}
  const IndexWindow& of(maps::RegionId region) {
    if (!window_ || region != region_) window_ = index_.around(region);
    region_ = region;
    return *window_;
  }

 private:
  const MapIndex& index_;
  maps::RegionId region_;
  std::shared_ptr<const IndexWindow> window_;
};

}  // namespace

PlaceSearch::PlaceSearch(const MapIndex& index)
    : index_(index), places_(index.root().places), R_level_lidar_(index.root().R_level_lidar) {}

PlaceSearch::PlaceSearch(const MapIndex& index, Places places)
    : index_(index),
      own_places_(std::move(places.rows)),
      places_(own_places_),
      R_level_lidar_(places.R_level_lidar) {}

std::vector<PlaceSearch::Hypothesis> PlaceSearch::all_in(
    const Region& region, const std::vector<Eigen::Vector3f>& points) const {
  // Half a step more, so that a window between two headings is not empty.
  constexpr double kHalfHeadingRad = pi_v<double> / kHeadings;
  std::vector<Hypothesis> all;
  all.reserve(places_.size() * kHeadings);
  PointColumns placed(points.size());
  WindowOfPlace windows(index_);
  for (std::size_t place = 0; place < places_.size(); ++place) {
    const PlaceRow& row = places_[place];
    const Eigen::Vector2d from_corner(static_cast<double>(row.place_m[0]),
                                      static_cast<double>(row.place_m[1]));
    const Eigen::Vector2d at_map = index_.origin().head<2>() + corner_of(row.region) + from_corner;
    if ((at_map - region.centre_m).norm() > region.radius_m) continue;
    const IndexWindow& window = windows.of(row.region);
    const Eigen::Isometry3f T_window = T_window_place(place, window);
    for (int heading = 0; heading < kHeadings; ++heading) {
      const double yaw_rad = 2.0 * pi_v<double> * heading / kHeadings;
      const double away_rad = std::remainder(yaw_rad - region.yaw_rad, 2.0 * pi_v<double>);
      if (std::abs(away_rad) > region.yaw_window_rad + kHalfHeadingRad) continue;
      Hypothesis h{.place = place, .yaw_rad = static_cast<float>(yaw_rad)};
      const Eigen::Isometry3f T = T_window * Eigen::AngleAxisf(h.yaw_rad, Eigen::Vector3f::UnitZ());
      for (std::size_t i = 0; i < points.size(); ++i) placed.set(i, T * points[i]);
      h.score = static_cast<float>(window.place_grids()[0].hits(placed, Eigen::Vector3f::Zero()));
      all.push_back(h);
    }
  }
  return all;
}

void PlaceSearch::improve(std::vector<Hypothesis>& hypotheses,
                          const std::vector<Eigen::Vector3f>& points, std::size_t grid,
                          const Steps& steps) const {
  std::vector<Eigen::Vector3f> shifts;
  for (int x = -steps.shifts; x <= steps.shifts; ++x) {
    for (int y = -steps.shifts; y <= steps.shifts; ++y) {
      shifts.emplace_back(static_cast<float>(x) * steps.shift_m,
                          static_cast<float>(y) * steps.shift_m, 0.0F);
    }
  }
  PointColumns placed(points.size());
  // Those of one region one behind the other, so that its window is made once.
  std::vector<std::size_t> order(hypotheses.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return hypotheses[a].place < hypotheses[b].place;
  });
  WindowOfPlace windows(index_);
  for (const std::size_t number : order) {
    Hypothesis& h = hypotheses[number];
    const IndexWindow& window = windows.of(places_[h.place].region);
    const CellBits& cells = window.place_grids()[grid];
    const Eigen::Isometry3f T_place = T_window_place(h.place, window);
    Hypothesis best = h;
    best.score = -1.0F;
    for (int turn = -steps.turns; turn <= steps.turns; ++turn) {
      Hypothesis tried = h;
      tried.yaw_rad += static_cast<float>(turn) * steps.turn_rad;
      const Eigen::Isometry3f T = T_place * T_place_level(tried.x_m, tried.y_m, tried.yaw_rad);
      for (std::size_t i = 0; i < points.size(); ++i) placed.set(i, T * points[i]);
      for (const Eigen::Vector3f& along : shifts) {
        tried.score = static_cast<float>(cells.hits(placed, T_place.linear() * along));
        if (tried.score <= best.score) continue;
        best = tried;
        best.x_m += along.x();
        best.y_m += along.y();
      }
    }
    h = best;
  }
}

Eigen::Isometry3f PlaceSearch::T_window_place(std::size_t place, const IndexWindow& window) const {
  const PlaceRow& row = places_[place];
  const auto floor_m = static_cast<float>(window.origin().z() - index_.origin().z());
  Eigen::Isometry3f T = Eigen::Isometry3f::Identity();
  T.linear() = Eigen::Matrix3f::Map(row.R_map_place.data());
  T.translation() << row.place_m[0], row.place_m[1], row.place_m[2] - floor_m;
  return T;
}

Eigen::Isometry3d PlaceSearch::T_map_level(const Hypothesis& h) const {
  const PlaceRow& row = places_[h.place];
  const Eigen::Vector2d corner = corner_of(row.region);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::Matrix3f::Map(row.R_map_place.data()).cast<double>();
  T.translation() = Eigen::Vector3f::Map(row.place_m.data()).cast<double>() + index_.origin() +
                    Eigen::Vector3d(corner.x(), corner.y(), 0.0);
  return T * T_place_level(h.x_m, h.y_m, h.yaw_rad).cast<double>();
}

std::vector<Eigen::Isometry3d> PlaceSearch::best_places(const Query& query, std::size_t count,
                                                        const Region& region) const {
  const std::vector<Eigen::Vector3f> points = points_to_try(query, R_level_lidar_.cast<float>());
  if (points.empty()) return {};
  std::vector<Hypothesis> all = all_in(region, points);
  keep_best(all, std::max(kLeastAfterWide, all.size() / kWidePart));
  improve(all, points, 1, {.shifts = 2, .shift_m = 2.0F, .turns = 1, .turn_rad = 0.05F});
  keep_best(all, all.size());
  const auto same_place = [&](const Hypothesis& a, const Hypothesis& b) {
    const Eigen::Isometry3d difference = T_map_level(a).inverse() * T_map_level(b);
    return difference.translation().norm() < 2.5 &&
           std::abs(std::remainder(a.yaw_rad - b.yaw_rad, 2.0F * pi_v<float>)) < 0.15F;
  };
  std::vector<Hypothesis> apart;
  for (const Hypothesis& h : all) {
    if (apart.size() == kAfterMiddle) break;
    const bool known = std::any_of(apart.begin(), apart.end(),
                                   [&](const Hypothesis& other) { return same_place(h, other); });
    if (!known) apart.push_back(h);
  }
  improve(apart, points, 2, {.shifts = 2, .shift_m = 0.7F, .turns = 3, .turn_rad = 0.02F});
  keep_best(apart, apart.size());
  std::vector<Eigen::Isometry3d> places;
  std::vector<Hypothesis> kept;
  for (const Hypothesis& h : apart) {
    if (places.size() == count) break;
    const bool known = std::any_of(kept.begin(), kept.end(),
                                   [&](const Hypothesis& other) { return same_place(h, other); });
    if (known) continue;
    kept.push_back(h);
    places.push_back(T_map_level(h));
    places.back().rotate(R_level_lidar_);
  }
  return places;
}

}  // namespace stillmap::localization
