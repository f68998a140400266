#include "detection/box_fit.hpp"

#include <stillmap/maps/cell_table.hpp>

#include <tbb/parallel_for.h>
#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <utility>

namespace stillmap::mapping {
namespace {

// Weights and bounds were set on simulated validation drives (weights/README.md of voxelnext).

/// Neighbours that lend their heading: of this score, within this distance [m].
constexpr double kSureScore = 0.6;
constexpr double kNeighbourM = 30.0;
/// The weight of a neighbour falls by e over this distance [m].
constexpr double kNeighbourFadeM = 15.0;
/// Headings this close are alike [rad], and the same choice [rad].
constexpr double kAlikeRad = 0.12;
constexpr double kSameRad = 0.02;
/// Points this far beyond a box's sides may be its own [m]; likewise above, and what is left out
/// at the underside, where the ground is.
constexpr double kReachM = 0.4;
constexpr double kReachUpM = 0.3;
constexpr double kUndersideM = 0.15;
constexpr std::size_t kFewestPoints = 5;
/// Share of the way of a seen face to the nearest point: all of it where nothing hides the car.
constexpr double kPull = 0.5;
/// A face is seen when the sensor is this far beyond it [m].
constexpr double kSeenM = 0.1;
/// Points farther from a face than this are all alike [m].
constexpr double kCapM = 0.5;
/// Costs [m] of a point outside by 1 m, of a centre moved by 1 m, of a turn by a right angle, and
/// what the agreement of all neighbours is worth.
constexpr double kOutsideCost = 2.0;
constexpr double kMoveCost = 0.03;
constexpr double kTurnCost = 0.15;
constexpr double kAlikeWorth = 0.3;
/// How far sides and roof may grow [m].
constexpr double kGrowM = 0.2;

constexpr double kCellM = 2.0;

bool is_vehicle(const maps::Box& box) {
  using enum maps::ObjectClass;
  switch (box.object_class) {
    case kCar:
    case kVan:
    case kTruck:
    case kBus:
    case kTrailer:
    case kTram:
      return true;
    default:
      return false;
  }
}

Eigen::Matrix2d along_from_frame(double yaw_rad) {
  const double c = std::cos(yaw_rad), s = std::sin(yaw_rad);
  return (Eigen::Matrix2d() << c, s, -s, c).finished();
}

/// A cloud by square cells of the ground plane.
class CellsOfPoints {
 public:
  explicit CellsOfPoints(const maps::PointCloud& cloud) : cloud_(cloud) {
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const Eigen::Vector3f& p = cloud.positions[i];
      if (p.allFinite() && p.head<2>().norm() < kFarM)
        cells_[key(cell(p.x()), cell(p.y()))].push_back(static_cast<std::uint32_t>(i));
    }
  }

  struct Found {
    std::vector<Eigen::Vector3d> points;
    /// Where the lidars stand that took them, on the mean [m].
    Eigen::Vector2d lidar = Eigen::Vector2d::Zero();
  };

  /// Points in the box grown by the reaches, in order of the cells.
  [[nodiscard]] Found points_of(const maps::Box& box) const {
    Found out;
    const Eigen::Vector2d half = 0.5 * box.size_m.head<2>().array() + kReachM;
    const double r = half.norm();
    if (!(box.centre.head<2>().norm() + r < kFarM)) return out;
    const double bottom = box.centre.z() - 0.5 * box.size_m.z() + kUndersideM;
    const double top = box.centre.z() + 0.5 * box.size_m.z() + kReachUpM;
    const Eigen::Matrix2d R_along_frame = along_from_frame(box.yaw_rad);
    for (int x = cell(box.centre.x() - r); x <= cell(box.centre.x() + r); ++x) {
      for (int y = cell(box.centre.y() - r); y <= cell(box.centre.y() + r); ++y) {
        const std::vector<std::uint32_t>* here = cells_.find(key(x, y));
        if (here == nullptr) continue;
        for (const std::uint32_t i : *here) {
          const Eigen::Vector3d p = cloud_.positions[i].cast<double>();
          const Eigen::Vector2d d = R_along_frame * (p - box.centre).head<2>();
          if (!(p.z() > bottom && p.z() < top && (d.array().abs() < half.array()).all())) continue;
          out.points.push_back(p);
          out.lidar += cloud_.origin_of(i).head<2>().cast<double>();
        }
      }
    }
    out.lidar /= static_cast<double>(std::max<std::size_t>(out.points.size(), 1));
    return out;
  }

