#include "reference/polar_bins.hpp"

#include "reference/directions.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace stillmap::mapping {
namespace {

constexpr float kPi = std::numbers::pi_v<float>;
constexpr float kRingM = PolarBins::kMaxRangeM / static_cast<float>(PolarBins::kRings);
constexpr float kSectorsPerRad = static_cast<float>(PolarBins::kSectors) / (2.0F * kPi);

int sector_of(float azimuth_rad) {
  // The program counts from +x; where a count begins moves no border, since pi is one too.
  return static_cast<int>((azimuth_rad + kPi) * kSectorsPerRad);
}

}  // namespace

int PolarBins::bin_of(const Eigen::Vector3f& p) {
  if (!(p.z() > kMinHeightM && p.z() < kMaxHeightM)) return -1;
  const Spherical direction = spherical_of({p.x(), p.y(), 0.0F});
  if (!(direction.range_m <= kMaxRangeM)) return -1;
  const int ring = std::min(static_cast<int>(direction.range_m / kRingM), kRings - 1);
  const int sector = std::min(sector_of(direction.azimuth_rad), kSectors - 1);
  return ring * kSectors + sector;
}

bool PolarBins::touches(const Eigen::Vector3f& centre, float radius_m,
                        const std::array<std::uint8_t, kBins>& flags) {
  if (centre.z() - radius_m > kMaxHeightM || centre.z() + radius_m < kMinHeightM) return false;
  const Spherical direction = spherical_of({centre.x(), centre.y(), 0.0F});
  const float flat_m = direction.range_m;
  if (flat_m - radius_m > kMaxRangeM) return false;
  // asin(q) <= 1.05 q up to q = 0.5; nearer spheres are not worth looking at.
  if (flat_m < 2.0F * radius_m) return true;
  const float half_rad = 1.05F * radius_m / flat_m + 1e-4F;
  const auto ring_begin = static_cast<int>((flat_m - radius_m) / kRingM);
  const int ring_end = std::min(static_cast<int>((flat_m + radius_m) / kRingM), kRings - 1);
  const auto from =
      static_cast<int>(std::floor((direction.azimuth_rad - half_rad + kPi) * kSectorsPerRad));
  const auto to =
      static_cast<int>(std::floor((direction.azimuth_rad + half_rad + kPi) * kSectorsPerRad));
  for (int ring = ring_begin; ring <= ring_end; ++ring) {
    for (int sector = from; sector <= to; ++sector) {
      const int wrapped = (sector + kSectors) % kSectors;
      if (flags[static_cast<std::size_t>(ring * kSectors + wrapped)] != 0) return true;
    }
  }
  return false;
}

void PseudoOccupancy::add(float z_m) {
  ++points;
  lowest_m = std::min(lowest_m, z_m);
  highest_m = std::max(highest_m, z_m);
}

float scan_ratio(const PseudoOccupancy& a, const PseudoOccupancy& b) {
  return std::min(a.height_m(), b.height_m()) / std::max(a.height_m(), b.height_m());
}

}  // namespace stillmap::mapping
