#include "roads/path.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace stillmap::simulation {
namespace {

// Points of a path are averaged over this many metres on both sides, twice: lanes meet without a
// jump in curvature, as drivers turn a steering wheel.
constexpr int kSmoothing = 2;

std::vector<Eigen::Vector2d> every_metre(const std::vector<Eigen::Vector2d>& points) {
  std::vector<Eigen::Vector2d> even{points.front()};
  double left = 1.0;
  for (std::size_t i = 1; i < points.size(); ++i) {
    Eigen::Vector2d from = points[i - 1];
    double length = (points[i] - from).norm();
    while (length >= left) {
      from += left / length * (points[i] - from);
      even.push_back(from);
      length = (points[i] - from).norm();
      left = 1.0;
    }
    left -= length;
  }
  return even;
}

std::vector<double> smoothed(const std::vector<double>& values) {
  std::vector<double> result(values.size());
  const auto last = static_cast<std::ptrdiff_t>(values.size()) - 1;
  for (std::ptrdiff_t i = 0; i <= last; ++i) {
    // Fewer neighbours near an end, so that ends stay.
    const std::ptrdiff_t reach = std::min<std::ptrdiff_t>({kSmoothing, i, last - i});
    double sum = 0.0;
    for (std::ptrdiff_t k = i - reach; k <= i + reach; ++k)
      sum += values[static_cast<std::size_t>(k)];
    result[static_cast<std::size_t>(i)] = sum / static_cast<double>(2 * reach + 1);
  }
  return result;
}

/// A place where the motion of something counts as standing [m/s].
constexpr double kStanding = 0.05;

}  // namespace

double spline_value(const std::vector<double>& controls, double u) {
  const auto last = static_cast<std::ptrdiff_t>(controls.size()) - 1;
  const double at = std::clamp(u, 0.0, static_cast<double>(last));
  const auto i = std::min(static_cast<std::ptrdiff_t>(at), last);
  const double t = at - static_cast<double>(i);
  // Mirrored ends: the line goes through its first and last control values.
  const auto value = [&](std::ptrdiff_t k) {
    if (k < 0)
      return 2.0 * controls.front() - controls[static_cast<std::size_t>(std::min(-k, last))];
    if (k > last) {
      return 2.0 * controls.back() -
             controls[static_cast<std::size_t>(std::max<std::ptrdiff_t>(2 * last - k, 0))];
    }
    return controls[static_cast<std::size_t>(k)];
  };
  const double t2 = t * t;
  const double t3 = t2 * t;
  return ((1.0 - 3.0 * t + 3.0 * t2 - t3) * value(i - 1) + (4.0 - 6.0 * t2 + 3.0 * t3) * value(i) +
          (1.0 + 3.0 * t + 3.0 * t2 - 3.0 * t3) * value(i + 1) + t3 * value(i + 2)) /
         6.0;
}

Path::Path(const std::vector<Eigen::Vector2d>& points) {
  if (points.size() < 2) throw std::invalid_argument("a path has at least two points");
  for (const Eigen::Vector2d& p : every_metre(points)) {
    x_.push_back(p.x());
    y_.push_back(p.y());
  }
  if (x_.size() < 2) throw std::invalid_argument("a path is at least 1 m long");
  for (int pass = 0; pass < 2; ++pass) {
    x_ = smoothed(x_);
    y_ = smoothed(y_);
  }
}

double Path::heading_rad(double station_m) const {
  constexpr double kH = 0.05;
  const double s = std::clamp(station_m, kH, length_m() - kH);
  return std::atan2(spline_value(y_, s + kH) - spline_value(y_, s - kH),
                    spline_value(x_, s + kH) - spline_value(x_, s - kH));
}

Eigen::Vector2d Path::point(double station_m, double offset_m) const {
  Eigen::Vector2d p(spline_value(x_, station_m), spline_value(y_, station_m));
  if (offset_m == 0.0) return p;
  const double heading = heading_rad(station_m);
  return p + offset_m * Eigen::Vector2d(-std::sin(heading), std::cos(heading));
}

double Path::curvature(double station_m) const {
  constexpr double kH = 1.0;
  const double turn = heading_rad(station_m + kH) - heading_rad(station_m - kH);
  return std::remainder(turn, 2.0 * std::numbers::pi) / (2.0 * kH);
}

double Motion::station(double time_s) const {
  return spline_value(stations_m, (time_s - begin_s) / kStep_s);
}

Eigen::Vector2d Motion::point(double time_s) const {
  return path->point(station(time_s), spline_value(offsets_m, (time_s - begin_s) / kStep_s));
}

double Motion::speed_mps(double time_s) const {
  constexpr double kH = 0.05;
  return (station(time_s + kH) - station(time_s - kH)) / (2.0 * kH);
}

double Motion::heading_rad(double time_s) const {
  constexpr double kH = 0.02;
  const double along = path->heading_rad(station(time_s));
  const double speed = speed_mps(time_s);
  if (std::abs(speed) < kStanding) return along;
  const double u = (time_s - begin_s) / kStep_s;
  const double sideways =
      (spline_value(offsets_m, u + kH / kStep_s) - spline_value(offsets_m, u - kH / kStep_s)) /
      (2.0 * kH);
  // Backwards along the path means turned round. Fades to the path's heading where it stands.
  const double turned = speed < 0.0 ? std::numbers::pi : 0.0;
  return along + turned + std::atan2(sideways, std::max(std::abs(speed), 1.0));
}

}  // namespace stillmap::simulation
