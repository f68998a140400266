#include <stillmap/maps/frames.hpp>

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <numbers>
#include <utility>

#include "output/file_output.hpp"
#include "output/kitti_camera.hpp"
#include "output/layout_writer.hpp"
#include "output/oxts_model.hpp"

namespace stillmap::simulation {
namespace {

constexpr std::string_view kDate = "2026_06_01";

/// When the drive's clock is 0 [ns since the epoch]: 10:00 of that date.
constexpr std::int64_t start_ns() {
  using namespace std::chrono;
  constexpr sys_days kDay = year(2026) / June / 1;
  return duration_cast<nanoseconds>((kDay + hours(10)).time_since_epoch()).count();
}

std::string date_time_of(std::int64_t stamp_ns) {
  using namespace std::chrono;
  const sys_time<nanoseconds> time{nanoseconds(stamp_ns)};
  const sys_days day = floor<days>(time);
  const year_month_day date(day);
  const hh_mm_ss<nanoseconds> clock(time - day);
  return fmt::format("{:04}-{:02}-{:02} {:02}:{:02}:{:02}.{:09}\n", static_cast<int>(date.year()),
                     static_cast<unsigned>(date.month()), static_cast<unsigned>(date.day()),
                     clock.hours().count(), clock.minutes().count(), clock.seconds().count(),
                     clock.subseconds().count());
}

/// KITTI's mounting of the inertial unit (2011_09_26): 0.93 m over ground, nearly level.
Eigen::Isometry3d make_T_lidar_imu(double lidar_height_m) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() << 9.999976e-01, 7.553071e-04, -2.035826e-03, -7.854027e-04, 9.998898e-01,
      -1.482298e-02, 2.024406e-03, 1.482454e-02, 9.998881e-01;
  constexpr double kImuHeightM = 0.93;
  T.translation() = Eigen::Vector3d(-8.086759e-01, 3.195559e-01, kImuHeightM - lidar_height_m);
  return maps::renormalized(T);
}

/// Whether points come in the order that readers of this layout assume: clockwise, backward at both
/// ends of the sweep.
class SpinCheck {
 public:
  explicit SpinCheck(double period_s) : period_s_(period_s) {}

  void add(const LabelledPoints& points) {
    // Lasers that look to the side of the heading are off by up to a fortieth of a turn.
    const double tolerance_s = 0.05 * period_s_;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Eigen::Vector3f& p = points.positions[i];
      const double assumed_s = -std::atan2(p.y(), p.x()) / (2.0 * std::numbers::pi) * period_s_;
      if (std::abs(assumed_s - points.time_offsets_s[i]) > tolerance_s) ++off_;
    }
    points_ += points.size();
  }
  [[nodiscard]] bool passed() const { return off_ * 10 <= points_; }

 private:
  double period_s_;
  std::size_t points_ = 0;
  std::size_t off_ = 0;
};

class KittiRawWriter final : public LayoutWriter {
 public:
  KittiRawWriter(std::filesystem::path folder, const DriveWriterOptions& options,
                 const TruePath& T_world_lidar)
      : date_folder_(std::move(folder)),
        options_(options),
        T_lidar_imu_(make_T_lidar_imu(options.lidar_height_m)),
        oxts_(T_world_lidar, T_lidar_imu_, key_of({options.key, 1})),
        random_(key_of({options.key, 2})),
        spin_(options.period_s) {
    make_folder(velodyne() / "data");
    make_folder(drive_folder() / "oxts" / "data");
  }

  [[nodiscard]] std::filesystem::path drive_folder() const override {
    return date_folder_ / fmt::format("{}_drive_0001_sync", kDate);
  }
  [[nodiscard]] std::string stem_of(std::size_t index) const override {
    return fmt::format("{:010}", index);
  }
  [[nodiscard]] bool at_stamp() const override { return false; }
  [[nodiscard]] std::int64_t stamp_ns(double time_s) const override {
    return start_ns() + nanoseconds_of(time_s);
  }
  [[nodiscard]] Eigen::Isometry3d T_map_world() const override { return oxts_.T_map_world(); }

  void add(std::size_t index, const SimulatedScan& scan,
           const std::vector<Eigen::Vector3f>& positions) override {
    write_bin(velodyne() / "data" / (stem_of(index) + ".bin"), positions, scan.points.intensities);
    spin_.add(scan.points);
    const double half_s = 0.5 * options_.period_s;
    stamps_ += date_time_of(stamp_ns(scan.stamp_s));
    starts_ += date_time_of(stamp_ns(scan.stamp_s - half_s));
    ends_ += date_time_of(stamp_ns(scan.stamp_s + half_s));
    // In drive 0013 of 2011_09_26 packets are some 5 to 20 ms later than the scans of their number.
    const double packet_s = scan.stamp_s + random_.uniform(0.005, 0.020);
    write_file(drive_folder() / "oxts" / "data" / (stem_of(index) + ".txt"),
               oxts_.packet(packet_s));
    oxts_stamps_ += date_time_of(stamp_ns(packet_s));
  }

  void finish() override {
    write_file(velodyne() / "timestamps.txt", stamps_);
    // With these, readers take each point's time from its azimuth.
    if (spin_.passed()) {
      write_file(velodyne() / "timestamps_start.txt", starts_);
      write_file(velodyne() / "timestamps_end.txt", ends_);
    }
    write_file(drive_folder() / "oxts" / "timestamps.txt", oxts_stamps_);
    write_file(drive_folder() / "oxts" / "dataformat.txt", oxts_dataformat());
    const KittiCamera camera(options_.lidar_height_m);
    write_file(date_folder_ / "calib_imu_to_velo.txt", imu_to_velo(T_lidar_imu_));
    write_file(date_folder_ / "calib_velo_to_cam.txt", camera.velo_to_cam());
    write_file(date_folder_ / "calib_cam_to_cam.txt", camera.cam_to_cam());
  }

 private:
  [[nodiscard]] std::filesystem::path velodyne() const {
    return drive_folder() / "velodyne_points";
  }

  std::filesystem::path date_folder_;
  DriveWriterOptions options_;
  Eigen::Isometry3d T_lidar_imu_;
  OxtsModel oxts_;
  Random random_;
  SpinCheck spin_;
  std::string stamps_;
  std::string starts_;
  std::string ends_;
  std::string oxts_stamps_;
};

}  // namespace

std::unique_ptr<LayoutWriter> make_kitti_raw_writer(const std::filesystem::path& folder,
                                                    const DriveWriterOptions& options,
                                                    const TruePath& T_world_lidar) {
  return std::make_unique<KittiRawWriter>(folder, options, T_world_lidar);
}

}  // namespace stillmap::simulation
