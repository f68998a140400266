#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/localization/aligner.hpp>
#include <stillmap/mapping/map_import.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <bit>
#include <cstring>

#include "support/matchers.hpp"
#include "support/synthetic_world.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace {

namespace fs = std::filesystem;
using maps::InputError;
using test::IsNearPose;
using test::ThrowsSaying;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

template <typename Number>
std::string pcd_of(const std::vector<Eigen::Vector3d>& points) {
  std::string text = fmt::format(
      "VERSION 0.7\nFIELDS x y z\nSIZE {0} {0} {0}\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {1}\nHEIGHT 1\n"
      "POINTS {1}\nDATA binary\n",
      sizeof(Number), points.size());
  for (const Eigen::Vector3d& p : points) {
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      const auto bytes =
          std::bit_cast<std::array<char, sizeof(Number)>>(static_cast<Number>(p[axis]));
      text.append(bytes.data(), bytes.size());
    }
  }
  return text;
}

class MapImport : public ::testing::Test {
 protected:
  MapImportReport import(const std::string& file, const std::string& bytes,
                         const std::string& map = "map") {
    folder_.write(file, bytes);
    return import_map(folder_.path() / file, folder_.path() / map, options_, {}, cancel_);
  }
  [[nodiscard]] std::shared_ptr<const maps::MapPackage> map(const std::string& name = "map") const {
    return maps::MapPackage::open(folder_.path() / name);
  }
  static std::vector<Eigen::Vector3d> points_of_a_street(const Eigen::Vector3d& shift) {
    std::vector<Eigen::Isometry3d> seen_from;
    for (int x = 0; x <= 60; x += 4) seen_from.push_back(test::pose_at(x, 0.3));
    std::vector<Eigen::Vector3d> points = test::street(11, 80.0).mapped_from(
        seen_from, {.rings = 32, .columns = 500, .noise_m = 0.01, .seed = 3});
    for (Eigen::Vector3d& p : points) p += shift;
    return points;
  }

  test::TemporaryFolder folder_;
  MapImportOptions options_;
  CancelFlag cancel_{false};
};

TEST_F(MapImport, ScansAreFoundInItWithAndWithoutAPrior) {
  const Eigen::Vector3d utm(448000.0, 5427000.0, 110.0);
  const MapImportReport report = import("cloud.pcd", pcd_of<double>(points_of_a_street(utm)));
  EXPECT_THAT(report.warnings, IsEmpty());
  EXPECT_GT(report.counts.at("places"), 10U);
  EXPECT_GT(report.counts.at("ground"), report.counts.at("static") / 10);
  const auto aligner = localization::make_aligner("default", *map());
  const test::SyntheticWorld world = test::street(11, 80.0);
  Eigen::Isometry3d T_truth = test::pose_at(27.0, -0.6, 0.1);
  const maps::PointCloud scan = world.scan(T_truth, {.noise_m = 0.01, .seed = 77});
  T_truth.pretranslate(utm);
  Eigen::Isometry3d T_prior = T_truth;
  T_prior.pretranslate(Eigen::Vector3d(0.8, -0.5, 0.0));
  EXPECT_THAT(aligner->align(scan, localization::Prior{T_prior, {}}).T_map_lidar,
              IsNearPose(T_truth, 0.05, 0.005));
  EXPECT_THAT(aligner->align(scan, std::nullopt).T_map_lidar, IsNearPose(T_truth, 0.05, 0.005));
}

TEST_F(MapImport, PackageSaysWhatItIsMadeOf) {
  options_.frame_id = "utm-32n";
  const std::vector<Eigen::Vector3d> points{
      {10.26, 20.0, 1.0}, {10.28, 20.0, 1.0}, {14.0, 20.0, 1.0}};
  const MapImportReport report = import("cloud.pcd", pcd_of<double>(points));
  EXPECT_EQ(report.counts.at("in"), 3U);
  EXPECT_EQ(report.counts.at("static"), 2U) << "two of them share a voxel of 0.1 m";
  const auto package = map();
  EXPECT_EQ(package->digest(), report.digest);
  EXPECT_EQ(package->manifest().frame_id, "utm-32n");
  EXPECT_EQ(package->manifest().origin, Eigen::Vector3d(12.0, 20.0, 1.0));
  EXPECT_EQ(package->manifest().sources.at("cloud"), "cloud.pcd");
  EXPECT_THAT(package->trajectories(), IsEmpty());
  EXPECT_THAT(package->verify(), IsEmpty());
  EXPECT_THAT(report.warnings, ::testing::Contains(HasSubstr("no free ground")));
}

TEST_F(MapImport, CoarseCoordinatesAreRefusedOrSaid) {
  const Eigen::Vector3d p(448000.3, 1.0, 1.0);
  EXPECT_THAT([&] { (void)import("utm.pcd", pcd_of<float>({p})); },
              ThrowsSaying<InputError>({"utm.pcd", "448000 m", "32-bit", "doubles"}));
  EXPECT_FALSE(fs::exists(folder_.path() / "map"));
  EXPECT_NO_THROW((void)import("double.pcd", pcd_of<double>({p}), "double"));
  const MapImportReport near = import("near.pcd", pcd_of<float>({0.1 * p}), "near");
  EXPECT_THAT(near.warnings, ::testing::Contains(HasSubstr("coarse")));
}

TEST_F(MapImport, FilesWithoutAPointAreRefusedInWords) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(
      [&] {
        (void)import("nan.pcd", pcd_of<double>({{nan, 1.0, 2.0}}));
      },
      ThrowsSaying<InputError>({"nan.pcd", "finite"}));
  EXPECT_THAT([&] { (void)import("empty.pcd", pcd_of<double>({})); },
              ThrowsSaying<InputError>({"empty.pcd", "no point"}));
  EXPECT_THAT([&] { (void)import("cloud.las", "LASF"); },
              ThrowsSaying<InputError>({"cloud.las", ".pcd or .ply"}));
}

TEST_F(MapImport, OptionsOutOfBoundsAreRefused) {
  options_.frame_id = "";
  EXPECT_THAT(
      [&] {
        (void)import("cloud.pcd", pcd_of<double>({{1.0, 1.0, 2.0}}));
      },
      ThrowsSaying<std::invalid_argument>({"frame_id"}));
  options_.frame_id = "local";
  options_.voxel_size_m = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(
      [&] {
        (void)import("cloud.pcd", pcd_of<double>({{1.0, 1.0, 2.0}}));
      },
      ThrowsSaying<std::invalid_argument>({"voxel_size_m"}));
}

TEST_F(MapImport, SameBytesForAnyNumberOfThreads) {
  const std::string cloud = pcd_of<float>(points_of_a_street({0.0, 0.0, 0.0}));
  options_.threads = 1;
  const std::string digest = import("cloud.pcd", cloud, "alone").digest;
  options_.threads = 3;
  EXPECT_EQ(import("cloud.pcd", cloud, "many").digest, digest);
}

}  // namespace
}  // namespace stillmap::mapping
