#include "index/place_view.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

// Compiled once for each instruction set; the best one is chosen when the program runs.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "index/place_view.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace stillmap::localization::HWY_NAMESPACE {

/// See `count_view_hits`. @param twice  all sectors, and all of them again.
void count_hits_of_headings(const std::uint64_t* turned, const std::uint64_t* twice,
                            std::uint32_t* hits) {
  namespace hn = hwy::HWY_NAMESPACE;
  // A view is a whole number of these, and a byte takes the sum of 31 of them.
  const hn::CappedTag<std::uint8_t, 64> bytes;
  const hn::Repartition<std::uint64_t, decltype(bytes)> words;
  const std::size_t lanes = hn::Lanes(words);
  for (std::size_t heading = 0; heading < PlaceView::kSectors; ++heading) {
    auto sum = hn::Zero(bytes);
    for (std::size_t i = 0; i < PlaceView::kSectors; i += lanes) {
      const auto both =
          hn::And(hn::LoadU(words, turned + i), hn::LoadU(words, twice + heading + i));
      sum = hn::Add(sum, hn::PopulationCount(hn::BitCast(bytes, both)));
    }
    hits[heading] =
        static_cast<std::uint32_t>(hn::GetLane(hn::SumOfLanes(words, hn::SumsOf8(sum))));
  }
}

}  // namespace stillmap::localization::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stillmap::localization {
namespace {

/// Columns of the map that a bit looks at lie no farther apart [m].
constexpr float kSampleM = 2.0F;

struct Sample {
  std::size_t sector = 0, ring = 0;
  float x_m = 0.0F, y_m = 0.0F;
};

std::vector<Sample> all_samples() {
  std::vector<Sample> samples;
  for (std::size_t sector = 0; sector < PlaceView::kSectors; ++sector) {
    for (std::size_t ring = 0; ring < PlaceView::kRings; ++ring) {
      const float near_m = PlaceView::kRingEdgesM[ring];
      const float wide_m = PlaceView::kRingEdgesM[ring + 1] - near_m;
      const int out = static_cast<int>(std::ceil(wide_m / kSampleM));
      const int across =
          static_cast<int>(std::ceil((near_m + wide_m) * PlaceView::kSectorRad / kSampleM));
      for (int i = 0; i < out * across; ++i) {
        const auto part = [](int at, int of) {
          return (static_cast<float>(at) + 0.5F) / static_cast<float>(of);
        };
        // In doubles, so that the last bit of a float does not depend on the library.
        const auto r = static_cast<double>(near_m + wide_m * part(i / across, out));
        const double azimuth_rad =
            static_cast<double>(PlaceView::kSectorRad) *
            (static_cast<double>(sector) + static_cast<double>(part(i % across, across)));
        samples.push_back({sector, ring, static_cast<float>(r * std::cos(azimuth_rad)),
                           static_cast<float>(r * std::sin(azimuth_rad))});
      }
    }
  }
  return samples;
}

}  // namespace

PlaceView view_of_place(const CellBits& cells, const Eigen::Isometry3f& T_cells_place) {
  static const std::vector<Sample> samples = all_samples();
  PlaceView view;
  for (const Sample& sample : samples) {
    const Eigen::Vector3f at = T_cells_place * Eigen::Vector3f(sample.x_m, sample.y_m, 0.0F);
    const std::uint64_t column = cells.column(at.x(), at.y());
    if (column == 0) continue;
    for (std::size_t height = 0; height < PlaceView::kHeights; ++height) {
      const float up_m = PlaceView::kHeightM * (static_cast<float>(height) + 0.5F);
      if ((column >> (CellBits::height_bit(at.z() + up_m) % 64U) & 1U) == 0) continue;
      view.sectors[sample.sector] |= *PlaceView::bit_of(sample.ring, up_m);
    }
  }
  return view;
}

HWY_EXPORT(count_hits_of_headings);

void count_view_hits(const PlaceView& turned, const PlaceView& fixed, ViewHits& hits) {
  std::array<std::uint64_t, 2 * PlaceView::kSectors> twice;
  std::copy(fixed.sectors.begin(), fixed.sectors.end(), twice.begin());
  std::copy(fixed.sectors.begin(), fixed.sectors.end(), twice.begin() + PlaceView::kSectors);
  HWY_DYNAMIC_DISPATCH(count_hits_of_headings)(turned.sectors.data(), twice.data(), hits.data());
}

}  // namespace stillmap::localization
#endif  // HWY_ONCE
