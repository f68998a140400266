#include "roads/road_network.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace stillmap::simulation {
namespace {

constexpr double kStep = 2.0;
constexpr double kCell = 16.0;
// Kerbs at a corner follow a curve of about this radius.
constexpr double kCornerRadius = 5.0;

/// Smaller of two distances, rounded where they are nearly equal (polynomial smooth minimum).
double smooth_min(double a, double b, double radius) {
  const double h = std::max(radius - std::abs(a - b), 0.0) / radius;
  return std::min(a, b) - 0.25 * h * h * radius;
}

Eigen::Vector2d direction(double heading) { return {std::cos(heading), std::sin(heading)}; }

/// Index of the piece that holds a station, and how far into it, in [0, 1].
std::pair<std::size_t, double> piece_at(const RoadEdge& edge, double station) {
  const double s = std::clamp(station, 0.0, edge.length_m());
  const auto after = std::upper_bound(edge.stations_m.begin() + 1, edge.stations_m.end() - 1, s);
  const auto i = static_cast<std::size_t>(after - edge.stations_m.begin()) - 1;
  return {i, (s - edge.stations_m[i]) / (edge.stations_m[i + 1] - edge.stations_m[i])};
}

}  // namespace

double parking_depth(ParkingKind kind) {
  switch (kind) {
    case ParkingKind::kParallel:
      return 2.1;
    case ParkingKind::kAngled:
      return 4.6;
    case ParkingKind::kPerpendicular:
      return 5.0;
    case ParkingKind::kHalfOnPavement:
      return 1.1;
    case ParkingKind::kNone:
      break;
  }
  return 0.0;
}

double RoadEdge::half_width(int side) const {
  return 0.5 * section.median + section.lanes * section.lane_width + section.shoulder +
         parking_depth(section.parking.at(static_cast<std::size_t>(side)));
}

double RoadEdge::heading_rad(double station_m) const {
  // Between the headings of the neighbouring pieces, so that nothing jumps at a point.
  const auto [i, share] = piece_at(*this, station_m);
  const auto slope = [&](std::size_t piece) {
    const std::size_t k = std::min(piece, points.size() - 2);
    return Eigen::Vector2d((points[k + 1] - points[k]).normalized());
  };
  const double t = share - 0.5;
  const std::size_t other = t < 0.0 ? (i > 0 ? i - 1 : 0) : i + 1;
  const Eigen::Vector2d d = (1.0 - std::abs(t)) * slope(i) + std::abs(t) * slope(other);
  return std::atan2(d.y(), d.x());
}

Eigen::Vector2d RoadEdge::point(double station_m, double offset_m) const {
  const auto [i, share] = piece_at(*this, station_m);
  const double heading = heading_rad(station_m);
  return points[i] + share * (points[i + 1] - points[i]) +
         offset_m * Eigen::Vector2d(-std::sin(heading), std::cos(heading));
}

bool RoadEdge::has_drive(int side, double station_m) const {
  const auto& list = drives.at(static_cast<std::size_t>(side));
  return std::any_of(list.begin(), list.end(), [&](const std::array<double, 2>& d) {
    return station_m > d[0] && station_m < d[1];
  });
}

std::size_t RoadNetwork::add_node(const Eigen::Vector2d& position) {
  nodes_.push_back({position, {}});
  return nodes_.size() - 1;
}

