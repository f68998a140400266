#include <fmt/format.h>

#include <utility>

#include "output/file_output.hpp"
#include "output/kitti_camera.hpp"
#include "output/layout_writer.hpp"

namespace stillmap::simulation {
namespace {

class KittiOdometryWriter final : public LayoutWriter {
 public:
  KittiOdometryWriter(std::filesystem::path folder, const DriveWriterOptions& options,
                      TruePath T_world_lidar)
      : folder_(std::move(folder)),
        camera_(options.lidar_height_m),
        T_world_lidar_(std::move(T_world_lidar)),
        T_world_map_(options.T_world_map) {
    make_folder(folder_ / "velodyne");
  }

  [[nodiscard]] std::filesystem::path drive_folder() const override { return folder_; }
  [[nodiscard]] std::string stem_of(std::size_t index) const override {
    return fmt::format("{:06}", index);
  }
  [[nodiscard]] bool at_stamp() const override { return true; }

  void add(std::size_t index, const SimulatedScan& scan,
           const std::vector<Eigen::Vector3f>& positions) override {
    write_bin(folder_ / "velodyne" / (stem_of(index) + ".bin"), positions, scan.points.intensities);
    if (index == 0) {
      T_map_world_ = (T_world_map_ ? T_world_map_() : T_world_lidar_(scan.stamp_s)).inverse();
    }
    const Eigen::Isometry3d T_map_lidar = T_map_world_ * T_world_lidar_(scan.stamp_s);
    poses_ +=
        kitti_row_of(camera_.T_cam_lidar * T_map_lidar * camera_.T_cam_lidar.inverse()) + "\n";
    times_ += fmt::format("{:.9f}\n", scan.stamp_s);
  }

  void finish() override {
    write_file(folder_ / "calib.txt", camera_.odometry_calibration());
    write_file(folder_ / "poses.txt", poses_);
    write_file(folder_ / "times.txt", times_);
  }

  [[nodiscard]] Eigen::Isometry3d T_map_world() const override { return T_map_world_; }

 private:
  std::filesystem::path folder_;
  KittiCamera camera_;
  TruePath T_world_lidar_;
  std::function<Eigen::Isometry3d()> T_world_map_;
  Eigen::Isometry3d T_map_world_ = Eigen::Isometry3d::Identity();
  std::string poses_;
  std::string times_;
};

}  // namespace

std::int64_t LayoutWriter::stamp_ns(double time_s) const { return nanoseconds_of(time_s); }

std::unique_ptr<LayoutWriter> make_kitti_odometry_writer(const std::filesystem::path& folder,
                                                         const DriveWriterOptions& options,
                                                         const TruePath& T_world_lidar) {
  return std::make_unique<KittiOdometryWriter>(folder, options, T_world_lidar);
}

}  // namespace stillmap::simulation
