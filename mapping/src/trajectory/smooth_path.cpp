#include "trajectory/smooth_path.hpp"

#include <algorithm>
#include <stdexcept>

namespace stillmap::mapping {

SmoothPath::SmoothPath(const std::vector<Pose>& poses, double box_s) : box_s_(box_s) {
  if (poses.size() < 2 || !(box_s > 0.0))
    throw std::invalid_argument("SmoothPath: fewer than two poses, or no box");
  for (std::size_t i = 0; i < poses.size(); ++i) {
    Values values;
    Eigen::Vector4d q = Eigen::Quaterniond(poses[i].T.linear()).normalized().coeffs();
    if (i > 0 && q.dot(values_.back().tail<4>()) < 0.0) q = -q;
    values << poses[i].T.translation() - poses.front().T.translation(), q;
    t_s_.push_back(poses[i].t_s);
    integrals_.push_back(Values::Zero());
    unknown_.push_back(0);
    if (i > 0) {
      // Not over a way that is not known: one of years would cost the digits of all that follows.
      integrals_[i] = integrals_[i - 1];
      if (poses[i].follows)
        integrals_[i] += 0.5 * (t_s_[i] - t_s_[i - 1]) * (values + values_.back());
      unknown_[i] = unknown_[i - 1] + (poses[i].follows ? 0 : 1);
    }
    values_.push_back(values);
  }
}

std::size_t SmoothPath::segment_at(double t_s) const {
  const auto after = std::upper_bound(t_s_.begin() + 1, t_s_.end() - 1, t_s);
  return static_cast<std::size_t>(after - t_s_.begin()) - 1;
}

SmoothPath::Values SmoothPath::integral_to(double t_s, std::size_t segment) const {
  const double length_s = t_s_[segment + 1] - t_s_[segment];
  const double u_s = t_s - t_s_[segment];
  return integrals_[segment] + u_s * values_[segment] +
         0.5 * u_s * u_s / length_s * (values_[segment + 1] - values_[segment]);
}

bool SmoothPath::is_known(double from_s, double to_s) const {
  return unknown_[segment_at(to_s) + 1] == unknown_[segment_at(from_s)];
}

std::optional<Eigen::Isometry3d> SmoothPath::at(double t_s) const {
  const double from_s = t_s - 0.5 * box_s_, to_s = t_s + 0.5 * box_s_;
  if (from_s < begin_s() || to_s > end_s() || !is_known(from_s, to_s)) return std::nullopt;
  const Values mean =
      (integral_to(to_s, segment_at(to_s)) - integral_to(from_s, segment_at(from_s))) / box_s_;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = mean.head<3>();
  T.linear() = Eigen::Quaterniond(Eigen::Vector4d(mean.tail<4>())).normalized().toRotationMatrix();
  return T;
}

std::optional<Eigen::Isometry3d> SmoothPath::motion(double from_s, double to_s,
                                                    bool throughout) const {
  const auto T_from = at(from_s), T_to = at(to_s);
  if (!T_from || !T_to || (throughout && !is_known(from_s, to_s))) return std::nullopt;
  return T_from->inverse(Eigen::Isometry) * *T_to;
}

}  // namespace stillmap::mapping
