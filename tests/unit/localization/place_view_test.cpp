#include "index/place_view.hpp"

#include <gtest/gtest.h>

#include <stillmap/maps/crc32c.hpp>
#include <support/synthetic_world.hpp>

#include <bit>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <span>
#include <vector>

namespace stillmap::localization {
namespace place_view_test {

PlaceView some_view(test::Random& random) {
  PlaceView view;
  for (std::uint64_t& sector : view.sectors) {
    for (int bit = 0; bit < 64; ++bit)
      if (random.uniform() < 0.3) sector |= std::uint64_t{1} << bit;
  }
  return view;
}

TEST(PlaceView, HitsAreBitsThatAgreeInEveryHeading) {
  test::Random random(4);
  const PlaceView turned = some_view(random), fixed = some_view(random);
  ViewHits hits;
  count_view_hits(turned, fixed, hits);
  for (std::size_t heading = 0; heading < PlaceView::kSectors; ++heading) {
    int expected = 0;
    for (std::size_t i = 0; i < PlaceView::kSectors; ++i) {
      expected +=
          std::popcount(turned.sectors[i] & fixed.sectors[(heading + i) % PlaceView::kSectors]);
    }
    EXPECT_EQ(hits[heading], static_cast<std::uint32_t>(expected)) << heading;
  }
}

TEST(PlaceView, AllBitsAgreeWithAFullView) {
  PlaceView full;
  full.sectors.fill(~std::uint64_t{0});
  ViewHits hits;
  count_view_hits(full, full, hits);
  EXPECT_EQ(full.count(), 64 * 40);
  for (const std::uint32_t of_heading : hits) EXPECT_EQ(of_heading, 64U * 40U);
}

TEST(PlaceView, BelowTheLidarAndFarAboveItIsNothing) {
  EXPECT_FALSE(PlaceView::bit_of(0, -0.01F));
  EXPECT_FALSE(PlaceView::bit_of(15, 6.0F));
  EXPECT_FALSE(PlaceView::bit_of(3, std::nanf("")));
  EXPECT_EQ(PlaceView::bit_of(0, 0.0F), std::uint64_t{1});
  EXPECT_EQ(PlaceView::bit_of(15, 5.99F), std::uint64_t{1} << 63);
}

/// A column of voxels from the ground up to 4 m at a place, and ground all around it.
std::vector<Voxel> pole_at(float x_m, float y_m) {
  std::vector<Voxel> voxels;
  const auto add = [&](float x, float y, float z) {
    voxels.emplace_back();
    voxels.back().mean = Eigen::Vector3f(x, y, z);
  };
  for (float x = 0.5F; x < 300.0F; ++x)
    for (float y = 0.5F; y < 300.0F; ++y) add(x, y, 0.5F);
  for (float z = 0.5F; z < 4.0F; ++z) add(x_m, y_m, z);
  return voxels;
}

PlaceView view_at(const std::vector<Voxel>& voxels, const Eigen::Isometry3f& T) {
  CellBitsTable table(1.0F);
  for (const Voxel& voxel : voxels) table.add(voxel);
  const CellBits::Part part{.tiles = table.tiles(), .words = table.words(), .x = 1, .y = 1};
  return view_of_place(CellBits(1.0F, {&part, 1}), T);
}

TEST(PlaceView, HoldsWhatStandsInItsSectorAndRingAndNoGround) {
  Eigen::Isometry3f T = Eigen::Isometry3f::Identity();
  // The ground's metre ends at 1 m, and its bits reach a metre higher.
  T.translation() << 100.5F, 100.5F, 2.1F;
  // 15 m away in the first sector: 4.5 degrees.
  const PlaceView view = view_at(pole_at(115.5F, 101.7F), T);
  std::uint64_t pole = 0;
  for (const float up_m : {0.75F, 2.25F}) pole |= *PlaceView::bit_of(6, up_m);
  EXPECT_EQ(view.sectors[0] & pole, pole);
  for (std::size_t sector = 2; sector < 39; ++sector) EXPECT_EQ(view.sectors[sector], 0U) << sector;

  // The place's own x axis turned by ten sectors.
  T.rotate(Eigen::AngleAxisf(std::numbers::pi_v<float> / 2.0F, Eigen::Vector3f::UnitZ()));
  EXPECT_EQ(view_at(pole_at(115.5F, 101.7F), T).sectors[30] & pole, pole);
}

TEST(PlaceView, HoldsTheBitsOfTheIndexsFormatNumber) {
  // When this fails, files that users have would be read as something else: count
  // index_format::kFormat up.
  test::Random random(6);
  std::vector<Voxel> voxels(20'000);
  for (Voxel& voxel : voxels) {
    voxel.mean = Eigen::Vector3f(static_cast<float>(random.uniform(0.0, 200.0)),
                                 static_cast<float>(random.uniform(0.0, 200.0)),
                                 static_cast<float>(random.uniform(0.0, 9.0)));
  }
  Eigen::Isometry3f T = Eigen::Isometry3f::Identity();
  T.translation() << 100.3F, 99.1F, 1.7F;
  const PlaceView view = view_at(voxels, T);
  EXPECT_GT(view.count(), 500);
  EXPECT_LT(view.count(), 2000);
  EXPECT_EQ(maps::crc32c(std::as_bytes(std::span(view.sectors))), 1137732285U);
}

}  // namespace place_view_test
}  // namespace stillmap::localization
