#include <stillmap/maps/pose_disagreement.hpp>

#include <stillmap/maps/error.hpp>

#include <gmock/gmock.h>

#include <fstream>
#include <limits>
#include <optional>
#include <string>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace pose_disagreement_test {

using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using ::testing::IsEmpty;

class PoseDisagreementTest : public ::testing::Test {
 protected:
  /// A package of three poses. @param text  of its file.
  std::shared_ptr<const MapPackage> package(const std::optional<std::string>& text) {
    const std::filesystem::path target = folder_.path() / ("map" + std::to_string(count_++));
    MapPackageWriter writer(target);
    writer.add_tile({}, std::vector<MapPoint>(1));
    std::vector<StampedPose> poses(3);
    for (std::size_t i = 0; i < poses.size(); ++i) poses[i].stamp_ns = static_cast<std::int64_t>(i);
    writer.write_trajectory(Trajectory(poses));
    if (text) std::ofstream(writer.folder() / "disagreement.txt") << *text;
    MapManifest manifest;
    manifest.frame_id = "map";
    writer.publish(manifest, "{}");
    return MapPackage::open(target);
  }

  TemporaryFolder folder_;
  int count_ = 0;
};

TEST_F(PoseDisagreementTest, ComesBackAsItWasWritten) {
  const std::vector<PoseDisagreement> told{{0.0F, 0.0F}, {0.3F, 0.002F}, {12.5F, 3.0F}};
  write_pose_disagreements(folder_.path(), told);
  std::ifstream file(folder_.path() / "disagreement.txt");
  const auto found =
      read_pose_disagreements(*package(std::string{std::istreambuf_iterator<char>(file), {}}));
  ASSERT_EQ(found.size(), told.size());
  for (std::size_t i = 0; i < told.size(); ++i) {
    EXPECT_FLOAT_EQ(found[i].m, told[i].m);
    EXPECT_FLOAT_EQ(found[i].rad, told[i].rad);
  }
}

TEST_F(PoseDisagreementTest, BentPlacesAreThoseBeyondSixCentimetres) {
  const std::vector<PoseDisagreement> told{{0.05F, 0.1F}, {0.3F, 0.0F}, {0.07F, 0.0F}};
  const BentPlaces bent = bent_places(told);
  EXPECT_EQ(bent.poses, 2U);
  EXPECT_EQ(bent.worst, 1U);
  EXPECT_FLOAT_EQ(bent.worst_m, 0.3F);
  EXPECT_EQ(bent_places({}).poses, 0U);
}

TEST_F(PoseDisagreementTest, IsNothingWhereThePackageSaysNothing) {
  EXPECT_THAT(read_pose_disagreements(*package({})), IsEmpty());
}

TEST_F(PoseDisagreementTest, BrokenOnesAreRefusedByFileAndLine) {
  const auto refused = [&](const std::string& text, const std::vector<std::string>& says) {
    const auto map = package(text);
    EXPECT_THAT([&] { (void)read_pose_disagreements(*map); }, ThrowsSaying<InputError>(says))
        << text;
  };
  refused("0 0\n0 0\n", {"disagreement.txt", "2 lines", "3 poses"});
  refused("0 0\n0 0\n0 0\n0 0\n", {"disagreement.txt", "4 lines"});
  refused("0 0\n-1 0\n0 0\n", {"line 2", "-1 0"});
  refused("0 0\n0\n0 0\n", {"line 2"});
  refused("0 0\n0 0 0\n0 0\n", {"line 2"});
  refused("0 0\nnan 0\n0 0\n", {"line 2"});
  refused("0 0\n1e30 1e39\n0 0\n", {"line 2"});
}

}  // namespace pose_disagreement_test
}  // namespace stillmap::maps
