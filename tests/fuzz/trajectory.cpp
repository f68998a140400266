// Poses of any kind of file, key frames of hdl_graph_slam, NMEA logs, readings of an IMU,
// and stamps of a drive.
#include "fuzz_folder.hpp"
#include "fuzz_target.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/imu.hpp>
#include <stillmap/maps/pose_file.hpp>
#include <stillmap/maps/trajectory.hpp>

#include "drives/layout.hpp"
#include "formats/hdl_keyframe.hpp"
#include "formats/nmea.hpp"

namespace {

using namespace stillmap;

void require_rigid(const Eigen::Isometry3d& T) {
  fuzz::require(T.matrix().allFinite(), "poses are finite");
  fuzz::require((T.linear().transpose() * T.linear()).isIdentity(1e-9), "rotations are such");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::filesystem::path file = fuzz::put("poses.txt", fuzz::text_of(data, size));
  if (const auto path =
          fuzz::taken<maps::InputError>([&] { return maps::read_tum_trajectory(file); })) {
    for (std::size_t i = 0; i < path->size(); ++i) {
      require_rigid(path->poses()[i].T_map_lidar);
      fuzz::require(i == 0 || path->poses()[i].stamp_ns > path->poses()[i - 1].stamp_ns,
                    "stamps increase");
    }
    if (!path->empty()) {
      const std::int64_t first = path->poses().front().stamp_ns;
      for (const std::int64_t stamp_ns : {first, first / 2, path->poses().back().stamp_ns}) {
        const auto T = path->at(stamp_ns);
        fuzz::require(!T || T->matrix().allFinite(), "between poses it is finite");
      }
    }
  }
  if (const auto poses =
          fuzz::taken<maps::InputError>([&] { return maps::read_kitti_poses(file); })) {
    for (const Eigen::Isometry3d& T : *poses) require_rigid(T);
  }
  static_cast<void>(fuzz::taken<maps::InputError>([&] { return maps::read_times(file); }));
  if (const auto poses = fuzz::taken<maps::InputError>([&] { return maps::read_pose_file(file); }))
    for (const Eigen::Isometry3d& T : poses->all()) require_rigid(T);
  if (const auto pose =
          fuzz::taken<maps::InputError>([&] { return maps::read_hdl_keyframe(file); }))
    require_rigid(pose->T_map_lidar);
  static_cast<void>(fuzz::taken<maps::InputError>(
      [&] { return maps::read_nmea(file, 0, [](const maps::NmeaFix&) {}); }));
  static_cast<void>(fuzz::taken<maps::InputError>([&] { return maps::read_imu_csv(file); }));
  return 0;
}