 private:
  static constexpr double kFarM = 1e4;
  static int cell(double x) { return static_cast<int>(std::floor(x / kCellM)); }
  static std::uint64_t key(int x, int y) { return maps::plane_cell_key(x, y); }

  const maps::PointCloud& cloud_;
  maps::CellMap<std::vector<std::uint32_t>> cells_;
};

/// Sine of the angle between two axes, in [0, 1].
double apart(double a_rad, double b_rad) { return std::abs(std::sin(a_rad - b_rad)); }

/// Which headings a box may have, and how many neighbours stand so.
class Headings {
 public:
  Headings(const std::vector<maps::Box>& boxes, std::size_t own) : choices_{boxes[own].yaw_rad} {
    for (std::size_t i = 0; i < boxes.size(); ++i) {
      const maps::Box& box = boxes[i];
      const double distance_m = (box.centre - boxes[own].centre).head<2>().norm();
      if (i == own || !is_vehicle(box) || !(box.score > kSureScore) || !(distance_m < kNeighbourM))
        continue;
      neighbours_.push_back({box.yaw_rad, box.score * std::exp(-distance_m / kNeighbourFadeM)});
      add(box.yaw_rad);
      add(box.yaw_rad + 0.5 * std::numbers::pi);
    }
  }
  [[nodiscard]] const std::vector<double>& choices() const { return choices_; }

  /// In [0, 1): 1 when many near neighbours stand along it.
  [[nodiscard]] double support(double yaw_rad) const {
    // So that one far neighbour does not decide.
    constexpr double kDoubt = 0.3;
    double sum = 0.0, weights = kDoubt;
    for (const auto& [theirs_rad, weight] : neighbours_) {
      const double sine = apart(theirs_rad, yaw_rad) / kAlikeRad;
      sum += weight * std::exp(-sine * sine);
      weights += weight;
    }
    return sum / weights;
  }

 private:
  void add(double yaw_rad) {
    if (std::ranges::all_of(choices_,
                            [&](double known) { return apart(known, yaw_rad) > kSameRad; }))
      choices_.push_back(yaw_rad);
  }

