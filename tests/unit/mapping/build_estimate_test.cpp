#include <stillmap/mapping/build_estimate.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "small_drive.hpp"

namespace stillmap::mapping {
namespace build_estimate_test {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(BuildEstimate, CountsScansAndPointsOfAllDrives) {
  const test::TemporaryFolder folder;
  const test::SmallDrive small;
  const std::filesystem::path drive = small.write(folder);
  const BuildEstimate estimate = estimate_build(std::vector{drive, drive}, {});
  EXPECT_EQ(estimate.drives, 2U);
  EXPECT_EQ(estimate.scans, 2 * test::SmallDrive::kScans);
  const std::uint64_t points = small.scan(0).size();
  EXPECT_NEAR(static_cast<double>(estimate.points),
              static_cast<double>(2 * test::SmallDrive::kScans * points),
              0.2 * static_cast<double>(8 * points));
  MapBuildOptions half;
  half.selection = maps::Selection::parse("::2");
  EXPECT_EQ(estimate_build(std::vector{drive}, half).scans, test::SmallDrive::kScans / 2);
}

TEST(BuildEstimate, GrowsWithTheScansAndFallsWithTheVoxel) {
  const BuildEstimate one = estimate_build(1'000, 100'000'000, 0.1);
  const BuildEstimate two = estimate_build(2'000, 200'000'000, 0.1);
  EXPECT_GT(two.memory_bytes, one.memory_bytes);
  EXPECT_EQ(two.package_bytes, 2 * one.package_bytes);
  EXPECT_EQ(two.work_bytes, 2 * one.work_bytes);
  EXPECT_LT(estimate_build(1'000, 100'000'000, 0.4).package_bytes, one.package_bytes);
  EXPECT_THROW((void)estimate_build(1, 1, 0.0), std::invalid_argument);
}

TEST(BuildEstimate, SaysWhatTheMachineLacks) {
  const BuildEstimate estimate{.drives = 3,
                               .scans = 40,
                               .points = 1,
                               .memory_bytes = 8'000'000'000,
                               .package_bytes = 1'000'000'000,
                               .work_bytes = 2'000'000'000};
  EXPECT_THAT(shortages_of(estimate, 8'000'000'000, 3'000'000'000), IsEmpty());
  EXPECT_THAT(shortages_of(estimate, 7'900'000'000, 3'000'000'000),
              ElementsAre(AllOf(HasSubstr("3 drives with 40 scans"), HasSubstr("8.0 GB of memory"),
                                HasSubstr("7.9 GB"), HasSubstr("--select"))));
  EXPECT_THAT(shortages_of(estimate, 9'000'000'000, 2'900'000'000),
              ElementsAre(AllOf(HasSubstr("3.0 GB of the disk"), HasSubstr("2.9 GB are free"))));
}

}  // namespace build_estimate_test
}  // namespace stillmap::mapping
