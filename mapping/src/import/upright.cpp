#include "import/upright.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr std::size_t kMostSampled = 65'536;
constexpr std::size_t kFewestJudged = 200;
/// How much longer than the shortest z must be; streets of towers are as high as they are wide.
constexpr double kLonger = 2.0;
/// Extents leave out so many points at both ends.
constexpr double kLeftOut = 0.05;

struct Extent {
  double length_m = 0.0;
  /// More points lie in the lower half: the ground is there.
  bool grows_up = true;
};

Extent extent_along(const std::vector<Eigen::Vector3d>& points, Eigen::Index axis) {
  std::vector<double> values;
  values.reserve(points.size());
  for (const Eigen::Vector3d& p : points) values.push_back(p[axis]);
  std::sort(values.begin(), values.end());
  const auto at = [&](double share) {
    return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
  };
  const double low = at(kLeftOut), high = at(1.0 - kLeftOut);
  return {high - low, at(0.5) <= 0.5 * (low + high)};
}

}  // namespace

bool is_axis(std::string_view up) {
  constexpr std::array<std::string_view, 6> kAxes{"x", "-x", "y", "-y", "z", "-z"};
  return std::ranges::find(kAxes, up) != kAxes.end();
}

Eigen::Matrix3d R_upright(std::string_view up) {
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  if (up == "y") R << 0, 0, 1, 1, 0, 0, 0, 1, 0;
  if (up == "-y") R << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  if (up == "x") R << 0, 1, 0, 0, 0, 1, 1, 0, 0;
  if (up == "-x") R << 0, 0, 1, 0, 1, 0, -1, 0, 0;
  if (up == "-z") R << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  return R;
}

void UprightCheck::add(const Eigen::Vector3d& position) {
  if (seen_++ % step_ != 0) return;
  if (sample_.size() == kMostSampled) {
    for (std::size_t i = 0; 2 * i < sample_.size(); ++i) sample_[i] = sample_[2 * i];
    sample_.resize(sample_.size() / 2);
    step_ *= 2;
    // What was dropped above is not the number that is taken next.
    if ((seen_ - 1) % step_ != 0) return;
  }
  sample_.push_back(position);
}

std::string UprightCheck::finding() const {
  if (sample_.size() < kFewestJudged) return {};
  const std::array<Extent, 3> extents{extent_along(sample_, 0), extent_along(sample_, 1),
                                      extent_along(sample_, 2)};
  const std::size_t flat = extents[0].length_m < extents[1].length_m ? 0 : 1;
  if (extents[2].length_m <= kLonger * extents[flat].length_m) return {};
  const char axis = flat == 0 ? 'x' : 'y';
  return fmt::format(
      "the map stands on its side: 90 % of its points lie within {:.0f} m along z and {:.0f} m "
      "along "
      "{}; import it with --up {}{}",
      extents[2].length_m, extents[flat].length_m, axis, extents[flat].grows_up ? "" : "-", axis);
}

}  // namespace stillmap::mapping
