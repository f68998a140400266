#include "ground/concentric_zones.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace stillmap::mapping {
namespace {

struct Ring {
  int first_patch = 0;
  int sectors = 0;
};

constexpr std::array<Ring, ConcentricZones::kRingCount + 1> make_rings() {
  std::array<Ring, ConcentricZones::kRingCount + 1> rings{};
  std::size_t ring = 0;
  int patch = 0;
  for (std::size_t zone = 0; zone < ConcentricZones::kZones; ++zone) {
    for (int k = 0; k < ConcentricZones::kRings[zone]; ++k) {
      rings[ring++] = {patch, ConcentricZones::kSectors[zone]};
      patch += ConcentricZones::kSectors[zone];
    }
  }
  rings[ring] = {patch, 0};
  return rings;
}

constexpr auto kAllRings = make_rings();
static_assert(kAllRings.back().first_patch == ConcentricZones::kPatchCount);

}  // namespace

int ConcentricZones::patch_of(double x, double y) {
  const double range_m = std::hypot(x, y);
  if (!(range_m >= kMinRangeM && range_m < kMaxRangeM)) return -1;
  std::size_t zone = 0;
  int ring = 0;
  while (range_m >= kBoundsM[zone + 1]) ring += kRings[zone++];
  const double share = (range_m - kBoundsM[zone]) / (kBoundsM[zone + 1] - kBoundsM[zone]);
  ring += std::min(static_cast<int>(share * kRings[zone]), kRings[zone] - 1);
  const double turn = std::atan2(y, x) / (2.0 * std::numbers::pi);
  const int sectors = kSectors[zone];
  const int sector =
      std::min(static_cast<int>((turn < 0.0 ? turn + 1.0 : turn) * sectors), sectors - 1);
  return kAllRings[static_cast<std::size_t>(ring)].first_patch + sector;
}

int ConcentricZones::ring_of(int patch) {
  int ring = 0;
  while (patch >= kAllRings[static_cast<std::size_t>(ring) + 1].first_patch) ++ring;
  return ring;
}

}  // namespace stillmap::mapping
