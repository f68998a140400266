#include "place_search.hpp"

#include "index/index_grid.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

namespace stillmap::localization {
namespace {

using std::numbers::pi_v;

/// Pairs of place and heading that the second round looks at.
constexpr std::size_t kAfterViews = 900;
/// With fewer bits that stand, nearly all lies below the lidar, as in a field: hits decide then.
constexpr int kLeastBits = 10;
/// What the scan looked through and the map holds weighs so much of what both have: a car may hide
/// it, or the vehicle stand a few metres beside the place.
constexpr float kThroughWeight = 0.3F;
/// A bit is looked through when the ray ends this far behind its ring [m].
constexpr float kBehindM = 1.5F;
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

/// What a scan tells of the bits of a view: there is something, or nothing, as rays went through.
struct SeenBits {
  PlaceView stands, through;
};

std::size_t sector_of(const Eigen::Vector3f& p) {
  float azimuth_rad = std::atan2(p.y(), p.x());
  if (azimuth_rad < 0.0F) azimuth_rad += 2.0F * pi_v<float>;
  return std::min(PlaceView::kSectors - 1,
                  static_cast<std::size_t>(azimuth_rad / PlaceView::kSectorRad));
}

SeenBits seen_bits(const Query& query, const Eigen::Matrix3f& R) {
  constexpr auto& kEdges = PlaceView::kRingEdgesM;
  SeenBits seen;
  for (std::size_t i = 0; i < query.points.size(); ++i) {
    const Eigen::Vector3f p = R * query.points[i];
    const float r = p.head<2>().norm();
    const std::size_t sector = sector_of(p);
    std::size_t ring = 0;
    for (; ring < PlaceView::kRings && kEdges[ring + 1] < r - kBehindM; ++ring) {
      const float middle_m = 0.5F * (kEdges[ring] + kEdges[ring + 1]);
      if (const auto bit = PlaceView::bit_of(ring, p.z() * middle_m / r))
        seen.through.sectors[sector] |= *bit;
    }
    if (query.stands[i] == 0) continue;
    while (ring < PlaceView::kRings && kEdges[ring + 1] <= r) ++ring;
    if (ring == PlaceView::kRings || r < kEdges[ring]) continue;
    if (const auto bit = PlaceView::bit_of(ring, p.z())) seen.stands.sectors[sector] |= *bit;
  }
  for (std::size_t i = 0; i < PlaceView::kSectors; ++i)
    seen.through.sectors[i] &= ~seen.stands.sectors[i];
  return seen;
}

constexpr std::size_t kHeadings = PlaceView::kSectors;
using Scores = std::array<float, kHeadings>;

Scores scores_by_view(const SeenBits& seen, const PlaceView& view) {
  ViewHits stands_hit, through_hit;
  count_view_hits(seen.stands, view, stands_hit);
  count_view_hits(seen.through, view, through_hit);
  // A place that is full of things hits by chance.
  const float full = static_cast<float>(view.count()) / static_cast<float>(64 * kHeadings);
  const float by_chance = full * (static_cast<float>(seen.stands.count()) -
                                  kThroughWeight * static_cast<float>(seen.through.count()));
  Scores scores{};
  for (std::size_t i = 0; i < kHeadings; ++i) {
    scores[i] = static_cast<float>(stands_hit[i]) -
                kThroughWeight * static_cast<float>(through_hit[i]) - by_chance;
  }
  return scores;
}

/// Of the standing points, in the occupied cells of 2 m.
Scores scores_by_hits(const std::vector<Eigen::Vector3f>& points, const IndexWindow& window,
                      const PlaceRow& place, const Eigen::Vector3d& origin) {
  const Eigen::Isometry3f T_place = T_window_place(place, window, origin);
  PointColumns placed(points.size());
  Scores scores{};
  for (std::size_t i = 0; i < kHeadings; ++i) {
    const Eigen::Isometry3f T =
        T_place * T_place_level(0.0F, 0.0F, PlaceView::kSectorRad * static_cast<float>(i));
    for (std::size_t k = 0; k < points.size(); ++k) placed.set(k, T * points[k]);
    scores[i] =
        static_cast<float>(window.place_grids().front().hits(placed, Eigen::Vector3f::Zero()));
  }
  return scores;
}

}  // namespace

PlaceSearch::PlaceSearch(const MapIndex& index)
    : index_(index),
      places_(index.root().places),
      views_(index.root().views),
      R_level_lidar_(index.root().R_level_lidar) {}

PlaceSearch::PlaceSearch(const MapIndex& index, Places places)
    : index_(index),
      own_places_(std::move(places.rows)),
      own_views_(views_of(own_places_, index)),
      places_(own_places_),
      views_(own_views_),
      R_level_lidar_(places.R_level_lidar) {}

void PlaceSearch::keep_best(std::vector<Hypothesis>& all, std::size_t count) {
  const auto better = [](const Hypothesis& a, const Hypothesis& b) { return a.is_better_than(b); };
  if (all.size() > count) {
    std::nth_element(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(count), all.end(),
                     better);
    all.resize(count);
  }
  std::sort(all.begin(), all.end(), better);
}

std::vector<PlaceSearch::Hypothesis> PlaceSearch::best_views(
    const Query& query, const Region& region, const std::vector<Eigen::Vector3f>& points) const {
  // More than any score.
  constexpr float kNever = 1e9F;
  constexpr double kHeadingRad = 2.0 * pi_v<double> / kHeadings;
  Scores outside{};
  for (std::size_t heading = 0; heading < kHeadings; ++heading) {
    const double away_rad = std::remainder(
        kHeadingRad * static_cast<double>(heading) - region.yaw_rad, 2.0 * pi_v<double>);
    // Half a step more, so that a window between two headings is not empty.
    if (std::abs(away_rad) > region.yaw_window_rad + 0.5 * kHeadingRad) outside[heading] = kNever;
  }
  const SeenBits seen = seen_bits(query, R_level_lidar_.cast<float>());
  const bool is_low = seen.stands.count() < kLeastBits;
  WindowOfPlace windows(index_);
  std::vector<Hypothesis> best;
  float least = -0.5F * kNever;
  for (std::size_t place = 0; place < places_.size(); ++place) {
    const PlaceRow& row = places_[place];
    const Eigen::Vector2d from_corner(static_cast<double>(row.place_m[0]),
                                      static_cast<double>(row.place_m[1]));
    const Eigen::Vector2d at_map = index_.origin().head<2>() + corner_of(row.region) + from_corner;
    if ((at_map - region.centre_m).norm() > region.radius_m) continue;
    const Scores scores = is_low
                              ? scores_by_hits(points, windows.of(row.region), row, index_.origin())
                              : scores_by_view(seen, views_[place]);
    for (std::size_t heading = 0; heading < kHeadings; ++heading) {
      const float score = scores[heading] - outside[heading];
      if (score < least) continue;
      best.push_back({.place = place,
                      .yaw_rad = static_cast<float>(kHeadingRad * static_cast<double>(heading)),
                      .score = score});
    }
    if (best.size() < 4 * kAfterViews) continue;
    keep_best(best, kAfterViews);
    least = best.back().score;
  }
  keep_best(best, kAfterViews);
  return best;
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
    const Eigen::Isometry3f T_place = T_window_place(places_[h.place], window, index_.origin());
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
  std::vector<Hypothesis> all = best_views(query, region, points);
  improve(all, points, 0, {.shifts = 2, .shift_m = 2.0F, .turns = 1, .turn_rad = 0.055F});
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
  improve(apart, points, 1, {.shifts = 2, .shift_m = 0.7F, .turns = 3, .turn_rad = 0.02F});
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
