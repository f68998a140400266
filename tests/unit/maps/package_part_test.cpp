#include <stillmap/maps/package_part.hpp>

#include <gmock/gmock.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/package_files.hpp>

#include <fstream>
#include <memory>

#include "support/temporary_folder.hpp"

namespace stillmap::maps {
namespace package_part_test {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

/// A map of three regions in a row, two tiles in each.
class PackagePartTest : public ::testing::Test {
 protected:
  PackagePartTest() {
    MapPackageWriter writer(whole_);
    for (const std::int32_t x : {0, 1, 32, 33, 64, 65})
      writer.add_tile({.level = 0, .x = x, .y = 0},
                      std::vector<MapPoint>{{static_cast<float>(20.0 * x + 5.0), 3.0F, 1.0F, 0.5F,
                                             1, PointKind::kMeasured, 0}});
    writer.write_trajectory(Trajectory(std::vector<StampedPose>{{.stamp_ns = 1}}));
    MapManifest manifest;
    manifest.frame_id = "map";
    manifest.origin = Eigen::Vector3d(1000.0, -2000.0, 0.0);
    manifest.voxel_size_m = 0.1;
    manifest.software_version = "0";
    digest_ = writer.publish(manifest, "{}");
  }

  [[nodiscard]] MapManifest whole() const { return MapPackage::open(whole_)->manifest(); }
  /// Puts the files of a part alone into a folder.
  [[nodiscard]] std::shared_ptr<const MapPackage> part(const std::set<RegionId>& regions) const {
    const fs::path folder = folder_.path() / "part";
    const auto copy = [&](const auto& files) {
      for (const auto& [path, file] : files) {
        fs::create_directories((folder / path).parent_path());
        fs::copy_file(whole_ / path, folder / path, fs::copy_options::overwrite_existing);
      }
    };
    copy(files_but_packs(whole(), regions));
    const MapManifest manifest = manifest_of_part(whole(), {digest_, regions}, folder);
    copy(manifest.files);
    std::ofstream(folder / kManifestName) << manifest_text(manifest);
    return MapPackage::open(folder);
  }

  test::TemporaryFolder folder_;
  fs::path whole_ = folder_.path() / "whole";
  std::string digest_;
};

TEST_F(PackagePartTest, IsAPackageOfItsRegions) {
  const auto package = part({{0, 0}, {2, 0}});
  EXPECT_THAT(package->verify(), IsEmpty());
  EXPECT_THAT(package->regions(), ElementsAre(RegionId{0, 0}, RegionId{2, 0}));
  EXPECT_EQ(package->tiles().size(), 4U);
  EXPECT_EQ(package->manifest().extent.points, 4U);
  EXPECT_TRUE(package->has_tile({0, 65, 0}));
  EXPECT_FALSE(package->has_tile({0, 32, 0}));
  EXPECT_EQ(package->tile({0, 65, 0}).size(), 1U);
  EXPECT_EQ(package->trajectories().size(), 1U);
  EXPECT_NE(package->digest(), digest_);
  EXPECT_EQ(part_in(package->manifest()), (PackagePart{digest_, {{0, 0}, {2, 0}}}));
  EXPECT_EQ(part_in(whole()), std::nullopt);
}

TEST_F(PackagePartTest, IsTheSameWheneverItIsMade) {
  const std::string first = part({{1, 0}})->digest();
  fs::remove_all(folder_.path() / "part");
  EXPECT_EQ(part({{1, 0}})->digest(), first);
}

TEST_F(PackagePartTest, HasTheRegionsThatACircleReaches) {
  const auto around = [&](double x, double y, double radius_m) {
    return regions_around(whole(), {1000.0 + x, -2000.0 + y}, radius_m);
  };
  EXPECT_THAT(around(320, 320, 10), ElementsAre(RegionId{0, 0}));
  EXPECT_THAT(around(635, 320, 10), ElementsAre(RegionId{0, 0}, RegionId{1, 0}));
  EXPECT_THAT(around(960, -100, 99), IsEmpty());
  EXPECT_THAT(around(960, -100, 101), ElementsAre(RegionId{1, 0}));
  EXPECT_EQ(around(960, 0, 5000).size(), 3U);
}

}  // namespace package_part_test
}  // namespace stillmap::maps