std::size_t RoadNetwork::add_edge(std::size_t from, std::size_t to,
                                  std::array<double, 2> headings_rad, const RoadSection& section) {
  RoadEdge edge{
      .from = from, .to = to, .section = section, .points = {}, .stations_m = {}, .drives = {}};
  const Eigen::Vector2d a = nodes_.at(from).position;
  const Eigen::Vector2d b = nodes_.at(to).position;
  const double span = (b - a).norm();
  const Eigen::Vector2d va = span * direction(headings_rad[0]);
  const Eigen::Vector2d vb = span * direction(headings_rad[1]);
  const int count = std::max(4, static_cast<int>(std::ceil(span / kStep)));
  for (int i = 0; i <= count; ++i) {
    // Cubic Hermite curve.
    const double t = static_cast<double>(i) / count;
    const double t2 = t * t;
    const double t3 = t2 * t;
    edge.points.emplace_back((2 * t3 - 3 * t2 + 1) * a + (t3 - 2 * t2 + t) * va +
                             (3 * t2 - 2 * t3) * b + (t3 - t2) * vb);
    const double step =
        i == 0 ? 0.0 : (edge.points.back() - edge.points[edge.points.size() - 2]).norm();
    edge.stations_m.push_back(i == 0 ? 0.0 : edge.stations_m.back() + step);
  }
  edges_.push_back(std::move(edge));
  nodes_[from].edges.push_back(edges_.size() - 1);
  nodes_[to].edges.push_back(edges_.size() - 1);
  return edges_.size() - 1;
}

void RoadNetwork::finish() {
  Eigen::AlignedBox2d bounds;
  for (const RoadEdge& edge : edges_) {
    for (const Eigen::Vector2d& p : edge.points) bounds.extend(p);
  }
  low_ = bounds.min() - Eigen::Vector2d::Constant(kReach);
  for (int axis = 0; axis < 2; ++axis) {
    cells_.at(static_cast<std::size_t>(axis)) =
        static_cast<std::int64_t>((bounds.sizes()[axis] + 2.0 * kReach) / kCell) + 1;
  }
  stretches_.assign(static_cast<std::size_t>(cells_[0] * cells_[1]), {});
  for (std::uint32_t e = 0; e < edges_.size(); ++e) add_stretches(e);
  for (Node& node : nodes_) {
    const auto angle = [&](std::size_t e) {
      const RoadEdge& edge = edges_[e];
      const bool starts = nodes_[edge.from].position == node.position;
      const Eigen::Vector2d out =
          (starts ? edge.points[1] : edge.points[edge.points.size() - 2]) - node.position;
      return std::atan2(out.y(), out.x());
    };
    std::sort(node.edges.begin(), node.edges.end(),
              [&](std::size_t a, std::size_t b) { return angle(a) < angle(b); });
  }
}

void RoadNetwork::add_stretches(std::uint32_t e) {
  // Of the edge the points near the one that is nearest to a cell: within the cell the foot moves
  // no farther than that.
  constexpr std::uint32_t kAround = 14;
  const auto& points = edges_[e].points;
  Eigen::AlignedBox2d bounds;
  for (const Eigen::Vector2d& p : points) bounds.extend(p);
  const auto cell = [&](double value, int axis) {
    const auto c = static_cast<std::int64_t>(std::floor((value - low_[axis]) / kCell));
    return std::clamp<std::int64_t>(c, 0, cells_.at(static_cast<std::size_t>(axis)) - 1);
  };
  for (std::int64_t y = cell(bounds.min().y() - kReach, 1); y <= cell(bounds.max().y() + kReach, 1);
       ++y) {
    for (std::int64_t x = cell(bounds.min().x() - kReach, 0);
         x <= cell(bounds.max().x() + kReach, 0); ++x) {
      const Eigen::Vector2d middle = low_ + kCell * Eigen::Vector2d(static_cast<double>(x) + 0.5,
                                                                    static_cast<double>(y) + 0.5);
      const auto nearest =
          std::min_element(points.begin(), points.end(), [&](const auto& a, const auto& b) {
            return (a - middle).squaredNorm() < (b - middle).squaredNorm();
          });
      if ((*nearest - middle).norm() > kReach + kCell) continue;
      const auto at = static_cast<std::uint32_t>(nearest - points.begin());
      stretches_[static_cast<std::size_t>(y * cells_[0] + x)].push_back(
          {e, at - std::min(at, kAround),
           std::min(at + kAround, static_cast<std::uint32_t>(points.size() - 1))});
    }
  }
}

