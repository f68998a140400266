#include "ground/growing_ground.hpp"

#include "ground/seed_plane.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace stillmap::mapping {
namespace {

constexpr int kSide = HeightGrid::kCellsPerSide;
constexpr int kCellCount = kSide * kSide;
/// Steepest ground in the lidar frame: 10 % of street, some degrees of tilt, and a ramp beside it.
constexpr double kMaxSlope = 0.35;
/// A kerb and the noise on it [m]; what sticks out more within a cell or two is an object.
constexpr double kStepM = 0.2;
constexpr int kFillReach = 8;

/// Points of the cloud grouped by cell.
struct Cells {
  std::vector<int> first = std::vector<int>(kCellCount + 1, 0);
  std::vector<Eigen::Vector3f> points;
  /// Occupied cells from near to far.
  std::vector<int> near_to_far;

  [[nodiscard]] int count(int cell) const {
    return first[static_cast<std::size_t>(cell) + 1] - first[static_cast<std::size_t>(cell)];
  }
  [[nodiscard]] const Eigen::Vector3f* begin(int cell) const {
    return points.data() + first[static_cast<std::size_t>(cell)];
  }
  [[nodiscard]] const Eigen::Vector3f* end(int cell) const {
    return points.data() + first[static_cast<std::size_t>(cell) + 1];
  }
};

[[nodiscard]] Cells group(const maps::PointCloud& cloud) {
  Cells cells;
  std::vector<int> cell_of_point(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const int cell = HeightGrid::index_of(cloud.positions[i].x(), cloud.positions[i].y());
    cell_of_point[i] = cell;
    if (cell >= 0) ++cells.first[static_cast<std::size_t>(cell) + 1];
  }
  std::partial_sum(cells.first.begin(), cells.first.end(), cells.first.begin());
  cells.points.resize(static_cast<std::size_t>(cells.first.back()));
  std::vector<int> next(cells.first.begin(), cells.first.end() - 1);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (cell_of_point[i] < 0) continue;
    int& slot = next[static_cast<std::size_t>(cell_of_point[i])];
    cells.points[static_cast<std::size_t>(slot++)] = cloud.positions[i];
  }
  for (int cell = 0; cell < kCellCount; ++cell) {
    if (cells.count(cell) > 0) cells.near_to_far.push_back(cell);
  }
  const auto squared_range = [](int cell) {
    // Twice the centre's coordinates are integers, so equal ranges tie exactly.
    const int x = 2 * (cell % kSide) + 1 - kSide;
    const int y = 2 * (cell / kSide) + 1 - kSide;
    return x * x + y * y;
  };
  std::stable_sort(cells.near_to_far.begin(), cells.near_to_far.end(),
                   [&](int a, int b) { return squared_range(a) < squared_range(b); });
  return cells;
}

[[nodiscard]] double range_of(int cell) {
  return std::hypot(HeightGrid::centre_x(cell), HeightGrid::centre_y(cell));
}

/// Lowest point of each cell within `max_range_m`, or the second lowest where there are several.
[[nodiscard]] std::vector<Eigen::Vector3d> low_points(const Cells& cells, double max_range_m) {
  std::vector<Eigen::Vector3d> lows;
  for (const int cell : cells.near_to_far) {
    if (range_of(cell) > max_range_m) break;
    std::vector<Eigen::Vector3f> points(cells.begin(cell), cells.end(cell));
    const std::size_t rank = points.size() >= 4 ? 1 : 0;
    std::nth_element(points.begin(), points.begin() + static_cast<std::ptrdiff_t>(rank),
                     points.end(), [](const auto& a, const auto& b) { return a.z() < b.z(); });
    lows.push_back(points[rank].cast<double>());
  }
  return lows;
}

[[nodiscard]] std::optional<SeedPlane> seed(const Cells& cells) {
  // Near cells first: farther out the street may bend away from any one plane.
  for (const double max_range_m : {12.0, 25.0, 60.0}) {
    const auto lows = low_points(cells, max_range_m);
    if (lows.size() < 40 && max_range_m < 60.0) continue;
    if (const auto plane = find_seed_plane(lows)) return plane;
  }
  return std::nullopt;
}

