#pragma once

#include <fmt/format.h>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Geometry>
#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "small_drive.hpp"
#include "support/temporary_folder.hpp"

/// Worlds of a few labelled points, and maps of them made by hand.
namespace stillmap::test {

/// A point of the world, [m] in the map frame, and what it is.
struct WorldPoint {
  Eigen::Vector3d p;
  std::uint32_t label = 40;
};

/// Points at whole tenths of the sensor's frame, so that each lies in the middle of a voxel.
struct LabelledWorld {
  std::vector<WorldPoint> points;
  /// A ground that rises along x by this; with a kerb of 0.12 m beyond y = 1.05 m when asked for.
  double slope = 0.0;
  bool kerb = false;

  [[nodiscard]] double ground(double x, double y) const {
    return slope * x + (kerb && y > 1.05 ? 0.12 : 0.0);
  }

  /// Points on the ground, 0.1 m apart, in the middle of voxels; those that `keep` says.
  void add_ground(double x0, double x1, double y0, double y1,
                  const std::function<bool(double, double)>& keep = {}) {
    for (int i = static_cast<int>(std::lround(x0 * 10)); i < std::lround(x1 * 10); ++i) {
      for (int k = static_cast<int>(std::lround(y0 * 10)); k < std::lround(y1 * 10); ++k) {
        const double x = 0.1 * i + 0.05;
        const double y = 0.1 * k + 0.05;
        if (!keep || keep(x, y)) points.push_back({{x, y, ground(x, y)}, 40});
      }
    }
  }
  void add_box(const Eigen::Vector3d& low, const Eigen::Vector3d& high, std::uint32_t label) {
    const auto first = (low * 10).array().round();
    const auto last = (high * 10).array().round();
    for (double x = first.x(); x < last.x(); ++x) {
      for (double y = first.y(); y < last.y(); ++y) {
        for (double z = first.z(); z < last.z(); ++z)
          points.push_back({{0.1 * x + 0.05, 0.1 * y + 0.05, 0.1 * z + 0.05}, label});
      }
    }
  }
};

/// What a map made by hand does with a point of the world.
struct Handled {
  maps::PointFate fate = maps::PointFate::kKept;
  /// Where it is in the package; nowhere when not given.
  std::optional<Eigen::Vector3d> placed;
};

class HandMadeMap {
 public:
  /// One scan from a sensor at `sensor`, seen by `scans` scans in the same way.
  explicit HandMadeMap(LabelledWorld world) : world_(std::move(world)) {}

  Eigen::Vector3d sensor{0.0, 0.0, 2.0};
  std::size_t scans = 1;
  bool with_surface = true;
  /// Measured points that another drive gave, which comes first in the map; none = no other drive.
  std::vector<Eigen::Vector3d> other_drive;
  /// Poses of the map are off by this from the drive's.
  Eigen::Isometry3d T_map_truth = Eigen::Isometry3d::Identity();

  /// @return the drive's folder.
  std::filesystem::path write_drive(const std::string& name = "drive") const {
    std::string poses, labels;
    maps::PointCloud cloud;
    for (const WorldPoint& point : world_.points) {
      cloud.positions.push_back((point.p - sensor).cast<float>());
      labels.append(reinterpret_cast<const char*>(&point.label), 4);
    }
    Eigen::Isometry3d T_map_lidar = Eigen::Isometry3d::Identity();
    T_map_lidar.translation() = sensor;
    for (std::size_t i = 0; i < scans; ++i) {
      folder_.write(fmt::format("{}/velodyne/{:06}.bin", name, i), bin_of(cloud));
      folder_.write(fmt::format("{}/labels/{:06}.label", name, i), labels);
      poses += kitti_line(T_map_lidar);
    }
    folder_.write(name + "/poses.txt", poses);
    folder_.write(name + "/times.txt", times());
    folder_.write(name + "/calib.txt", calibration());
    if (with_surface) folder_.write(name + "/truth/ground.ply", ground_ply());
    return folder_.path() / name;
  }