std::optional<std::size_t> RoadNetwork::edge_between(std::size_t a, std::size_t b) const {
  for (const std::size_t e : nodes_.at(a).edges) {
    if ((edges_[e].from == a && edges_[e].to == b) || (edges_[e].from == b && edges_[e].to == a))
      return e;
  }
  return std::nullopt;
}

double RoadNetwork::node_radius_m(std::size_t node) const {
  double widest = 0.0;
  for (const std::size_t e : nodes_.at(node).edges) {
    widest = std::max({widest, edges_[e].half_width(0), edges_[e].half_width(1)});
  }
  return nodes_.at(node).edges.size() > 2 ? widest + kCornerRadius : 0.0;
}

namespace {

/// Nearest point of an edge.
struct Foot {
  double station_m = 0.0;
  double offset_m = 0.0;
  double distance_m = std::numeric_limits<double>::max();
  /// From there to the point that was asked for.
  Eigen::Vector2d to = Eigen::Vector2d::Zero();
};

Foot foot_on(const RoadEdge& edge, std::size_t begin, std::size_t end, const Eigen::Vector2d& p) {
  Foot foot;
  for (std::size_t i = begin; i < end; ++i) {
    const Eigen::Vector2d along = edge.points[i + 1] - edge.points[i];
    const Eigen::Vector2d from = p - edge.points[i];
    const double t = std::clamp(from.dot(along) / along.squaredNorm(), 0.0, 1.0);
    const Eigen::Vector2d to = from - t * along;
    const double distance = to.norm();
    if (distance >= foot.distance_m) continue;
    const double side = along.x() * from.y() - along.y() * from.x() >= 0.0 ? 1.0 : -1.0;
    foot = {edge.stations_m[i] + t * (edge.stations_m[i + 1] - edge.stations_m[i]), side * distance,
            distance, to};
  }
  return foot;
}

/// Distance to two carriageways together. Where they cross, the kerb between them is rounded; where
/// one goes on as the other it is not.
double joined(double a, const Eigen::Vector2d& to_a, double b, const Eigen::Vector2d& to_b) {
  const double product = to_a.norm() * to_b.norm();
  const double cosine = product > 1e-9 ? to_a.dot(to_b) / product : 1.0;
  const double radius = kCornerRadius * (1.0 - std::max(cosine, 0.0) * std::max(cosine, 0.0));
  return radius > 1e-3 ? smooth_min(a, b, radius) : std::min(a, b);
}

}  // namespace

std::int64_t RoadNetwork::cell_of(const Eigen::Vector2d& p) const {
  const auto x = static_cast<std::int64_t>(std::floor((p.x() - low_.x()) / kCell));
  const auto y = static_cast<std::int64_t>(std::floor((p.y() - low_.y()) / kCell));
  if (x < 0 || y < 0 || x >= cells_[0] || y >= cells_[1]) return -1;
  return y * cells_[0] + x;
}

std::optional<RoadPlace> RoadNetwork::place(const Eigen::Vector2d& p) const {
  const std::int64_t cell = cell_of(p);
  if (cell < 0) return std::nullopt;
  std::optional<RoadPlace> place;
  Eigen::Vector2d to = Eigen::Vector2d::Zero();
  for (const Stretch& stretch : stretches_[static_cast<std::size_t>(cell)]) {
    const RoadEdge& edge = edges_[stretch.edge];
    const Foot foot = foot_on(edge, stretch.begin, stretch.end, p);
    const double outside = foot.distance_m - edge.half_width(foot.offset_m > 0.0 ? 0 : 1);
    const double both = place ? joined(place->outside_m, to, outside, foot.to) : outside;
    if (!place || outside < place->outside_m) {
      place = RoadPlace{stretch.edge, foot.station_m, foot.offset_m, outside};
      to = foot.to;
    }
    place->outside_m = both;
  }
  return place;
}

}  // namespace stillmap::simulation
