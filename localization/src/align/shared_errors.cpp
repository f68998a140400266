#include "shared_errors.hpp"

#include "clustered_sums.hpp"
#include "index/voxel_table.hpp"
#include "registration.hpp"

#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

namespace stillmap::localization {
namespace {

using Matrix12d = Eigen::Matrix<double, 12, 12>;
using Vector12d = Eigen::Matrix<double, 12, 1>;
using Matrix63d = Eigen::Matrix<double, 6, 3>;

/// Rows that are asked: every second one is enough.
constexpr std::size_t kSharedStride = 2;

/// Number of sectors of azimuth; the surfaces of one are shifted together. One sector is worth so
/// many independent surfaces.
constexpr std::size_t kDirections = 8;
constexpr double kSurfacesOfSector = 4.0;

/// Weight of the variance that the sectors' pulls against each other tell, once so many times what
/// the noise of their blocks explains is taken off.
constexpr double kPullWeight = 2.0;
constexpr double kPullOfNoise = 1.5;

/// What a real sensor's calibration leaves, beside the floor that simulated ones need.
constexpr double kCalibrationM = 1.2e-3;

/// Deviations of a motion that may be left in a scan. What is faster than some 3 m/s shows
/// (`take_times_of_a_turn`).
constexpr double kSpeedLeftM_S = 0.6;
constexpr double kTurnLeftRad_S = 0.15;
/// The same of a scan whose sender says that it was deskewed, as a share.
constexpr double kLittleShare = 0.5;
/// The best-fitting twist is not applied; this share of its effect on the pose counts as a standard
/// deviation.
constexpr double kFoundShare = 0.5;
/// How long the sensor takes to turn once [s].
constexpr double kSharedTurnS = 0.1;

struct Sector {
  /// Derivative of the gradient of all by a shift of this sector's surfaces.
  Matrix63d H = Matrix63d::Zero();
  Vector6d gradient = Vector6d::Zero();
};

class SharedErrors {
 public:
  explicit SharedErrors(double kernel_m) : kernel_m_(kernel_m) {}

  void add(const ResidualRows& rows, std::size_t row, const Eigen::Isometry3d& T_index_lidar) {
    const auto [residual_m, J] = axis_residual(rows, row, T_index_lidar);
    const Eigen::Vector3d point(rows.point_x[row], rows.point_y[row], rows.point_z[row]);
    const double azimuth = std::atan2(point.y(), point.x()) / (2.0 * std::numbers::pi);
    const auto variance_m2 = static_cast<double>(rows.variance_m2[row]);
    const double robust = robust_weight(residual_m * residual_m, kernel_m_);
    const double weight = robust / (variance_m2 + kernel_variance_m2(kernel_m_));
    robust_ += robust;
    thickness_m2_ += robust * variance_m2;
    const Matrix6d outer = weight * J * J.transpose();
    H_ += outer;
    const auto sector = static_cast<std::size_t>((azimuth + 0.5) * kDirections) % kDirections;
    sectors_[sector].H += outer.leftCols<3>();
    sectors_[sector].gradient += weight * residual_m * J;
    const double time_s = kSharedTurnS * azimuth;
    H_time_ += time_s * outer;
    H_time2_ += time_s * time_s * outer;
    Vector12d& gradient = block_of(T_index_lidar * point);
    gradient.head<6>() += weight * residual_m * J;
    gradient.tail<6>() += time_s * weight * residual_m * J;
  }

  [[nodiscard]] Matrix6d covariance(MotionLeft motion_left) const {
    if (!(robust_ > 0.0)) return Matrix6d::Zero();
    Matrix6d covariance = by_map();
    covariance.diagonal().head<2>().array() += kCalibrationM * kCalibrationM;
    if (motion_left != MotionLeft::kNone)
      covariance += by_motion(motion_left == MotionLeft::kLittle ? kLittleShare : 1.0);
    return 0.5 * (covariance + covariance.transpose());
  }

 private:
  Vector12d& block_of(const Eigen::Vector3d& at_m) {
    const auto [block, inserted] = blocks_.insert(error_block(at_m));
    if (inserted) gradients_.emplace_back(Vector12d::Zero());
    return gradients_[block];
  }

