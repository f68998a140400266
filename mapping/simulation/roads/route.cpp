#include "roads/route.hpp"

#include <cmath>
#include <stdexcept>

namespace stillmap::simulation {
namespace {

/// Where a lane begins and ends between its crossings, in the direction of driving.
struct LaneEnd {
  Eigen::Vector2d point;
  Eigen::Vector2d direction;
};

LaneEnd lane_at(const RoadEdge& edge, const Leg& leg, int lane, double station) {
  const double heading = edge.heading_rad(station);
  const Eigen::Vector2d along(std::cos(heading), std::sin(heading));
  return {edge.point(station, lane_offset_m(edge.section, lane, leg.forward)),
          leg.forward ? along : Eigen::Vector2d(-along)};
}

/// Turn from one lane into the next: cubic Hermite curve.
void add_turn(std::vector<Eigen::Vector2d>& points, const LaneEnd& a, const LaneEnd& b) {
  const double reach = (b.point - a.point).norm();
  if (reach < 0.5) return;
  const int count = std::max(2, static_cast<int>(reach));
  for (int i = 1; i < count; ++i) {
    const double t = static_cast<double>(i) / count;
    const double t2 = t * t;
    const double t3 = t2 * t;
    points.emplace_back((2 * t3 - 3 * t2 + 1) * a.point + (t3 - 2 * t2 + t) * reach * a.direction +
                        (3 * t2 - 2 * t3) * b.point + (t3 - t2) * reach * b.direction);
  }
}

}  // namespace

double lane_offset_m(const RoadSection& section, int lane, bool forward) {
  const double right = 0.5 * section.median + (lane + 0.5) * section.lane_width;
  return forward ? -right : right;
}

std::vector<Leg> legs_through(const RoadNetwork& network, std::span<const std::size_t> nodes) {
  std::vector<Leg> legs;
  for (std::size_t i = 0; i + 1 < nodes.size(); ++i) {
    const auto edge = network.edge_between(nodes[i], nodes[i + 1]);
    if (!edge) throw std::invalid_argument("a route leads over nodes that no road connects");
    legs.push_back({*edge, network.edges()[*edge].from == nodes[i]});
  }
  return legs;
}

Route make_route(const RoadNetwork& network, std::span<const Leg> legs, int lane) {
  Route route;
  std::vector<Eigen::Vector2d> points;
  double length = 0.0;
  for (std::size_t i = 0; i < legs.size(); ++i) {
    const Leg& leg = legs[i];
    const RoadEdge& edge = network.edges().at(leg.edge);
    const std::size_t last_node = leg.forward ? edge.to : edge.from;
    double begin = network.node_radius_m(edge.from);
    double end = edge.length_m() - network.node_radius_m(edge.to);
    if (!leg.forward) std::swap(begin, end);
    const LaneEnd first = lane_at(edge, leg, lane, begin);
    if (!points.empty()) {
      const Leg& before = legs[i - 1];
      const RoadEdge& from = network.edges()[before.edge];
      const double there = before.forward ? from.length_m() - network.node_radius_m(from.to)
                                          : network.node_radius_m(from.from);
      add_turn(points, lane_at(from, before, lane, there), first);
    }
    const int count = std::max(1, static_cast<int>(std::abs(end - begin)));
    for (int k = 0; k <= count; ++k) {
      points.push_back(lane_at(edge, leg, lane, begin + (end - begin) * k / count).point);
    }
    length = 0.0;
    for (std::size_t k = 1; k < points.size(); ++k) length += (points[k] - points[k - 1]).norm();
    if (i + 1 < legs.size() && network.nodes()[last_node].edges.size() > 2) {
      route.stops.push_back({length - 1.0, last_node, leg.edge});
    }
  }
  route.path = std::make_shared<Path>(points);
  return route;
}

}  // namespace stillmap::simulation
