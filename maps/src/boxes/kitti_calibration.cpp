#include "boxes/kitti_calibration.hpp"

#include <fmt/format.h>
#include <stillmap/maps/error.hpp>

#include <array>
#include <cmath>
#include <initializer_list>
#include <optional>
#include <string>
#include <vector>

#include <stillmap/maps/text.hpp>
#include "drives/calibration.hpp"

namespace stillmap::maps {
namespace {

/// Pixels, and pixels times metres, of a projection: KITTI's reach 1,242.
constexpr double kMaxCameraValue = 1e6;

/// `NAME: numbers` of a calibration file; KITTI's tracking files leave the colon out in places.
std::vector<double> read_row(const std::filesystem::path& file,
                             std::initializer_list<std::string_view> names, std::size_t count) {
  const std::string text = read_text(file);
  for (NumberLine& line : number_lines(text)) {
    std::string_view name = line.fields.front();
    if (name.ends_with(':')) name.remove_suffix(1);
    for (const std::string_view wanted : names) {
      if (name != wanted) continue;
      line.fields.erase(line.fields.begin());
      if (line.fields.size() != count) {
        throw InputError(place(file, line.line), std::to_string(line.fields.size()) + " numbers",
                         std::to_string(count) + " for " + std::string(wanted));
      }
      std::vector<double> values(count);
      parse_finite(file, line, values);
      return values;
    }
  }
  throw InputError(file.string(), "no " + std::string(*names.begin()),
                   "a line with it: copy the whole calibration");
}

Eigen::Matrix3d rotation(const std::vector<double>& v) {
  return (Eigen::Matrix3d() << v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8]).finished();
}

Eigen::Affine3d affine(const Eigen::Matrix3d& linear, const Eigen::Vector3d& translation) {
  Eigen::Affine3d T = Eigen::Affine3d::Identity();
  T.linear() = linear;
  T.translation() = translation;
  return T;
}

Eigen::Affine3d checked(const std::filesystem::path& file, const Eigen::Affine3d& T) {
  // Published matrices have 7 digits; anything further from volume 1 and right angles is no
  // rotation.
  const double volume = T.linear().determinant();
  const bool is_rotation = std::abs(volume - 1.0) < 1e-2 && T.linear().isUnitary(1e-2);
  if (!is_rotation || !T.matrix().allFinite()) {
    throw InputError(file.string(),
                     "a lidar to camera matrix of determinant " + std::to_string(volume),
                     "a rotation");
  }
  check_lever_arm(T.translation(), file);
  return T;
}

/// Refuses what no camera has, and what would overflow where it is multiplied.
void check_camera(const std::filesystem::path& file, std::string_view name,
                  const std::vector<double>& values, double lowest) {
  for (const double value : values) {
    if (value >= lowest && value <= kMaxCameraValue) continue;
    throw InputError(file.string(), fmt::format("{} in {}", value, name),
                     fmt::format("{} to {}", lowest, kMaxCameraValue));
  }
}

Eigen::Affine3d read_tracking_calibration(const std::filesystem::path& file) {
  const std::vector<double> R = read_row(file, {"R0_rect", "R_rect"}, 9);
  const std::vector<double> T = read_row(file, {"Tr_velo_to_cam", "Tr_velo_cam"}, 12);
  const Eigen::Matrix3d turn = rotation({T[0], T[1], T[2], T[4], T[5], T[6], T[8], T[9], T[10]});
  return checked(file,
                 affine(rotation(R), Eigen::Vector3d::Zero()) * affine(turn, {T[3], T[7], T[11]}));
}

Eigen::Affine3d read_raw_calibration(const std::filesystem::path& folder) {
  const std::filesystem::path velo = folder / "calib_velo_to_cam.txt";
  const std::vector<double> rect = read_row(folder / "calib_cam_to_cam.txt", {"R_rect_00"}, 9);
  const std::vector<double> R = read_row(velo, {"R"}, 9);
  const std::vector<double> T = read_row(velo, {"T"}, 3);
  return checked(velo, affine(rotation(rect), Eigen::Vector3d::Zero()) *
                           affine(rotation(R), {T[0], T[1], T[2]}));
}

/// Where the calibration of a label file stands: a file of the tracking or object benchmark, or a
/// KITTI raw date folder.
struct Calibration {
  std::filesystem::path place;
  bool is_raw = false;
};

Calibration find_calibration(const std::filesystem::path& label_file) {
  const std::filesystem::path folder = std::filesystem::absolute(label_file).parent_path();
  for (const std::filesystem::path& file :
       {folder / "calib.txt", folder.parent_path() / "calib" / label_file.filename()}) {
    if (std::filesystem::exists(file)) return {file, false};
  }
  // <date>/<drive>/<label folder>/<file>: three levels reach the date folder.
  std::filesystem::path above = folder;
  for (int level = 0; level < 3; ++level, above = above.parent_path()) {
    if (std::filesystem::exists(above / "calib_velo_to_cam.txt") &&
        std::filesystem::exists(above / "calib_cam_to_cam.txt")) {
      return {above, true};
    }
  }
  throw InputError(label_file.string(), "no calibration",
                   "calib.txt beside it, ../calib/ with its name, or calib_velo_to_cam.txt and "
                   "calib_cam_to_cam.txt above it: copy the calibration there");
}

Eigen::Affine3d T_rect_lidar_of(const Calibration& calibration) {
  return calibration.is_raw ? read_raw_calibration(calibration.place)
                            : read_tracking_calibration(calibration.place);
}

/// Sizes of KITTI's rectified images, which differ from day to day as the focal lengths do:
/// 2011_09_26, _28, _29, _30 and 2011_10_03.
Eigen::Vector2d image_size_px(const std::filesystem::path& file, double focal_px) {
  struct Day {
    double focal_px, width_px, height_px;
  };
  constexpr std::array<Day, 5> kDays{{{721.5377, 1242.0, 375.0},
                                      {707.0493, 1224.0, 370.0},
                                      {718.3351, 1238.0, 374.0},
                                      {707.0912, 1226.0, 370.0},
                                      {718.8560, 1241.0, 376.0}}};
  for (const Day& day : kDays) {
    if (std::abs(day.focal_px - focal_px) < 1e-3) return {day.width_px, day.height_px};
  }
  throw InputError(file.string(), "a focal length of " + std::to_string(focal_px) + " pixels",
                   "one of KITTI's: 707.0493, 707.0912, 718.3351, 718.856 or 721.5377");
}

}  // namespace

Eigen::Affine3d read_T_rect_lidar(const std::filesystem::path& label_file) {
  return T_rect_lidar_of(find_calibration(label_file));
}

CameraView read_camera_view(const std::filesystem::path& label_file) {
  const Calibration calibration = find_calibration(label_file);
  CameraView view;
  std::vector<double> P;
  if (calibration.is_raw) {
    const std::filesystem::path file = calibration.place / "calib_cam_to_cam.txt";
    P = read_row(file, {"P_rect_02"}, 12);
    check_camera(file, "P_rect_02", P, -kMaxCameraValue);
    const std::vector<double> size = read_row(file, {"S_rect_02"}, 2);
    check_camera(file, "S_rect_02", size, 1.0);
    view.size_px = {size[0], size[1]};
  } else {
    P = read_row(calibration.place, {"P2"}, 12);
    check_camera(calibration.place, "P2", P, -kMaxCameraValue);
    view.size_px = image_size_px(calibration.place, P[0]);
  }
  const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> P_image_rect(P.data());
  view.P_image_lidar = P_image_rect * T_rect_lidar_of(calibration).matrix();
  return view;
}

}  // namespace stillmap::maps
