#include "odometry/loam/previous_sweep.hpp"

#include <nanoflann.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <numeric>
#include <utility>

namespace stillmap::mapping::loam {
namespace {

constexpr std::size_t kLeafPoints = 12;
/// Points that belong together lie nearer [m].
constexpr float kMaxDistanceM = 3.0F;
/// Rings on either side that count as beside.
constexpr std::uint32_t kRingsBeside = 2;
constexpr std::uint32_t kNoPoint = std::numeric_limits<std::uint32_t>::max();
constexpr float kFullTurnRad = 2.0F * std::numbers::pi_v<float>;
constexpr float kRightAngleRad = 0.25F * kFullTurnRad;

float azimuth_of(const Eigen::Vector3f& p) { return std::atan2(p.y(), p.x()); }

}  // namespace

/// Points and a search tree that looks at them; they stay in place when the owner is moved.
struct RingSearch::Tree {
  struct View {
    std::vector<Eigen::Vector3f> points;
    [[nodiscard]] std::size_t kdtree_get_point_count() const { return points.size(); }
    [[nodiscard]] float kdtree_get_pt(std::size_t i, std::size_t axis) const {
      return points[i][static_cast<Eigen::Index>(axis)];
    }
    template <typename Box>
    bool kdtree_get_bbox(Box& /*box*/) const {
      return false;
    }
  };
  using Index = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, View>, View,
                                                    3, std::uint32_t>;

  explicit Tree(std::vector<Eigen::Vector3f> points)
      : view{std::move(points)},
        index(3, view, nanoflann::KDTreeSingleIndexAdaptorParams(kLeafPoints)) {
    if (!view.points.empty()) index.buildIndex();
  }
  View view;
  Index index;
};

RingSearch::~RingSearch() = default;
RingSearch::RingSearch(RingSearch&&) noexcept = default;
RingSearch& RingSearch::operator=(RingSearch&&) noexcept = default;

RingSearch::RingSearch(std::span<const Feature> features) {
  std::vector<float> azimuths;
  for (const Feature& f : features) azimuths.push_back(azimuth_of(f.position));
  std::vector<std::uint32_t> order(features.size());
  std::iota(order.begin(), order.end(), 0U);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    if (features[a].ring != features[b].ring) return features[a].ring < features[b].ring;
    return azimuths[a] < azimuths[b] || (azimuths[a] == azimuths[b] && a < b);
  });
  std::vector<Eigen::Vector3f> points;
  for (const std::uint32_t i : order) {
    const Feature& f = features[i];
    while (starts_.size() <= f.ring) starts_.push_back(static_cast<std::uint32_t>(points.size()));
    points.push_back(f.position);
    rings_.push_back(f.ring);
    azimuths_.push_back(azimuths[i]);
  }
  starts_.push_back(static_cast<std::uint32_t>(points.size()));
  tree_ = std::make_unique<Tree>(std::move(points));
}

const Eigen::Vector3f& RingSearch::point(std::uint32_t index) const {
  return tree_->view.points[index];
}

std::optional<RingSearch::Found> RingSearch::nearest(const Eigen::Vector3f& X) const {
  if (azimuths_.empty()) return std::nullopt;
  Found found;
  if (tree_->index.knnSearch(X.data(), 1, &found.index, &found.squared) == 0) return std::nullopt;
  if (!(found.squared < kMaxDistanceM * kMaxDistanceM)) return std::nullopt;
  return found;
}

std::optional<RingSearch::Found> RingSearch::nearest_in_ring(const Eigen::Vector3f& X,
                                                             std::uint32_t ring,
                                                             std::uint32_t except) const {
  const std::uint32_t first = starts_[ring];
  const std::uint32_t count = starts_[ring + 1] - first;
  if (count == 0) return std::nullopt;
  const float azimuth = azimuth_of(X);
  const float level = X.head<2>().norm();
  const auto at =
      std::lower_bound(azimuths_.begin() + first, azimuths_.begin() + first + count, azimuth);
  const auto middle = static_cast<std::uint32_t>(at - azimuths_.begin()) - first;
  Found best{0, kMaxDistanceM * kMaxDistanceM};
  bool any = false;
  // Outward on either side. A point whose azimuth is off by a is at least |X_xy| sin a away.
  for (const int direction : {1, -1}) {
    std::uint32_t k = direction > 0 ? middle % count : (middle + count - 1) % count;
    for (std::uint32_t steps = 0; steps < count; ++steps) {
      const std::uint32_t i = first + k;
      const float off = std::abs(std::remainder(azimuths_[i] - azimuth, kFullTurnRad));
      const float across = off < kRightAngleRad ? level * std::sin(off) : level;
      if (across * across > best.squared) break;
      const float squared = (point(i) - X).squaredNorm();
      if (squared < best.squared && i != except) {
        best = {i, squared};
        any = true;
      }
      k = direction > 0 ? (k + 1) % count : (k + count - 1) % count;
    }
  }
  return any ? std::optional(best) : std::nullopt;
}

std::optional<RingSearch::Found> RingSearch::nearest_beside(const Eigen::Vector3f& X,
                                                            std::uint32_t ring) const {
  std::optional<Found> best;
  const auto rings = static_cast<std::uint32_t>(starts_.size()) - 1;
  const std::uint32_t last = std::min(ring + kRingsBeside, rings - 1);
  for (std::uint32_t r = ring - std::min(ring, kRingsBeside); r <= last; ++r) {
    if (r == ring) continue;
    const auto found = nearest_in_ring(X, r, kNoPoint);
    if (found && (!best || found->squared < best->squared)) best = found;
  }
  return best;
}

std::optional<Surface> RingSearch::line_near(const Eigen::Vector3f& X) const {
  const auto j = nearest(X);
  if (!j) return std::nullopt;
  const auto l = nearest_beside(X, rings_[j->index]);
  if (!l) return std::nullopt;
  return line_through(point(j->index).cast<double>(), point(l->index).cast<double>());
}

std::optional<Surface> RingSearch::plane_near(const Eigen::Vector3f& X) const {
  const auto j = nearest(X);
  if (!j) return std::nullopt;
  const auto l = nearest_in_ring(X, rings_[j->index], j->index);
  const auto m = nearest_beside(X, rings_[j->index]);
  if (!l || !m) return std::nullopt;
  return plane_through(point(j->index).cast<double>(), point(l->index).cast<double>(),
                       point(m->index).cast<double>());
}

}  // namespace stillmap::mapping::loam