  std::vector<double> choices_;
  std::vector<std::pair<double, double>> neighbours_;
};

struct Placement {
  double yaw_rad = 0.0;
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  double cost = 0.0;
};

/// Bounds of points along and across a heading.
struct Bounds {
  Eigen::Array2d low = Eigen::Array2d::Constant(1e9), high = Eigen::Array2d::Constant(-1e9);
  void extend(const Eigen::Vector2d& along) {
    low = low.min(along.array());
    high = high.max(along.array());
  }
};

/// The box at a heading, moved as its points ask.
Placement place(const maps::Box& box, const CellsOfPoints::Found& found, double yaw_rad) {
  const std::vector<Eigen::Vector3d>& points = found.points;
  const Eigen::Matrix2d R_along_frame = along_from_frame(yaw_rad);
  std::vector<Eigen::Vector2d> along;
  along.reserve(points.size());
  Bounds bounds;
  for (const Eigen::Vector3d& p : points) {
    along.emplace_back(R_along_frame * p.head<2>());
    bounds.extend(along.back());
  }
  const Eigen::Vector2d half = 0.5 * box.size_m.head<2>();
  const Eigen::Vector2d before = R_along_frame * box.centre.head<2>();
  Eigen::Vector2d centre = before;
  const Eigen::Vector2d lidar = R_along_frame * found.lidar;
  std::array<bool, 2> seen{};
  Eigen::Vector2d face = Eigen::Vector2d::Zero();
  for (Eigen::Index a = 0; a < 2; ++a) {
    const double low = bounds.low[a], high = bounds.high[a];
    centre[a] = high - low <= 2.0 * half[a] ? std::clamp(centre[a], high - half[a], low + half[a])
                                            : 0.5 * (low + high);
    if (!(std::abs(centre[a] - lidar[a]) > half[a] + kSeenM)) continue;
    seen[static_cast<std::size_t>(a)] = true;
    const double to_sensor = centre[a] > lidar[a] ? -1.0 : 1.0;
    const double beyond = centre[a] + to_sensor * half[a] - (to_sensor > 0.0 ? high : low);
    centre[a] -= kPull * beyond;
    face[a] = centre[a] + to_sensor * half[a];
  }
  double cost = 0.0;
  for (const Eigen::Vector2d& p : along) {
    double to_face = kCapM;
    for (Eigen::Index a = 0; a < 2; ++a) {
      if (seen[static_cast<std::size_t>(a)]) to_face = std::min(to_face, std::abs(p[a] - face[a]));
    }
    const double outside = ((p - centre).cwiseAbs() - half).maxCoeff();
    cost += to_face + kOutsideCost * std::clamp(outside, 0.0, kCapM);
  }
  cost /= static_cast<double>(along.size());
  cost += kMoveCost * (centre - before).norm();
  return {yaw_rad, R_along_frame.transpose() * centre, cost};
}

Placement best_placement(const maps::Box& box, const CellsOfPoints::Found& points,
                         const Headings& headings) {
  Placement best;
  for (const double yaw_rad : headings.choices()) {
    Placement placement = place(box, points, yaw_rad);
    const double turn = apart(yaw_rad, box.yaw_rad);
    placement.cost += kTurnCost * turn * turn - kAlikeWorth * headings.support(yaw_rad);
    if (yaw_rad == box.yaw_rad || placement.cost < best.cost) best = placement;
  }
  return best;
}

/// Of two opposite headings the one nearer to what was said.
double facing(double yaw_rad, double said_rad) {
  const double turned = std::cos(yaw_rad - said_rad) < 0.0 ? yaw_rad + std::numbers::pi : yaw_rad;
  return std::remainder(turned, 2.0 * std::numbers::pi);
}

/// Moves sides and roof out to the points.
void enclose(maps::Box& box, const std::vector<Eigen::Vector3d>& points) {
  const Eigen::Matrix2d R_along_frame = along_from_frame(box.yaw_rad);
  const Eigen::Array2d half = 0.5 * box.size_m.head<2>();
  const double roof = box.centre.z() + 0.5 * box.size_m.z();
  Bounds bounds{-half, half};
  double top = roof;
  for (const Eigen::Vector3d& p : points) {
    const Eigen::Vector2d along = R_along_frame * (p - box.centre).head<2>();
    if (!(along.array().abs() <= half + kGrowM).all() || !(p.z() <= roof + kGrowM)) continue;
    bounds.extend(along);
    top = std::max(top, p.z());
  }
  const Eigen::Vector2d shift = 0.5 * (bounds.low + bounds.high);
  box.centre.head<2>() += R_along_frame.transpose() * shift;
  box.size_m.head<2>() = bounds.high - bounds.low;
  box.centre.z() += 0.5 * (top - roof);
  box.size_m.z() += top - roof;
}

}  // namespace

void fit_to_points(std::vector<maps::Box>& boxes, const maps::PointCloud& cloud) {
  if (std::ranges::none_of(boxes, is_vehicle)) return;
  const CellsOfPoints cells(cloud);
  const std::vector<maps::Box> said = boxes;
  tbb::parallel_for(std::size_t{0}, boxes.size(), [&](std::size_t i) {
    maps::Box& box = boxes[i];
    if (!is_vehicle(box)) return;
    const CellsOfPoints::Found points = cells.points_of(box);
    if (points.points.size() < kFewestPoints) return;
    const Placement placement = best_placement(box, points, Headings(said, i));
    box.centre.head<2>() = placement.centre;
    box.yaw_rad = facing(placement.yaw_rad, box.yaw_rad);
    enclose(box, cells.points_of(box).points);
  });
}

}  // namespace stillmap::mapping
