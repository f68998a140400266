#pragma once

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/drive.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <filesystem>
#include <map>
#include <optional>
#include <vector>

namespace stillmap::maps {

/// A part of an image [px], x to the right, y down; right >= left, bottom >= top.
struct ImageRectangle {
  double left = 0.0, top = 0.0, right = 0.0, bottom = 0.0;

  /// [px^2]
  [[nodiscard]] double area() const { return (right - left) * (bottom - top); }
};

/// The camera whose image was labelled: KITTI labels nothing that it does not show.
struct CameraView {
  /// h = P (p_lidar, 1), pixel = (h.x / h.z, h.y / h.z), h.z the depth [m].
  Eigen::Matrix<double, 3, 4> P_image_lidar = Eigen::Matrix<double, 3, 4>::Zero();
  /// Width and height [px].
  Eigen::Vector2d size_px = Eigen::Vector2d::Zero();
  /// Where objects were left without a label.
  std::vector<ImageRectangle> dont_care;
};

/// Boxes that people or a simulator drew into a drive.
struct LabelledBoxes {
  std::filesystem::path source;
  BoxSequence boxes;
  /// One a scan; empty when objects are labelled all around.
  std::map<std::size_t, CameraView> views;
};

/// Labels of a drive: `boxes_file` (see `read_boxes`), or else what lies in the drive's folder, the
/// first of
///  - `boxes.json`, as the simulator writes it: all around;
///  - `tracking/label_02.txt`, KITTI tracking: what the left colour camera shows;
///  - `label_2/NAME.txt` with `calib/NAME.txt` for each scan NAME, KITTI object: likewise.
///
/// The image's size stands in `calib_cam_to_cam.txt` of a KITTI raw date folder; other calibrations
/// leave it out, and then it is that of the KITTI recording of the same focal length.
/// @return nothing when the folder has none of these.
/// @throws InputError naming file, line and value; also for a scan without a label file, and for a
/// camera of unknown size.
[[nodiscard]] std::optional<LabelledBoxes> read_labelled_boxes(
    const Drive& drive, const std::optional<std::filesystem::path>& boxes_file = std::nullopt);

}  // namespace stillmap::maps