/// What the ground around a cell says about it.
struct Prediction {
  double z = 0.0;
  Eigen::Vector2d slope = Eigen::Vector2d::Zero();
  int supports = 0;
  /// Distance to the nearest support [m].
  double gap_m = 0.0;
};

class Growth {
 public:
  Growth(const Cells& cells, const SeedPlane& plane, HeightGrid& grid)
      : cells_(cells), plane_(plane), grid_(grid) {}

  void run() {
    for (const int cell : cells_.near_to_far) {
      if (range_of(cell) > 12.0) break;
      const double x = HeightGrid::centre_x(cell);
      const double y = HeightGrid::centre_y(cell);
      accept(cell, Prediction{plane_.z_at(x, y), plane_.slope, 1, 0.0}, 0.12);
    }
    // The second round reaches what lies behind obstacles, from the side and from beyond.
    for (int round = 0; round < 2; ++round) grow();
    take_back_outliers();
  }

 private:
  void grow() {
    for (const int cell : cells_.near_to_far) {
      if (grid_.node(cell).confidence > 0.0F) continue;
      Prediction prediction = predict(cell);
      if (prediction.supports == 0) prediction = predict_along_ray(cell);
      if (prediction.supports == 0) continue;
      accept(cell, prediction, std::min(0.4, kStepM + 0.015 * prediction.gap_m));
    }
  }

  /// Cells searched around one: the rings of a spinning sensor part with the range.
  [[nodiscard]] static int window(double range_m) {
    return std::clamp(static_cast<int>(0.2 * range_m), 2, 6);
  }

  /// Weighted plane through the ground found around a cell, itself left out. The slope is drawn to
  /// the mean slope of those cells, without which a single ring would leave it free across.
  [[nodiscard]] Prediction predict(int cell) const {
    const int cx = cell % kSide;
    const int cy = cell / kSide;
    const int reach = window(range_of(cell));
    Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    Eigen::Vector2d mean_slope = Eigen::Vector2d::Zero();
    double weight = 0.0;
    int nearest_squared = 1 << 20;
    Prediction prediction;
    for (int iy = std::max(0, cy - reach); iy <= std::min(kSide - 1, cy + reach); ++iy) {
      for (int ix = std::max(0, cx - reach); ix <= std::min(kSide - 1, cx + reach); ++ix) {
        const HeightGrid::Node& n = grid_.node(iy * kSide + ix);
        const int squared = (ix - cx) * (ix - cx) + (iy - cy) * (iy - cy);
        if (n.confidence <= 0.0F || squared == 0) continue;
        const double w = 1.0 / (squared * squared);
        const Eigen::Vector3d row(1.0, ix - cx, iy - cy);
        A += w * row * row.transpose();
        b += w * n.z * row;
        mean_slope += w * Eigen::Vector2d(n.slope_x, n.slope_y);
        weight += w;
        ++prediction.supports;
        nearest_squared = std::min(nearest_squared, squared);
      }
    }
    if (prediction.supports == 0) return prediction;
    mean_slope /= weight;
    const double pull = 2.0 * weight;
    A(1, 1) += pull;
    A(2, 2) += pull;
    b.tail<2>() += pull * mean_slope;
    const Eigen::Vector3d plane = A.ldlt().solve(b);
    prediction.z = plane.x();
    prediction.slope = plane.tail<2>().cwiseMax(-kMaxSlope).cwiseMin(kMaxSlope);
    prediction.gap_m = std::sqrt(static_cast<double>(nearest_squared)) * HeightGrid::kCellM;
    return prediction;
  }

  /// The next ground on the way to the sensor, up to half of the range away: sparse rings far out.
  [[nodiscard]] Prediction predict_along_ray(int cell) const {
    const double x = HeightGrid::centre_x(cell);
    const double y = HeightGrid::centre_y(cell);
    const double range = std::hypot(x, y);
    for (double gap = window(range); gap < 0.5 * range; gap += HeightGrid::kCellM) {
      const double scale = 1.0 - gap / range;
      const int other =
          HeightGrid::index_of(static_cast<float>(x * scale), static_cast<float>(y * scale));
      const HeightGrid::Node& n = grid_.node(other);
      if (n.confidence <= 0.0F) continue;
      const Eigen::Vector2d slope(n.slope_x, n.slope_y);
      const Eigen::Vector2d step(x - HeightGrid::centre_x(other), y - HeightGrid::centre_y(other));
      return Prediction{n.z + slope.dot(step), slope, 1, gap};
    }
    return {};
  }

