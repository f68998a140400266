#include "drives/calibration.hpp"

#include <fmt/format.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>

#include <array>
#include <cmath>
#include <optional>
#include <string_view>

#include <stillmap/maps/text.hpp>

namespace stillmap::maps {
namespace {

using Calibration = std::map<std::string, std::vector<double>>;

std::optional<std::vector<double>> parse_values(const std::vector<std::string_view>& fields) {
  std::vector<double> values;
  for (const std::string_view field : fields) {
    const std::optional<double> value = parse_number(field);
    if (!value || !std::isfinite(*value)) return std::nullopt;
    values.push_back(*value);
  }
  return values;
}

Calibration read_existing(const std::filesystem::path& file) {
  if (!std::filesystem::exists(file))
    throw InputError(file.string(), "no file", "a calibration: copy it there");
  return read_calibration(file);
}

const std::vector<double>& entry(const Calibration& calibration, const std::string& key,
                                 std::size_t size, const std::filesystem::path& file) {
  const auto found = calibration.find(key);
  if (found == calibration.end() || found->second.size() != size) {
    throw InputError(file.string(),
                     found == calibration.end()
                         ? "no entry '" + key + "' of numbers"
                         : std::to_string(found->second.size()) + " numbers in '" + key + "'",
                     "'" + key + ":' with " + std::to_string(size));
  }
  return found->second;
}

Eigen::Isometry3d checked(const Eigen::Matrix3d& R, const Eigen::Vector3d& t,
                          const std::filesystem::path& file) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = R;
  T.translation() = t;
  const Eigen::Matrix3d off = R.transpose() * R - Eigen::Matrix3d::Identity();
  if (!(off.cwiseAbs().maxCoeff() <= 1e-3) || R.determinant() < 0.0) {
    throw InputError(file.string(), "a 3x3 part that is no rotation",
                     "a rigid transform: correct the matrix");
  }
  check_lever_arm(t, file);
  return renormalized(T);
}

}  // namespace

void check_lever_arm(const Eigen::Vector3d& t_m, const std::filesystem::path& file) {
  constexpr double kMaxLeverArmM = 1000.0;
  // Written so that a NaN is refused too; no norm, which overflows.
  if (t_m.cwiseAbs().maxCoeff() <= kMaxLeverArmM && t_m.allFinite()) return;
  throw InputError(file.string(),
                   fmt::format("sensors {}, {}, {} m apart", t_m.x(), t_m.y(), t_m.z()),
                   fmt::format("up to {} m along each axis", kMaxLeverArmM));
}

Calibration read_calibration(const std::filesystem::path& file) {
  const std::string text = read_text(file);
  Calibration calibration;
  for (NumberLine& line : number_lines(text)) {
    std::string key(line.fields.front());
    // The tracking benchmark leaves the colon out of some keys.
    if (key.back() == ':') key.pop_back();
    line.fields.erase(line.fields.begin());
    if (std::optional<std::vector<double>> values = parse_values(line.fields)) {
      calibration[key] = std::move(*values);
    }
  }
  return calibration;
}

Eigen::Isometry3d read_T_velo_imu(const std::filesystem::path& file) {
  const Calibration calibration = read_existing(file);
  const std::vector<double>& r = entry(calibration, "R", 9, file);
  const std::vector<double>& t = entry(calibration, "T", 3, file);
  return checked(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(r.data()),
                 Eigen::Vector3d(t[0], t[1], t[2]), file);
}

Eigen::Isometry3d read_T_cam_velo(const std::filesystem::path& file) {
  const Calibration calibration = read_existing(file);
  for (const std::string key : {"Tr", "Tr_velo_to_cam", "Tr_velo_cam"}) {
    if (!calibration.contains(key)) continue;
    const std::vector<double>& n = entry(calibration, key, 12, file);
    const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> T(n.data());
    return checked(T.leftCols<3>(), T.col(3), file);
  }
  throw InputError(file.string(), "no entry for velodyne to camera",
                   "'Tr:', 'Tr_velo_to_cam:' or 'Tr_velo_cam:' with 12 numbers: copy the drive's "
                   "whole calibration");
}

}  // namespace stillmap::maps
