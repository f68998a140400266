#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fstream>

#include "small_drive.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace build_resume_test {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// Builds that end as by SIGKILL: what lies on the disk at that moment is copied, and put back when
/// the build has cleaned up behind itself.
class BuildResume : public ::testing::Test {
 protected:
  BuildResume() : drive_(small_.write(folder_)) {
    options_.threads = 1;
    options_.detector = "geometric";
    fs::create_directories(maps_);
  }

  MapBuildResult build(const std::string& name = "map", const ProgressCallback& progress = {}) {
    cancel_ = false;
    return build_map({drive_}, maps_ / name, options_, progress, cancel_);
  }
  void kill_build_after(const std::string& stage, std::size_t units) {
    const fs::path partial = maps_ / ".map.partial";
    const fs::path copy = folder_.path() / "copy";
    fs::remove_all(copy);
    const ProgressCallback progress = [&](std::string_view now, std::size_t done, std::size_t) {
      if (now != stage || done != units || cancel_) return;
      fs::copy(partial, copy, fs::copy_options::recursive);
      cancel_ = true;
    };
    EXPECT_THROW((void)build("map", progress), Cancelled) << stage << units;
    fs::remove_all(partial);
    fs::rename(copy, partial);
  }
  void remove_map() { fs::remove_all(maps_ / "map"); }
  [[nodiscard]] fs::path journal() const { return maps_ / ".map.partial/journal/survey.journal"; }

  test::TemporaryFolder folder_;
  test::SmallDrive small_;
  fs::path drive_;
  fs::path maps_ = folder_.path() / "maps";
  MapBuildOptions options_;
  CancelFlag cancel_{false};
};

TEST_F(BuildResume, GoesOnToTheSameBytesFromWhereverItWasKilled) {
  const std::string whole = build("whole").digest;
  for (std::size_t scans = 1; scans <= test::SmallDrive::kScans; ++scans) {
    options_.threads = scans % 2 == 0 ? 2 : 1;
    kill_build_after("survey", scans);
    const MapBuildResult report = build();
    EXPECT_EQ(report.digest, whole) << scans;
    EXPECT_EQ(report.resumed_scans, scans);
    EXPECT_THAT(report.warnings, IsEmpty());
    EXPECT_THAT(maps::MapPackage::open(maps_ / "map")->verify(), IsEmpty());
    EXPECT_FALSE(fs::exists(maps_ / "map/journal"));
    remove_map();
  }
}

TEST_F(BuildResume, KeepsThePassThatWasDoneWhenItIsKilledLater) {
  const std::string whole = build("whole").digest;
  kill_build_after("place", 2);
  const MapBuildResult report = build();
  EXPECT_EQ(report.digest, whole);
  EXPECT_EQ(report.resumed_scans, test::SmallDrive::kScans);
}

TEST_F(BuildResume, GoesOnAfterSeveralKillsWithOtherThreads) {
  const std::string whole = build("whole").digest;
  kill_build_after("survey", 1);
  options_.threads = 2;
  kill_build_after("survey", 1);
  kill_build_after("resume", 2);
  const MapBuildResult report = build();
  EXPECT_EQ(report.digest, whole);
  EXPECT_EQ(report.resumed_scans, 2U);
}

TEST_F(BuildResume, TellsWhatItTakesOverApartFromWhatItDoes) {
  kill_build_after("survey", 3);
  std::vector<std::string> told;
  (void)build("map", [&](std::string_view stage, std::size_t done, std::size_t total) {
    if (stage == "resume" || stage == "survey")
      told.push_back(fmt::format("{} {}/{}", stage, done, total));
  });
  EXPECT_THAT(told, ElementsAre("resume 1/3", "resume 2/3", "resume 3/3", "survey 1/1"));
}

TEST_F(BuildResume, CutsATornRecord) {
  const std::string whole = build("whole").digest;
  kill_build_after("survey", 2);
  fs::resize_file(journal(), fs::file_size(journal()) - 5);
  const MapBuildResult report = build();
  EXPECT_EQ(report.resumed_scans, 1U);
  EXPECT_EQ(report.digest, whole);
}

TEST_F(BuildResume, DoesNotUseADamagedRecordNorThoseBehindIt) {
  const std::string whole = build("whole").digest;
  for (const int threads : {1, 2}) {
    options_.threads = threads;
    kill_build_after("survey", 3);
    {
      std::fstream file(journal(), std::ios::binary | std::ios::in | std::ios::out);
      file.seekp(static_cast<std::streamoff>(fs::file_size(journal()) / 2));
      file.write("????", 4);
    }
    const MapBuildResult report = build();
    EXPECT_EQ(report.resumed_scans, 1U);
    EXPECT_EQ(report.digest, whole);
    remove_map();
  }
}