  /// A shift s of the surfaces of a sector draws the pose by -H^-1 H_sector s: as the thickness of
  /// the surfaces tells it, and as the sectors pull against each other.
  [[nodiscard]] Matrix6d by_map() const {
    const double excess_m2 =
        std::max(0.0, thickness_m2_ / robust_ - kUsualThicknessM * kUsualThicknessM);
    const Matrix6d inverse = bounded_inverse<6>(in_metres(H_));
    Matrix6d spread = Matrix6d::Zero(), pulls = Matrix6d::Zero(), noise = Matrix6d::Zero();
    for (const Sector& sector : sectors_) {
      spread += excess_m2 / kSurfacesOfSector * sector.H * sector.H.transpose();
      pulls += sector.gradient * sector.gradient.transpose();
    }
    for (const Vector12d& block : gradients_)
      noise += block.head<6>() * block.head<6>().transpose();
    const auto energy_of = [&](const Matrix6d& sum) { return (inverse * in_metres(sum)).trace(); };
    const double pulled = energy_of(pulls);
    const double explained = kPullOfNoise * energy_of(noise);
    if (pulled > explained) spread += kPullWeight * (1.0 - explained / pulled) * pulls;
    return out_of_metres(inverse * in_metres(spread) * inverse);
  }

  /// A twist x draws the pose by -H_pp^-1 H_pt x.
  [[nodiscard]] Matrix6d by_motion(double share) const {
    const double speed_m_s = share * kSpeedLeftM_S, turn_rad_s = share * kTurnLeftRad_S;
    const double time_s = std::sqrt(H_time2_.trace() / H_.trace());
    Vector12d units;
    units << kUnitsOfPose, kUnitsOfPose / std::max(1e-3, time_s);
    Matrix12d H = Matrix12d::Zero();
    H.diagonal().segment<3>(6).setConstant(1.0 / (speed_m_s * speed_m_s));
    H.diagonal().tail<3>().setConstant(1.0 / (turn_rad_s * turn_rad_s));
    Matrix12d spread = H;
    H.topLeftCorner<6, 6>() += H_;
    H.topRightCorner<6, 6>() += H_time_;
    H.bottomLeftCorner<6, 6>() += H_time_;
    H.bottomRightCorner<6, 6>() += H_time2_;
    Vector12d gradient = Vector12d::Zero();
    for (const Vector12d& block : gradients_) {
      spread += kNeighbourFactor * block * block.transpose();
      gradient += block;
    }
    const auto in_units = [&](const Matrix12d& matrix) -> Matrix12d {
      return units.asDiagonal() * matrix * units.asDiagonal();
    };
    const Matrix12d scaled = in_units(H);
    const Matrix12d inverse = bounded_inverse<12>(scaled);
    const Vector6d found = (inverse * units.cwiseProduct(gradient)).tail<6>();
    const Matrix6d twist = (inverse * in_units(spread) * inverse).bottomRightCorner<6, 6>() +
                           kFoundShare * kFoundShare * found * found.transpose();
    const Matrix6d draw =
        bounded_inverse<6>(scaled.topLeftCorner<6, 6>()) * scaled.topRightCorner<6, 6>();
    return out_of_metres(draw * twist * draw.transpose());
  }

  double kernel_m_;
  double robust_ = 0.0, thickness_m2_ = 0.0;
  Matrix6d H_ = Matrix6d::Zero(), H_time_ = Matrix6d::Zero(), H_time2_ = Matrix6d::Zero();
  std::array<Sector, kDirections> sectors_;
  VoxelTable blocks_;
  std::vector<Vector12d> gradients_;
};

}  // namespace

Matrix6d covariance_of_shared_errors(const ResidualRows& rows,
                                     const Eigen::Isometry3d& T_index_lidar, float kernel_m,
                                     MotionLeft motion_left) {
  SharedErrors errors(static_cast<double>(kernel_m));
  for (std::size_t row = 0; row < rows.count; row += kSharedStride)
    errors.add(rows, row, T_index_lidar);
  return errors.covariance(motion_left);
}

}  // namespace stillmap::localization
