#include <fmt/format.h>

#include <cstring>
#include <utility>

#include "output/file_output.hpp"
#include "output/layout_writer.hpp"

namespace stillmap::simulation {
namespace {

/// PCD 0.7, binary: x y z intensity, t [s] relative to the stamp, ring.
std::string pcd_bytes(const LabelledPoints& points, const std::vector<Eigen::Vector3f>& positions) {
  std::string bytes = fmt::format(
      "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
      "FIELDS x y z intensity t ring\nSIZE 4 4 4 4 4 2\nTYPE F F F F F U\nCOUNT 1 1 1 1 1 1\n"
      "WIDTH {0}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {0}\nDATA binary\n",
      points.size());
  constexpr std::size_t kPointBytes = 22;
  bytes.reserve(bytes.size() + kPointBytes * points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    append(bytes, positions[i].x());
    append(bytes, positions[i].y());
    append(bytes, positions[i].z());
    append(bytes, points.intensities[i]);
    append(bytes, points.time_offsets_s[i]);
    append(bytes, points.rings[i]);
  }
  return bytes;
}

class PcdWriter final : public LayoutWriter {
 public:
  PcdWriter(std::filesystem::path folder, TruePath T_world_lidar)
      : folder_(std::move(folder)), T_world_lidar_(std::move(T_world_lidar)) {
    make_folder(folder_ / "scans");
  }

  [[nodiscard]] std::filesystem::path drive_folder() const override { return folder_; }
  [[nodiscard]] std::string stem_of(std::size_t index) const override {
    return fmt::format("{:06}", index);
  }
  [[nodiscard]] bool at_stamp() const override { return false; }
  [[nodiscard]] Eigen::Isometry3d T_map_world() const override {
    return Eigen::Isometry3d::Identity();
  }

  void add(std::size_t index, const SimulatedScan& scan,
           const std::vector<Eigen::Vector3f>& positions) override {
    write_file(folder_ / "scans" / (stem_of(index) + ".pcd"), pcd_bytes(scan.points, positions));
    const Eigen::Isometry3d T = T_world_lidar_(scan.stamp_s);
    trajectory_ += tum_line_of(stamp_ns(scan.stamp_s), T);
    poses_ += kitti_row_of(T) + "\n";
    times_ += fmt::format("{:.9f}\n", scan.stamp_s);
  }

  void finish() override {
    write_file(folder_ / "trajectory.txt", trajectory_);
    write_file(folder_ / "optimized_poses.txt", poses_);
    write_file(folder_ / "times.txt", times_);
  }

 private:
  std::filesystem::path folder_;
  TruePath T_world_lidar_;
  std::string trajectory_;
  std::string poses_;
  std::string times_;
};

}  // namespace

std::unique_ptr<LayoutWriter> make_pcd_writer(const std::filesystem::path& folder,
                                              const TruePath& T_world_lidar) {
  return std::make_unique<PcdWriter>(folder, T_world_lidar);
}

}  // namespace stillmap::simulation
