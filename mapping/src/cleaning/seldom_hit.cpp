#include "cleaning/seldom_hit.hpp"

#include <cstddef>
#include <unordered_map>

namespace stillmap::mapping {
namespace {

constexpr std::size_t kFewestScans = 200;
constexpr double kOftenShare = 0.03;
constexpr float kCompanyM = 0.2F;

/// In cubes as wide as the company, so that it is in 27 of them.
std::uint64_t company_key(const Eigen::Vector3i& cube) {
  constexpr std::uint64_t kMask = (1U << 21U) - 1;
  return ((static_cast<std::uint64_t>(cube.x()) & kMask) << 42U) |
         ((static_cast<std::uint64_t>(cube.y()) & kMask) << 21U) |
         (static_cast<std::uint64_t>(cube.z()) & kMask);
}

Eigen::Vector3i company_cube(const Eigen::Vector3f& p) {
  return (p / kCompanyM).array().floor().cast<int>();
}

}  // namespace

std::vector<std::uint8_t> seldom_hit(const CleaningPoints& points, const Eigen::AlignedBox2f& area,
                                     const PosedViews& views, std::span<const Keyframe> keyframes) {
  std::vector<std::uint8_t> flags(points.positions.size());
  const std::size_t scans = views.T_local_lidar.size();
  if (scans < kFewestScans || keyframes.empty() ||
      keyframes.front().place != keyframes.back().place)
    return flags;
  // Of cells that are hit often.
  std::unordered_map<std::uint64_t, std::vector<Eigen::Vector3f>> often;
  for (std::size_t i = 0; i < flags.size(); ++i) {
    if (points.scans[i] >= kOftenShare * static_cast<double>(scans))
      often[company_key(company_cube(points.positions[i]))].push_back(points.positions[i]);
  }
  const auto in_company = [&](const Eigen::Vector3f& p) {
    const Eigen::Vector3i cube = company_cube(p);
    for (int n = 0; n < 27; ++n) {
      const auto found =
          often.find(company_key(cube + Eigen::Vector3i(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1)));
      if (found == often.end()) continue;
      for (const Eigen::Vector3f& other : found->second) {
        if ((other - p).squaredNorm() <= kCompanyM * kCompanyM) return true;
      }
    }
    return false;
  };
  for (std::size_t i = 0; i < flags.size(); ++i) {
    const Eigen::Vector3f& p = points.positions[i];
    flags[i] = area.contains(Eigen::Vector2f(p.head<2>())) && !in_company(p) ? 1 : 0;
  }
  return flags;
}

}  // namespace stillmap::mapping
