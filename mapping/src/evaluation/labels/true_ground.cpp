#include "evaluation/labels/true_ground.hpp"

#include <fmt/format.h>
#include <stillmap/maps/error.hpp>

#include <cmath>

namespace stillmap::mapping {
namespace {

constexpr double kGroundTruthCellM = 0.5;
/// Cells to look around for labelled ground: 2 m, half a car.
constexpr std::int64_t kReach = 4;

std::int64_t column_along(double x) {
  return static_cast<std::int64_t>(std::floor(x / kGroundTruthCellM));
}

}  // namespace

void LabelledGround::add(const Eigen::Vector3d& p) {
  Mean& mean = cells_[maps::plane_cell_key(column_along(p.x()), column_along(p.y()))];
  mean.sum += p.z();
  ++mean.points;
}

const LabelledGround::Mean* LabelledGround::cell(std::int64_t x, std::int64_t y) const {
  return cells_.find(maps::plane_cell_key(x, y));
}

std::optional<double> LabelledGround::height(double x, double y) const {
  const std::int64_t column = column_along(x);
  const std::int64_t row = column_along(y);
  for (std::int64_t ring = 0; ring <= kReach; ++ring) {
    double sum = 0.0;
    std::size_t cells = 0;
    for (std::int64_t dx = -ring; dx <= ring; ++dx) {
      for (std::int64_t dy = -ring; dy <= ring; ++dy) {
        if (std::max(std::abs(dx), std::abs(dy)) != ring) continue;
        const Mean* mean = cell(column + dx, row + dy);
        if (mean == nullptr) continue;
        sum += mean->sum / static_cast<double>(mean->points);
        ++cells;
      }
    }
    if (cells > 0) return sum / static_cast<double>(cells);
  }
  return std::nullopt;
}

DriveTruth::DriveTruth(const maps::Drive& drive) : drive_(drive) {
  const std::filesystem::path folder = drive.contents().root / "truth";
  if (std::filesystem::exists(folder / "ground.ply"))
    mesh_ = read_ground_mesh(folder / "ground.ply");
  if (std::filesystem::exists(folder / "trajectory.txt"))
    path_ = maps::read_tum_trajectory(folder / "trajectory.txt");
}

std::optional<Eigen::Isometry3d> DriveTruth::T_truth_lidar(std::size_t index) const {
  if (!path_.empty()) {
    if (auto T_truth_lidar = path_.at(drive_.stamp_ns(index))) return T_truth_lidar;
    throw maps::InputError(
        (drive_.contents().root / "truth" / "trajectory.txt").string(),
        fmt::format("no pose near scan {} at {} ns", index, drive_.stamp_ns(index)),
        "the path of the whole drive");
  }
  if (drive_.has_poses()) return drive_.T_map_lidar(index);
  return std::nullopt;
}

std::optional<double> DriveTruth::surface_height(double x, double y) const {
  return mesh_ ? mesh_->height(x, y) : std::nullopt;
}

std::optional<double> DriveTruth::ground_height(double x, double y) const {
  return mesh_ ? mesh_->height(x, y) : labelled_.height(x, y);
}

}  // namespace stillmap::mapping