TEST_F(BuildResume, ThrowsAwayTheWorkOfOtherOptionsAndSaysSo) {
  options_.voxel_size_m = 0.2;
  const std::string whole = build("whole").digest;
  options_.voxel_size_m = 0.1;
  kill_build_after("survey", 2);
  options_.voxel_size_m = 0.2;
  const MapBuildResult report = build();
  EXPECT_EQ(report.digest, whole);
  EXPECT_EQ(report.resumed_scans, 0U);
  EXPECT_THAT(report.warnings,
              ElementsAre(HasSubstr("found 'voxel_size_m: 0.1', expected 'voxel_size_m: 0.2'")));
}

TEST_F(BuildResume, ThrowsAllAwayWhenAScanHasChanged) {
  // The ground learns from ten scans of the twelve, not from the sixth.
  std::string poses;
  for (std::size_t i = 0; i < 12; ++i) {
    folder_.write(fmt::format("drive/{:06}.bin", i), test::bin_of(small_.scan(i % 4)));
    poses += test::kitti_line(small_.T_map_lidar[i % 4]);
  }
  folder_.write("drive/poses.txt", poses);
  kill_build_after("survey", 8);
  small_.world.boxes[0].max.z() = 1.9;
  folder_.write("drive/000005.bin", test::bin_of(small_.scan(1)));
  const MapBuildResult report = build();
  EXPECT_EQ(report.resumed_scans, 0U);
  EXPECT_THAT(report.warnings, ElementsAre(HasSubstr("files of drive 1")));
  EXPECT_EQ(report.digest, build("whole").digest);
}

TEST_F(BuildResume, ThrowsAllAwayWhenAScanAheadHasChangedThatTheGroundLearnedFrom) {
  kill_build_after("survey", 1);
  folder_.write("drive/000003.bin", test::bin_of(small_.scan(2)));
  const MapBuildResult report = build();
  EXPECT_EQ(report.resumed_scans, 0U);
  EXPECT_EQ(report.digest, build("whole").digest);
}

TEST_F(BuildResume, ThrowsAllAwayWhenAPoseHasChanged) {
  kill_build_after("survey", 2);
  small_.T_map_lidar[3].translation().y() += 0.01;
  std::string poses;
  for (const Eigen::Isometry3d& T : small_.T_map_lidar) poses += test::kitti_line(T);
  folder_.write("drive/poses.txt", poses);
  const MapBuildResult report = build();
  EXPECT_EQ(report.resumed_scans, 0U);
  EXPECT_THAT(report.warnings, ElementsAre(HasSubstr("poses of drive 1")));
  EXPECT_EQ(report.digest, build("whole").digest);
}

TEST_F(BuildResume, GoesOnWhereItWasCancelled) {
  const std::string whole = build("whole").digest;
  for (const std::string at : {"survey", "fuse", "place", "tiles", "publish"}) {
    const ProgressCallback cancelling = [&](std::string_view stage, std::size_t, std::size_t) {
      if (stage == at) cancel_ = true;
    };
    if (at == "publish") {
      // Too late: the map is written.
      EXPECT_EQ(build("map", cancelling).digest, whole);
      continue;
    }
    EXPECT_THROW((void)build("map", cancelling), Cancelled) << at;
    EXPECT_FALSE(fs::exists(maps_ / ".map.partial/scratch")) << at;
    EXPECT_TRUE(fs::exists(journal())) << at;
  }
  EXPECT_EQ(build("again", {}).digest, whole);
}

TEST_F(BuildResume, GoesOnWhereItRanOutOfMemory) {
  const ProgressCallback exhausting = [&](std::string_view stage, std::size_t, std::size_t) {
    if (stage == "place") throw std::bad_alloc();
  };
  EXPECT_THROW((void)build("map", exhausting), std::bad_alloc);
  EXPECT_EQ(build().resumed_scans, test::SmallDrive::kScans);
}

TEST_F(BuildResume, SharesTheSurveyWithABuildThatKeepsWhatCanMove) {
  const std::string whole = build("whole").digest;
  options_.journal_folder = folder_.path() / "journal";
  options_.detect_always = true;
  EXPECT_EQ(build("journaled").digest, whole);
  options_.projection.policy = MovablePolicy::kKeep;
  options_.fusion = false;
  options_.clean = "none";
  const MapBuildResult kept = build("kept");
  EXPECT_EQ(kept.resumed_scans, test::SmallDrive::kScans);
  EXPECT_EQ(kept.points.at("projected"), 0U);
  EXPECT_EQ(kept.points.at("cleaned"), 0U);
  EXPECT_TRUE(fs::exists(folder_.path() / "journal/survey.journal"));
}

TEST_F(BuildResume, LeavesNothingBehindWhenTheResumedBuildFails) {
  kill_build_after("survey", 2);
  folder_.write("drive/000002.bin", "torn");
  EXPECT_THROW((void)build(), maps::InputError);
  EXPECT_TRUE(fs::is_empty(maps_));
}

}  // namespace build_resume_test
}  // namespace stillmap::mapping
