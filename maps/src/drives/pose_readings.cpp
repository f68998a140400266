#include "drives/pose_readings.hpp"

#include <stillmap/maps/cell_table.hpp>
#include <stillmap/maps/median.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace stillmap::maps {
namespace {

constexpr float kCellM = 0.4F;
/// 20 bits of cells.
constexpr float kFarthestM = 400'000.0F;
constexpr std::size_t kMostPoints = 2000;
/// Than one that is met more.
constexpr double kSurelyBetter = 0.01;

std::uint64_t cell_of(const Eigen::Vector3f& p) {
  const auto index = [](float value) {
    // Wrong poses lead anywhere, also where no cell has a number; none is filled there.
    if (!(std::abs(value) < kFarthestM)) return -std::int64_t{kCellsPerAxis / 2};
    return static_cast<std::int64_t>(std::floor(value / kCellM));
  };
  return signed_cell_key(index(p.x()), index(p.y()), index(p.z()));
}

using Cells = CellTable;

double share_in(const Cells& cells, const StandingPoints& points, const Eigen::Isometry3d& T) {
  const Eigen::Isometry3f T_float = T.cast<float>();
  const std::size_t step = points.size() / kMostPoints + 1;
  std::size_t in = 0, all = 0;
  for (std::size_t i = 0; i < points.size(); i += step, ++all)
    in += cells.contains(cell_of(T_float * points[i])) ? 1U : 0U;
  return all == 0 ? 0.0 : static_cast<double>(in) / static_cast<double>(all);
}

Eigen::Matrix3d columns(const Eigen::Vector3d& x, const Eigen::Vector3d& y) {
  Eigen::Matrix3d R;
  R << x, y, x.cross(y);
  return R;
}

/// The 24 ways in which right-handed axes can lie on each other: the identity, then those that are
/// met most, since a straight drive does not tell all of them apart.
std::vector<Eigen::Matrix3d> axis_turns() {
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX(), y = Eigen::Vector3d::UnitY(),
                        z = Eigen::Vector3d::UnitZ();
  // Itself; a camera's (x right, y down, z ahead); north-east-down; turned by 180, 90 and -90 deg.
  std::vector<Eigen::Matrix3d> turns{columns(x, y),   columns(z, -x), columns(x, -y),
                                     columns(-x, -y), columns(y, -x), columns(-y, x)};
  std::array<Eigen::Index, 3> order{0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      Eigen::Matrix3d R = Eigen::Matrix3d::Zero();
      for (Eigen::Index axis = 0; axis < 3; ++axis)
        R(order[static_cast<std::size_t>(axis)], axis) = (signs >> axis & 1) != 0 ? -1.0 : 1.0;
      if (R.determinant() < 0.0 || std::find(turns.begin(), turns.end(), R) != turns.end())
        continue;
      turns.push_back(R);
    }
  } while (std::next_permutation(order.begin(), order.end()));
  return turns;
}

std::string axis_text(const Eigen::Vector3d& direction) {
  constexpr std::array<const char*, 3> kNames{"x", "y", "z"};
  Eigen::Index axis = 0;
  direction.cwiseAbs().maxCoeff(&axis);
  return std::string(direction[axis] < 0.0 ? "-" : "+") + kNames[static_cast<std::size_t>(axis)];
}

struct Reading {
  std::string name;
  Eigen::Matrix3d R_pose_lidar = Eigen::Matrix3d::Identity();
  bool is_inverse = false;
};

std::vector<Reading> other_readings() {
  std::vector<Reading> readings;
  for (const Eigen::Matrix3d& R : axis_turns()) {
    const bool same = R.isIdentity();
    const std::string axes = "a frame in which the lidar's x, y, z point along " +
                             axis_text(R.col(0)) + ", " + axis_text(R.col(1)) + ", " +
                             axis_text(R.col(2));
    if (!same) readings.push_back({"the poses of " + axes, R, false});
    readings.push_back({"the inverses of poses" + (same ? "" : " of " + axes), R, true});
  }
  return readings;
}

Eigen::Isometry3d motion(const std::array<PosedScan, 2>& pair, const Reading& reading) {
  const Eigen::Isometry3d& a = pair[0].T_map_lidar;
  const Eigen::Isometry3d& b = pair[1].T_map_lidar;
  const Eigen::Isometry3d T = reading.is_inverse ? a * b.inverse() : a.inverse() * b;
  const Eigen::Isometry3d T_pose_lidar(reading.R_pose_lidar);
  return T_pose_lidar.inverse() * T * T_pose_lidar;
}

}  // namespace

std::optional<PoseOverlap> compare_readings(const std::vector<std::array<PosedScan, 2>>& pairs,
                                            std::size_t least_pairs) {
  if (pairs.size() < least_pairs) return std::nullopt;
  std::vector<Cells> cells;
  for (const std::array<PosedScan, 2>& pair : pairs) {
    Cells& of_pair = cells.emplace_back();
    for (const Eigen::Vector3f& p : pair[0].points) of_pair.insert(cell_of(p));
  }
  const auto overlap = [&](const auto& motion_of) {
    std::vector<double> shares;
    for (std::size_t i = 0; i < pairs.size(); ++i)
      shares.push_back(share_in(cells[i], pairs[i][1].points, motion_of(pairs[i])));
    return median(std::move(shares));
  };
  PoseOverlap found;
  found.pairs = pairs.size();
  found.given = overlap([](const auto& pair) { return motion(pair, {}); });
  found.without = overlap([](const auto&) { return Eigen::Isometry3d::Identity(); });
  for (const Reading& reading : other_readings()) {
    const double share = overlap([&](const auto& pair) { return motion(pair, reading); });
    if (share <= found.other + kSurelyBetter) continue;
    found.other = share;
    found.other_reading = reading.name;
  }
  return found;
}

bool is_better(double overlap, const PoseOverlap& given) {
  return overlap > given.given + kClearlyBetter;
}

}  // namespace stillmap::maps
