#include "roads/lane_markings.hpp"

#include <algorithm>

namespace stillmap::simulation {
namespace {

constexpr double kLineWidth = 0.12;
constexpr double kAbove = 0.003;
constexpr double kMarkPiece = 1.0;
// Dashes of 3 m every 9 m, as on European roads outside motorways.
constexpr double kDash = 3.0;
constexpr double kDashEvery = 9.0;
constexpr double kStopLine = 0.5;

class Painter {
 public:
  Painter(Mesh& mesh, const Terrain& terrain, const RoadEdge& edge)
      : mesh_(mesh), terrain_(terrain), edge_(edge) {}

  /// Stripe between two stations and two offsets, in short pieces that follow the road.
  void stripe(double begin, double end, double low, double high) {
    for (double s = begin; s < end - 1e-6; s += kMarkPiece) {
      const double next = std::min(s + kMarkPiece, end);
      if (!terrain_.covers(edge_.point(s, low)) || !terrain_.covers(edge_.point(next, high)))
        continue;
      mesh_.add_quad(at(s, low), at(next, low), at(next, high), at(s, high), Surface::kLaneMarking);
    }
  }
  void line(double begin, double end, double offset, bool dashed) {
    const double every = dashed ? kDashEvery : end - begin;
    const double length = dashed ? kDash : end - begin;
    for (double s = begin; s < end - kMarkPiece; s += every) {
      stripe(s, std::min(s + length, end), offset - 0.5 * kLineWidth, offset + 0.5 * kLineWidth);
    }
  }

 private:
  [[nodiscard]] Eigen::Vector3d at(double s, double offset) const {
    const Eigen::Vector2d p = edge_.point(s, offset);
    return {p.x(), p.y(), terrain_.height(p) + kAbove};
  }

  Mesh& mesh_;
  const Terrain& terrain_;
  const RoadEdge& edge_;
};

}  // namespace

void add_lane_markings(Mesh& mesh, const Terrain& terrain, const RoadNetwork& network) {
  for (const RoadEdge& edge : network.edges()) {
    const RoadSection& section = edge.section;
    const double begin = network.node_radius_m(edge.from) + 1.0;
    const double end = edge.length_m() - network.node_radius_m(edge.to) - 1.0;
    if (end - begin < 10.0 || section.lanes == 0) continue;
    Painter painter(mesh, terrain, edge);
    if (section.median == 0.0) painter.line(begin, end, 0.0, section.lanes == 1);
    for (const double side : {1.0, -1.0}) {
      const double first = side * 0.5 * section.median;
      for (int lane = section.median > 0.0 ? 0 : 1; lane <= section.lanes; ++lane) {
        const bool inner = lane > 0 && lane < section.lanes;
        painter.line(begin, end, first + side * lane * section.lane_width, inner);
      }
      const double low = std::min(first, first + side * section.lanes * section.lane_width);
      const double high = std::max(first, first + side * section.lanes * section.lane_width);
      // Right-hand traffic: what drives on the left side of the line arrives at its start.
      const double stop = side > 0.0 ? begin : end - kStopLine;
      const std::size_t node = side > 0.0 ? edge.from : edge.to;
      if (network.nodes()[node].edges.size() > 2) painter.stripe(stop, stop + kStopLine, low, high);
    }
  }
}

}  // namespace stillmap::simulation
