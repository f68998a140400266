#include "output/drive_writer.hpp"

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/partial_folder.hpp>

#include <optional>
#include <span>
#include <stdexcept>
#include <utility>

#include "geometry/random.hpp"
#include "output/file_output.hpp"
#include "output/kitti_camera.hpp"
#include "output/layout_writer.hpp"
#include "output/motion_compensation.hpp"
#include "output/tracking_labels.hpp"
#include "output/truth_writer.hpp"
#include "sensing/imu_model.hpp"

namespace stillmap::simulation {
namespace {

/// Of the IMU's errors, beside those that other writers draw from the drive's key.
constexpr std::uint64_t kImuNumbers = 0x1d0;

std::unique_ptr<LayoutWriter> make_layout(const std::filesystem::path& folder,
                                          const DriveWriterOptions& options,
                                          const TruePath& T_world_lidar) {
  switch (options.layout) {
    case OutputLayout::kKittiOdometry:
      return make_kitti_odometry_writer(folder, options, T_world_lidar);
    case OutputLayout::kKittiRaw:
      return make_kitti_raw_writer(folder, options, T_world_lidar);
    case OutputLayout::kPcd:
      return make_pcd_writer(folder, T_world_lidar);
  }
  throw std::invalid_argument("DriveWriter: unknown layout");
}

}  // namespace

struct DriveWriter::Implementation {
  Implementation(const std::filesystem::path& target, const DriveWriterOptions& given,
                 TruePath path)
      : options(given),
        T_world_lidar(std::move(path)),
        folder(target),
        layout(make_layout(folder.path(), options, T_world_lidar)),
        camera(options.lidar_height_m) {
    make_folder(layout->drive_folder() / "labels");
    if (with_tracking()) make_folder(layout->drive_folder() / "tracking");
    if (options.truth) truth.emplace(layout->drive_folder());
  }

  /// Label files in a camera's frame belong to KITTI's layouts.
  [[nodiscard]] bool with_tracking() const { return options.layout != OutputLayout::kPcd; }

  [[nodiscard]] std::vector<Eigen::Vector3f> positions_of(const LabelledPoints& points,
                                                          double stamp_s) const {
    return layout->at_stamp() ? positions_at_stamp(T_world_lidar, stamp_s, points)
                              : points.positions;
  }

  DriveWriterOptions options;
  TruePath T_world_lidar;
  maps::PartialFolder folder;
  std::unique_ptr<LayoutWriter> layout;
  KittiCamera camera;
  std::optional<TruthWriter> truth;
  maps::BoxSequence boxes;
  std::string tracking;
  std::size_t scans = 0;
};

DriveWriter::DriveWriter(const std::filesystem::path& target, const DriveWriterOptions& options,
                         TruePath T_world_lidar)
    : implementation_(std::make_unique<Implementation>(target, options, std::move(T_world_lidar))) {
}

DriveWriter::~DriveWriter() = default;

void DriveWriter::add(const SimulatedScan& scan) {
  Implementation& my = *implementation_;
  const std::size_t index = my.scans++;
  const std::string stem = my.layout->stem_of(index);
  my.layout->add(index, scan, my.positions_of(scan.points, scan.stamp_s));
  write_file(my.layout->drive_folder() / "labels" / (stem + ".label"),
             std::as_bytes(std::span(scan.points.labels)));
  const std::vector<maps::Box>& boxes = my.layout->at_stamp() ? scan.boxes_at_stamp : scan.boxes;
  if (my.with_tracking()) my.tracking += tracking_labels(index, boxes, my.camera);
  my.boxes.by_scan[index] = boxes;
  if (my.truth) my.truth->add(stem, scan, my.positions_of(scan.behind, scan.stamp_s));
}

void DriveWriter::publish(const Mesh& ground) {
  Implementation& my = *implementation_;
  const std::filesystem::path drive = my.layout->drive_folder();
  my.layout->finish();
  maps::write_boxes(drive / "boxes.json", my.boxes);
  if (my.with_tracking()) {
    write_file(drive / "tracking" / "label_02.txt", my.tracking);
    write_file(drive / "tracking" / "calib.txt", my.camera.tracking_calibration());
  }
  if (my.truth) {
    my.truth->finish(*my.layout, my.T_world_lidar, my.options.period_s, ground);
  }
  if (my.options.imu) {
    const double end_s = my.options.period_s * static_cast<double>(my.scans);
    const auto clock = [&](double time_s) { return my.layout->stamp_ns(time_s); };
    write_file(drive / "imu.csv", imu_csv(ImuModel{}, my.T_world_lidar, clock, end_s,
                                          key_of({my.options.key, kImuNumbers})));
  }
  my.folder.publish();
}

}  // namespace stillmap::simulation