  /// Makes a cell ground if some of its points lie within `tolerance_m` of the prediction.
  void accept(int cell, const Prediction& prediction, double tolerance_m) {
    const auto cx = static_cast<float>(HeightGrid::centre_x(cell));
    const auto cy = static_cast<float>(HeightGrid::centre_y(cell));
    const Eigen::Vector2f slope = prediction.slope.cast<float>();
    const auto z = static_cast<float>(prediction.z);
    const auto tolerance = static_cast<float>(tolerance_m);
    const auto above = [&](const Eigen::Vector3f& p) {
      return p.z() - z - slope.x() * (p.x() - cx) - slope.y() * (p.y() - cy);
    };
    float lowest = tolerance;
    for (const Eigen::Vector3f* p = cells_.begin(cell); p != cells_.end(cell); ++p) {
      const float r = above(*p);
      if (r >= -tolerance && r < lowest) lowest = r;
    }
    if (lowest >= tolerance) return;
    // Mean over the layer on top of the lowest point; thin enough to leave a kerb's upper side out.
    double sum = 0.0;
    int count = 0;
    for (const Eigen::Vector3f* p = cells_.begin(cell); p != cells_.end(cell); ++p) {
      const float r = above(*p);
      if (r < lowest || r > lowest + 0.1F) continue;
      sum += static_cast<double>(r);
      ++count;
    }
    grid_.node(cell) =
        HeightGrid::Node{z + static_cast<float>(sum / count), slope.x(), slope.y(), 1.0F};
  }

  void take_back_outliers() {
    std::vector<std::pair<int, HeightGrid::Node>> checked;
    for (const int cell : cells_.near_to_far) {
      const HeightGrid::Node& n = grid_.node(cell);
      if (n.confidence <= 0.0F) continue;
      const Prediction prediction = predict(cell);
      HeightGrid::Node after = n;
      after.slope_x = static_cast<float>(prediction.slope.x());
      after.slope_y = static_cast<float>(prediction.slope.y());
      const double tolerance_m =
          kStepM + 0.01 * range_of(cell) * (prediction.supports < 4 ? 1.0 : 0.2);
      const bool lonely = prediction.supports == 0;
      if (!lonely && std::abs(n.z - prediction.z) > tolerance_m) after = HeightGrid::Node{};
      if (!lonely) checked.emplace_back(cell, after);
    }
    for (const auto& [cell, after] : checked) grid_.node(cell) = after;
  }

  const Cells& cells_;
  const SeedPlane& plane_;
  HeightGrid& grid_;
};

void label(const maps::PointCloud& cloud, const HeightGrid& grid,
           std::vector<std::uint8_t>& is_ground) {
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3f& p = cloud.positions[i];
    const int cell = HeightGrid::index_of(p.x(), p.y());
    if (cell < 0 || grid.node(cell).confidence <= 0.0F) continue;
    // Cheap refusal of what is far above, before the interpolation.
    if (p.z() > grid.node(cell).z + 1.0F) continue;
    const auto sample = grid.at(static_cast<double>(p.x()), static_cast<double>(p.y()));
    if (!sample) continue;
    const double above_m = (static_cast<double>(p.z()) - sample->z) * sample->normal.z();
    const double range_m = static_cast<double>(p.head<2>().norm());
    const double tolerance_m = std::min(0.25, 0.15 + 0.0015 * range_m);
    if (std::abs(above_m) <= tolerance_m) is_ground[i] = 1;
  }
}

}  // namespace

GroundResult GrowingGround::segment(const maps::PointCloud& cloud) const {
  GroundResult result;
  result.is_ground.assign(cloud.size(), 0);
  auto grid = std::make_shared<HeightGrid>();
  const Cells cells = group(cloud);
  if (const auto plane = seed(cells)) {
    Growth(cells, *plane, *grid).run();
    grid->fill(kFillReach);
    label(cloud, *grid, result.is_ground);
  }
  result.surface = std::move(grid);
  return result;
}

}  // namespace stillmap::mapping
