// Messages of bags in CDR and ROS 1: clouds of all kinds, poses, tf, fixes of GNSS, readings of an
// IMU, packets of an Ouster and its metadata. The first byte says which of them, and how they are
// written.
#include "scan_rules.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/geodesy.hpp>

#include "bags/livox_cloud.hpp"
#include "bags/ouster_packets.hpp"
#include "bags/point_cloud2.hpp"
#include "bags/velodyne_scan.hpp"
#include "packets/ouster_sweep.hpp"

namespace {

using namespace stillmap;

void require_rigid(const maps::StampedTransform& transform) {
  if (!transform.T_parent_child) return;
  fuzz::require(transform.T_parent_child->matrix().allFinite(), "transforms are finite");
  const Eigen::Matrix3d R = transform.T_parent_child->linear();
  fuzz::require((R.transpose() * R).isIdentity(1e-9), "rotations are such");
}

/// A sensor of two pixels, with small packets.
const maps::OusterSensor& small_ouster(bool is_dual) {
  const auto sensor_of = [](const std::string& profile) {
    return maps::read_ouster_metadata(
        R"({"beam_altitude_angles": [10, 0], "beam_azimuth_angles": [3, -3], "prod_line": "OS-1-2",
            "lidar_to_sensor_transform": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
            "lidar_data_format": {"columns_per_frame": 1024, "columns_per_packet": 2,
            "pixels_per_column": 2, "udp_profile_lidar": ")" +
            profile + "\"}}",
        "fuzz");
  };
  static const maps::OusterSensor dual = sensor_of("RNG19_RFL8_SIG16_NIR16_DUAL");
  static const maps::OusterSensor legacy = sensor_of("LEGACY");
  return is_dual ? dual : legacy;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::size_t kMostPoints = 100'000;
  if (size == 0) return 0;
  const auto bytes = fuzz::bytes_of(fuzz::text_of(data + 1, size - 1));
  const auto serialization =
      data[0] % 2 == 0 ? maps::Serialization::kCdr : maps::Serialization::kRos1;
  const auto reader = [&] { return maps::MessageReader(bytes, serialization, "fuzz"); };
  const int kind = data[0] / 2 % 10;
  const auto decode = [&](const auto& decoded) {
    const auto scan = fuzz::taken<maps::InputError>([&] {
      maps::MessageReader message = reader();
      return decoded(message);
    });
    if (scan) fuzz::require_decoded(*scan, kMostPoints);
    return 0;
  };
  switch (kind) {
    case 0:
      return decode([](auto& message) { return maps::decode_point_cloud2(message, kMostPoints); });
    case 5:
      return decode([](auto& message) { return maps::decode_livox_cloud(message, kMostPoints); });
    case 6: {
      std::vector<maps::VelodyneLaser> lasers(size % 2 == 0 ? 128 : 0);
      for (maps::VelodyneLaser& laser : lasers) laser = {0.1, 0.1, 1.0, 1.0, 1.0, true, 0.1, 0.1};
      return decode(
          [&](auto& message) { return maps::decode_velodyne_scan(message, lasers, kMostPoints); });
    }
    case 1:
    case 2: {
      const auto pose = fuzz::taken<maps::InputError>([&] {
        maps::MessageReader message = reader();
        return maps::read_pose(message, kind == 1 ? maps::kNavOdometry : maps::kPoseStamped);
      });
      if (pose) require_rigid(*pose);
      return 0;
    }
    case 4: {
      const auto fix = fuzz::taken<maps::InputError>([&] {
        maps::MessageReader message = reader();
        return maps::read_fix(message);
      });
      if (fix && fix->place)
        fuzz::require(maps::violations(*fix->place).empty(), "places are on the Earth");
      return 0;
    }
    case 7:
      static_cast<void>(fuzz::taken<maps::InputError>([&] {
        maps::MessageReader message = reader();
        return maps::read_imu(message);
      }));
      return 0;
    case 8:
      static_cast<void>(fuzz::taken<maps::InputError>([&] {
        maps::MessageReader message = reader();
        return maps::read_ouster_head(message);
      }));
      return decode([&](auto& message) {
        maps::OusterSweep sweep(small_ouster(bytes.size() > 120), 1, "fuzz");
        sweep.add(message.bytes());
        return std::move(sweep).finish();
      });
    case 9: {
      const auto sensor = fuzz::taken<maps::InputError>([&] {
        return maps::read_ouster_metadata(
            {reinterpret_cast<const char*>(bytes.data()), bytes.size()}, "fuzz");
      });
      if (sensor) fuzz::require(sensor->packet_bytes() <= 65'535, "packets fit into a datagram");
      return 0;
    }
    default:
      static_cast<void>(fuzz::taken<maps::InputError>([&] {
        maps::MessageReader message = reader();
        maps::read_transforms(message, require_rigid);
        return 0;
      }));
      return 0;
  }
}
