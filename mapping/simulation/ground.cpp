#include <array>
#include <cmath>

#include "random.hpp"
#include "street.hpp"

namespace stillmap::simulation {
namespace {

constexpr double kAlongStep = 0.75;
constexpr double kAsphaltRoughness = 0.003;
constexpr double kGardenRoughness = 0.03;

/// Offsets of the section's corners on one side; two at the kerb make its face.
constexpr std::array<double, 20> kOffsets{
    0.0, 0.75, 1.5, 2.25, 3.0, 3.75, 4.5,  5.19, 5.21, 5.9,
    6.8, 7.69, 8.0, 8.7,  9.5, 10.5, 12.0, 15.0, 20.0, StreetSection::kEnd};

Surface surface_at(double d) {
  if (std::abs(d) < StreetSection::kKerb - 0.005) return Surface::kAsphalt;
  return std::abs(d) < StreetSection::kPavementEnd ? Surface::kPavement : Surface::kGrass;
}

double roughness(std::uint64_t seed, double s, double d) {
  const double amplitude =
      std::abs(d) > StreetSection::kPavementEnd ? kGardenRoughness : kAsphaltRoughness;
  const auto row = static_cast<std::uint64_t>(std::llround(s / kAlongStep));
  const auto column = static_cast<std::uint64_t>(std::llround(d * 100.0));
  Random random(key_of({seed, static_cast<std::uint64_t>(Stream::kGround), row, column}));
  return random.uniform(-amplitude, amplitude);
}

}  // namespace

void add_ground(Mesh& mesh, const Road& road, std::uint64_t seed) {
  std::vector<double> offsets(kOffsets.rbegin(), kOffsets.rend() - 1);
  for (double& d : offsets) d = -d;
  offsets.insert(offsets.end(), kOffsets.begin(), kOffsets.end());
  const auto first_row = static_cast<std::int64_t>(std::ceil(road.begin_m() / kAlongStep));
  const auto last_row = static_cast<std::int64_t>(std::floor(road.end_m() / kAlongStep));
  const auto columns = static_cast<std::uint32_t>(offsets.size());
  auto base = static_cast<std::uint32_t>(mesh.vertices.size());
  for (std::int64_t row = first_row; row <= last_row; ++row) {
    const double s = static_cast<double>(row) * kAlongStep;
    for (const double d : offsets) {
      Eigen::Vector3d p = road.surface(s, d);
      p.z() += roughness(seed, s, d);
      mesh.vertices.push_back(p.cast<float>());
    }
    if (row == first_row) continue;
    for (std::uint32_t k = 0; k + 1 < columns; ++k) {
      const std::uint32_t near = base + k;
      const std::uint32_t far = near + columns;
      mesh.triangles.push_back({near, near + 1, far + 1});
      mesh.triangles.push_back({near, far + 1, far});
      mesh.surfaces.insert(mesh.surfaces.end(), 2, surface_at(0.5 * (offsets[k] + offsets[k + 1])));
    }
    base += columns;
  }
}

}  // namespace stillmap::simulation
