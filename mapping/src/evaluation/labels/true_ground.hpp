#pragma once

#include "evaluation/labels/ground_mesh.hpp"

#include <stillmap/maps/cell_table.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

namespace stillmap::mapping {

/// Ground heights of points that are labelled as ground: what is known where no simulator tells.
class LabelledGround {
 public:
  void add(const Eigen::Vector3d& p);
  /// Mean height of the ground points around a place [m], of the nearest ones within 2 m. Good to a
  /// decimetre on streets, so it tells a car's roof from the road, not how well ground was filled.
  [[nodiscard]] std::optional<double> height(double x, double y) const;
  [[nodiscard]] bool empty() const { return cells_.empty(); }

 private:
  struct Mean {
    double sum = 0.0;
    std::size_t points = 0;
  };
  [[nodiscard]] const Mean* cell(std::int64_t x, std::int64_t y) const;

  maps::CellMap<Mean> cells_;
};

/// What a drive's folder knows of the truth, in its own frame: that of its true poses.
class DriveTruth {
 public:
  /// Reads DRIVE/truth/ground.ply and DRIVE/truth/trajectory.txt where they are there.
  /// @throws maps::InputError, maps::StorageError for broken ones.
  explicit DriveTruth(const maps::Drive& drive);

  /// True pose of a scan, from the true path or else the drive's own; nothing when it has neither.
  [[nodiscard]] std::optional<Eigen::Isometry3d> T_truth_lidar(std::size_t index) const;

  /// Whether `surface_height` is the exact surface.
  [[nodiscard]] bool has_surface() const { return mesh_.has_value(); }
  /// The true surface [m]. Nothing without one or beside it.
  [[nodiscard]] std::optional<double> surface_height(double x, double y) const;
  /// The true surface, or the one of labelled points [m].
  [[nodiscard]] std::optional<double> ground_height(double x, double y) const;

  /// For drives without a true surface.
  LabelledGround& labelled_ground() { return labelled_; }

 private:
  const maps::Drive& drive_;
  std::optional<GroundMesh> mesh_;
  maps::Trajectory path_;
  LabelledGround labelled_;
};

}  // namespace stillmap::mapping
