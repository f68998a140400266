#include "residual_rows.hpp"

#include <array>

// Compiled once for each instruction set; the best one is chosen when the program runs.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "align/residual_rows.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace stillmap::localization::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// Lower triangle of H row by row, gradient, cost.
constexpr std::size_t kSums = 21 + 6 + 1;
/// Rows after which the float sums go over into doubles.
constexpr std::size_t kRowsBetweenFlushes = 1024;

void sum_rows(const ResidualRows& rows, const float* R, const float* t, float kernel_m,
              double* sums) {
  const hn::CappedTag<float, kMostLanes> d;
  using V = hn::Vec<decltype(d)>;
  const std::size_t lanes = hn::Lanes(d);
  const V kernel2 = hn::Set(d, kernel_m * kernel_m);
  const V kernel_share = hn::Set(d, kernel_variance_m2(kernel_m));
  std::array<V, 9> rotation;
  for (std::size_t k = 0; k < 9; ++k) rotation[k] = hn::Set(d, R[k]);
  const V tx = hn::Set(d, t[0]), ty = hn::Set(d, t[1]), tz = hn::Set(d, t[2]);
  for (std::size_t begin = 0; begin < rows.count; begin += kRowsBetweenFlushes) {
    const std::size_t end = HWY_MIN(rows.count, begin + kRowsBetweenFlushes);
    std::array<V, kSums> partial;
    for (V& sum : partial) sum = hn::Zero(d);
    for (std::size_t i = begin; i < end; i += lanes) {
      const auto load = [&](const std::vector<float>& column)
                            HWY_ATTR { return hn::LoadU(d, column.data() + i); };
      const V px = load(rows.point_x), py = load(rows.point_y), pz = load(rows.point_z);
      const V nx = load(rows.normal_x), ny = load(rows.normal_y), nz = load(rows.normal_z);
      // Point relative to the sensor, along the map's axes.
      const auto turned = [&](std::size_t k) HWY_ATTR {
        return hn::MulAdd(rotation[k], px,
                          hn::MulAdd(rotation[k + 1], py, hn::Mul(rotation[k + 2], pz)));
      };
      const V qx = turned(0), qy = turned(3), qz = turned(6);
      const V residual = hn::MulAdd(
          nx, hn::Add(qx, tx),
          hn::MulAdd(ny, hn::Add(qy, ty), hn::MulSub(nz, hn::Add(qz, tz), load(rows.offset))));
      const V residual2 = hn::Mul(residual, residual);
      const V share = hn::Div(kernel2, hn::Add(kernel2, residual2));
      const V variance = hn::Add(load(rows.variance_m2), kernel_share);
      const V weight = hn::Div(hn::Mul(share, share), variance);
      const std::array<V, 6> J{nx,
                               ny,
                               nz,
                               hn::MulSub(qy, nz, hn::Mul(qz, ny)),
                               hn::MulSub(qz, nx, hn::Mul(qx, nz)),
                               hn::MulSub(qx, ny, hn::Mul(qy, nx))};
      std::size_t k = 0;
      for (std::size_t row = 0; row < 6; ++row) {
        const V weighted = hn::Mul(weight, J[row]);
        for (std::size_t column = 0; column <= row; ++column, ++k)
          partial[k] = hn::MulAdd(weighted, J[column], partial[k]);
        partial[21 + row] = hn::MulAdd(weighted, residual, partial[21 + row]);
      }
      partial[27] = hn::MulAdd(share, residual2, partial[27]);
    }
    for (std::size_t k = 0; k < kSums; ++k)
      sums[k] += static_cast<double>(hn::GetLane(hn::SumOfLanes(d, partial[k])));
  }
}

}  // namespace stillmap::localization::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stillmap::localization {
HWY_EXPORT(sum_rows);

void ResidualRows::grow(std::size_t rows) {
  for (std::vector<float>* column :
       {&point_x, &point_y, &point_z, &normal_x, &normal_y, &normal_z, &offset, &variance_m2}) {
    column->resize(rows);
  }
}

void ResidualRows::pad() {
  const std::size_t padded = (count + kMostLanes - 1) / kMostLanes * kMostLanes;
  if (padded > offset.size()) grow(padded);
  for (std::size_t row = count; row < padded; ++row) {
    set(row, Eigen::Vector3f::Zero(), Eigen::Vector3f::Zero(), 0.0F, 1.0F);
  }
}

AxisResidual axis_residual(const Eigen::Vector3d& axis, const Eigen::Vector3d& mean,
                           const Eigen::Isometry3d& T, const Eigen::Vector3d& p_lidar) {
  AxisResidual out;
  out.residual_m = axis.dot(T * p_lidar - mean);
  const Eigen::Vector3d g = T.linear().transpose() * axis;
  out.jacobian << g, p_lidar.cross(g);
  return out;
}

AxisResidual axis_residual(const ResidualRows& rows, std::size_t row,
                           const Eigen::Isometry3d& T_index_lidar) {
  const Eigen::Vector3d point(rows.point_x[row], rows.point_y[row], rows.point_z[row]);
  const Eigen::Vector3d normal(rows.normal_x[row], rows.normal_y[row], rows.normal_z[row]);
  const Eigen::Vector3d mean = rows.centre + static_cast<double>(rows.offset[row]) * normal;
  return axis_residual(normal, mean, T_index_lidar, point);
}

NormalEquations linearize(const ResidualRows& rows, const Eigen::Isometry3d& T_index_lidar,
                          float kernel_m) {
  const Eigen::Matrix<float, 3, 3, Eigen::RowMajor> R = T_index_lidar.linear().cast<float>();
  const Eigen::Vector3f t = (T_index_lidar.translation() - rows.centre).cast<float>();
  std::array<double, 28> sums{};
  HWY_DYNAMIC_DISPATCH(sum_rows)(rows, R.data(), t.data(), kernel_m, sums.data());
  NormalEquations out;
  std::size_t k = 0;
  for (Eigen::Index row = 0; row < 6; ++row) {
    for (Eigen::Index column = 0; column <= row; ++column, ++k)
      out.H(row, column) = out.H(column, row) = sums[k];
    out.gradient[row] = sums[static_cast<std::size_t>(21 + row)];
  }
  out.cost = sums[27];
  // The sums turn about the sensor along the map's axes; callers think in the lidar frame.
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = T_index_lidar.linear();
  out.H = turn.transpose() * out.H * turn;
  out.gradient = turn.transpose() * out.gradient;
  return out;
}

}  // namespace stillmap::localization
#endif  // HWY_ONCE