  /// @param handle  decides on each point of the world. @param filled  synthetic ground points.
  std::shared_ptr<const maps::MapPackage> build(
      const std::function<Handled(const WorldPoint&)>& handle,
      const std::vector<Eigen::Vector3d>& filled = {},
      const std::vector<maps::MapObject>& objects = {}) const {
    const std::filesystem::path target = folder_.path() / fmt::format("map_{}", built_++);
    maps::MapPackageWriter writer(target);
    maps::ScanFates fates;
    fates.resize(world_.points.size());
    for (std::size_t i = 0; i < world_.points.size(); ++i) {
      const Handled handled = handle(world_.points[i]);
      fates.fates[i] = handled.fate;
      if (!handled.placed) continue;
      maps::PointKind kind = maps::PointKind::kMeasured;
      if (handled.fate == maps::PointFate::kGround) kind = maps::PointKind::kGround;
      if (handled.fate == maps::PointFate::kProjected) kind = maps::PointKind::kProjected;
      place(*handled.placed, kind);
    }
    for (const Eigen::Vector3d& p : filled) place(p, maps::PointKind::kFilled);
    for (const Eigen::Vector3d& p : other_drive) place(p, maps::PointKind::kMeasured);
    for (const auto& [id, points] : tiles_) writer.add_tile(id, points);
    tiles_.clear();
    std::string sources;
    std::vector<maps::StampedPose> poses;
    Eigen::Isometry3d T_truth_lidar = Eigen::Isometry3d::Identity();
    T_truth_lidar.translation() = sensor;
    for (std::size_t i = 0; i < scans; ++i)
      poses.push_back({static_cast<std::int64_t>(i) * 100'000'000, T_map_truth * T_truth_lidar});
    std::size_t drives = 0;
    if (!other_drive.empty()) {
      // A day with the same stamps and names, and other scans.
      writer.write_trajectory(maps::Trajectory(poses), drives++);
      for (std::size_t i = 0; i < scans; ++i) {
        writer.add_fates({});
        sources += fmt::format("{:064}  {:06}.bin\n", 7, i);
      }
    }
    writer.write_trajectory(maps::Trajectory(poses), drives);
    const std::filesystem::path velodyne = write_drive() / "velodyne";
    for (std::size_t i = 0; i < scans; ++i) {
      writer.add_fates(fates);
      const std::string name = fmt::format("{:06}.bin", i);
      sources += maps::sha256_of_file(velodyne / name) + "  " + name + "\n";
    }
    std::ofstream(writer.folder() / "sources.sha256") << sources;
    writer.write_objects(objects);
    maps::MapManifest manifest;
    manifest.frame_id = "local";
    manifest.voxel_size_m = 0.1;
    manifest.options = {{"min_range_m", "0"}, {"max_range_m", "300"}, {"select", "0::1"}};
    (void)writer.publish(manifest, "{}");
    return maps::MapPackage::open(target);
  }

 private:
  void place(const Eigen::Vector3d& p_truth, maps::PointKind kind) const {
    const Eigen::Vector3f p = (T_map_truth * p_truth).cast<float>();
    const auto tile = [](float x) {
      return static_cast<std::int32_t>(std::floor(static_cast<double>(x) / maps::kTileSizeM));
    };
    tiles_[{0, tile(p.x()), tile(p.y())}].push_back({p.x(), p.y(), p.z(), 1.0F, 1, kind, 0});
  }
  [[nodiscard]] std::string times() const {
    std::string text;
    for (std::size_t i = 0; i < scans; ++i)
      text += fmt::format("{:.1f}\n", 0.1 * static_cast<double>(i));
    return text;
  }
  /// Camera and lidar are one, so that poses are the lidar's own.
  [[nodiscard]] static std::string calibration() {
    std::string text;
    for (const char* name : {"P0", "P1", "P2", "P3", "Tr"})
      text += fmt::format("{}: 1 0 0 0 0 1 0 0 0 0 1 0\n", name);
    return text;
  }
  /// 60 m x 60 m around the origin.
  [[nodiscard]] std::string ground_ply() const {
    std::vector<Eigen::Vector3f> vertices;
    std::vector<std::array<std::int32_t, 3>> faces;
    const auto strip = [&](double y0, double y1, double z) {
      const auto first = static_cast<std::int32_t>(vertices.size());
      for (const double y : {y0, y1}) {
        for (const double x : {-30.0, 30.0})
          vertices.push_back(Eigen::Vector3d(x, y, world_.slope * x + z).cast<float>());
      }
      faces.push_back({first, first + 1, first + 3});
      faces.push_back({first, first + 3, first + 2});
    };
    strip(-30.0, world_.kerb ? 1.05 : 30.0, 0.0);
    if (world_.kerb) strip(1.05, 30.0, 0.12);
    std::string bytes = fmt::format(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\n"
        "property float y\nproperty float z\nelement face {}\n"
        "property list uchar int vertex_indices\nproperty int label\nend_header\n",
        vertices.size(), faces.size());
    for (const Eigen::Vector3f& vertex : vertices)
      bytes.append(reinterpret_cast<const char*>(vertex.data()), 12);
    for (const auto& face : faces) {
      const std::int32_t label = 40;
      bytes += '\3';
      bytes.append(reinterpret_cast<const char*>(face.data()), 12);
      bytes.append(reinterpret_cast<const char*>(&label), 4);
    }
    return bytes;
  }

  LabelledWorld world_;
  TemporaryFolder folder_;
  mutable int built_ = 0;
  mutable std::map<maps::TileId, std::vector<maps::MapPoint>> tiles_;
};

}  // namespace stillmap::test
