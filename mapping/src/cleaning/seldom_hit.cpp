#include "cleaning/seldom_hit.hpp"

#include <stillmap/maps/cell_table.hpp>

#include <cstddef>

namespace stillmap::mapping {
namespace {

constexpr std::size_t kFewestScans = 200;
constexpr double kOftenShare = 0.04;
/// Height, and way along the ground, which noise spreads a surface over that is seen at a grazing
/// angle.
constexpr float kCompanyM = 0.2F;
constexpr float kCompanyPerM = 0.005F;

/// In cubes as wide as the company, so that it is in 27 of them.
std::uint64_t company_key(const Eigen::Vector3i& cube) {
  return maps::signed_cell_key(cube.x(), cube.y(), cube.z());
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
  maps::CellMap<std::vector<Eigen::Vector3f>> often;
  for (std::size_t i = 0; i < flags.size(); ++i) {
    if (points.scans[i] >= kOftenShare * static_cast<double>(scans))
      often[company_key(company_cube(points.positions[i]))].push_back(points.positions[i]);
  }
  const Eigen::Vector3f sensor = views.T_local_lidar.front().translation().cast<float>();
  const auto in_company = [&](const Eigen::Vector3f& p) {
    const float reach_m = kCompanyM + kCompanyPerM * (p - sensor).norm();
    const Eigen::Vector3f reach(reach_m, reach_m, kCompanyM);
    const Eigen::Vector3i low = company_cube(p - reach), high = company_cube(p + reach);
    const Eigen::Array3f scale = 1.0F / reach.array();
    for (int x = low.x(); x <= high.x(); ++x)
      for (int y = low.y(); y <= high.y(); ++y)
        for (int z = low.z(); z <= high.z(); ++z) {
          const std::vector<Eigen::Vector3f>* found = often.find(company_key({x, y, z}));
          if (found == nullptr) continue;
          for (const Eigen::Vector3f& other : *found) {
            if (((other - p).array() * scale).matrix().squaredNorm() <= 1.0F) return true;
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
