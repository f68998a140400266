#pragma once

#include <Eigen/Geometry>

#include <array>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace stillmap::simulation {

/// How vehicles are parked along one side of a road.
enum class ParkingKind { kNone, kParallel, kHalfOnPavement, kAngled, kPerpendicular };

/// Measures across a road [m]; sides are {left, right} of the middle line.
struct RoadSection {
  /// Lanes in each direction, and how wide they are.
  int lanes = 1;
  double lane_width = 3.1;
  /// Strip between the directions.
  double median = 0.0;
  std::array<ParkingKind, 2> parking{ParkingKind::kNone, ParkingKind::kNone};
  /// Beside the lanes, before the kerb: hard shoulder, or the apron of a yard.
  double shoulder = 0.3;
  double kerb_height = 0.12;
  /// 0 where there is none.
  double pavement_width = 2.4;
};

/// Depth of a parking strip [m], 0 for what is not on the carriageway.
[[nodiscard]] double parking_depth(ParkingKind kind);

/// Middle line of a road between two nodes, in steps of `kStep`.
struct RoadEdge {
  std::size_t from = 0;
  std::size_t to = 0;
  RoadSection section;
  std::vector<Eigen::Vector2d> points;
  /// Length up to each point [m].
  std::vector<double> stations_m;
  /// Lowered kerbs {begin, end} on each side, by station.
  std::array<std::vector<std::array<double, 2>>, 2> drives;

  [[nodiscard]] double length_m() const { return stations_m.back(); }
  /// From the middle line to the carriageway's edge; side 0 left, 1 right.
  [[nodiscard]] double half_width(int side) const;
  /// Point at a station (clamped), offset to the left; and the line's heading there.
  [[nodiscard]] Eigen::Vector2d point(double station_m, double offset_m = 0.0) const;
  [[nodiscard]] double heading_rad(double station_m) const;
  [[nodiscard]] bool has_drive(int side, double station_m) const;
};

/// Where a point lies against the nearest road.
struct RoadPlace {
  std::size_t edge = 0;
  double station_m = 0.0;
  /// To the left of the middle line.
  double offset_m = 0.0;
  /// To the edge of the carriageways' union, negative on them; corners are rounded.
  double outside_m = 0.0;
};

/// Roads that meet at nodes. World frame: x east, y north.
class RoadNetwork {
 public:
  struct Node {
    Eigen::Vector2d position = Eigen::Vector2d::Zero();
    /// Edges that end here, counter-clockwise.
    std::vector<std::size_t> edges;
  };

  std::size_t add_node(const Eigen::Vector2d& position);
  /// A curve that leaves `from` and arrives at `to` with these headings [rad].
  std::size_t add_edge(std::size_t from, std::size_t to, std::array<double, 2> headings_rad,
                       const RoadSection& section);
  /// To be called once all edges are there, before any question.
  void finish();

  [[nodiscard]] const std::vector<Node>& nodes() const { return nodes_; }
  [[nodiscard]] const std::vector<RoadEdge>& edges() const { return edges_; }
  [[nodiscard]] std::vector<RoadEdge>& edges() { return edges_; }
  /// Edge between two nodes, if there is one.
  [[nodiscard]] std::optional<std::size_t> edge_between(std::size_t a, std::size_t b) const;
  /// Distance from a node at which all its roads have parted [m]; 0 where a road only goes on or
  /// ends.
  [[nodiscard]] double node_radius_m(std::size_t node) const;
  /// Nothing farther than `kReach` from every road.
  [[nodiscard]] std::optional<RoadPlace> place(const Eigen::Vector2d& p) const;

  static constexpr double kReach = 90.0;

 private:
  void add_stretches(std::uint32_t edge);
  [[nodiscard]] std::int64_t cell_of(const Eigen::Vector2d& p) const;

  std::vector<Node> nodes_;
  std::vector<RoadEdge> edges_;
  /// For each cell of a grid over all roads: edges with a point within reach, and between which
  /// points.
  struct Stretch {
    std::uint32_t edge, begin, end;
  };
  Eigen::Vector2d low_ = Eigen::Vector2d::Zero();
  std::array<std::int64_t, 2> cells_{};
  std::vector<std::vector<Stretch>> stretches_;
};

}  // namespace stillmap::simulation
