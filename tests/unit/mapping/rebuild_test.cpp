#include <stillmap/mapping/rebuild.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <sys/resource.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "rebuild/rebuild_work.hpp"
#include "small_drive.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace rebuild_test {

namespace fs = std::filesystem;
using test::ThrowsSaying;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

/// A drive of 2.5 s and 15 m past a car, between walls.
class RebuildTest : public ::testing::Test {
 protected:
  static constexpr std::size_t kScans = 26;

  RebuildTest() {
    // Buttresses: what tells places along the walls apart, and no detector takes for a vehicle.
    double x_m = -14.0;
    for (int i = 0; i < 9; ++i) {
      small_.world.boxes.push_back({{x_m, 6.2, 0.0}, {x_m + 0.8, 8.0, 5.0}});
      small_.world.boxes.push_back({{x_m + 1.7, -8.0, 0.0}, {x_m + 2.6, -6.0, 5.0}});
      x_m += 3.5 + 0.6 * (i % 3);
    }
    small_.pattern.columns = 300;
    drive_ = write_drive("drive", 0.0);
    options_.drives = {drive_};
    options_.map = folder_.path() / "new";
    options_.work = folder_.path() / "work";
    options_.build.threads = 1;
    options_.build.detector = "geometric";
    options_.build.voxel_size_m = 0.2;
    options_.held_back_every = 6;
    options_.limits.least_queries = 1;
  }

  /// @param pose_sigma_m  how far off the written poses are, from scan to scan.
  /// @param late_scans    each pose is written for the scan so many before its own.
  fs::path write_drive(const std::string& name, double y_m, double pose_sigma_m = 0.0,
                       int late_scans = 0) const {
    test::Random random(1);
    std::string poses;
    for (std::size_t i = 0; i < kScans; ++i) {
      Eigen::Isometry3d T = test::pose_at(0.6 * static_cast<double>(i), y_m, 0.0);
      folder_.write(fmt::format("{}/{:06}.bin", name, i),
                    test::bin_of(small_.world.scan(T, small_.pattern)));
      T.translation().x() += 0.6 * late_scans;
      T.translation() +=
          pose_sigma_m * Eigen::Vector3d(random.normal(), random.normal(), random.normal());
      poses += test::kitti_line(T);
    }
    folder_.write(name + "/poses.txt", poses);
    return folder_.path() / name;
  }

  RebuildResult rebuild(const ProgressCallback& progress = {}) {
    cancel_ = false;
    return rebuild_map(options_, progress, cancel_);
  }
  /// Cancels at the first sign of a stage.
  void cancel_at(const std::string& at) {
    const ProgressCallback cancelling = [&](std::string_view stage, std::size_t, std::size_t) {
      if (stage == at) cancel_ = true;
    };
    EXPECT_THROW((void)rebuild(cancelling), Cancelled) << at;
    EXPECT_FALSE(fs::exists(options_.map)) << at;
  }
  /// What must not depend on where a rebuild was interrupted.
  [[nodiscard]] std::string result(const RebuildResult& report) const {
    auto json = nlohmann::json::parse(to_json(report, options_));
    for (const char* key : {"stage_seconds", "resumed_stages", "peak_rss_mib", "work_bytes"})
      EXPECT_EQ(json.erase(key), 1U) << key;
    return json.dump();
  }

  test::TemporaryFolder folder_;
  test::SmallDrive small_;
  fs::path drive_;
  RebuildOptions options_;
  CancelFlag cancel_{false};
};

TEST_F(RebuildTest, MakesAMapAndJudgesIt) {
  const RebuildResult report = rebuild();
  EXPECT_EQ(maps::MapPackage::open(options_.map)->digest(), report.digest);
  EXPECT_THAT(maps::MapPackage::open(options_.map)->verify(), IsEmpty());
  EXPECT_EQ(report.answers.queries, 4U);
  EXPECT_EQ(report.answers.found, 4U);
  EXPECT_EQ(report.answers.status.size(), 4U);
  EXPECT_NE(report.keep_digest, report.digest);
  EXPECT_GT(report.static_points, 1000U);
  EXPECT_LT(report.figures.static_loss, 0.02);
  EXPECT_TRUE(report.verdict.passed) << to_json(report, options_);
  EXPECT_FALSE(report.figures.previous);
  EXPECT_THAT(report.warnings, ElementsAre(HasSubstr("judged by scans of the drives")));
}

TEST_F(RebuildTest, GoesOnFromEveryStageToTheSameResult) {
  const std::string whole = result(rebuild());
  fs::remove_all(options_.map);
  fs::remove_all(options_.work);
  for (const std::string at :
       {"map: survey", "map: place", "map: tiles", "keep: place", "keep: tiles",
        "localize map: localize", "localize keep: localize", "compare keep: compare"})
    cancel_at(at);
  const RebuildResult report = rebuild();
  EXPECT_EQ(result(report), whole);
  EXPECT_THAT(report.resumed_stages, ElementsAre("map", "keep", "localize map", "localize keep"));
}

TEST_F(RebuildTest, DoesTheFirstPassOnceForBothMaps) {
  std::set<std::string> stages;
  (void)rebuild([&](std::string_view stage, std::size_t, std::size_t) { stages.emplace(stage); });
  EXPECT_THAT(stages, Contains("map: survey"));
  EXPECT_THAT(stages, Contains("keep: resume"));
  EXPECT_FALSE(stages.contains("keep: survey"));
  for (const StageShare& each : rebuild_stages(options_)) stages.erase(each.stage);
  EXPECT_THAT(stages, IsEmpty()) << "stages that no plan knows";
}

TEST_F(RebuildTest, MakesTheSameMapsByUnits) {
  const std::string whole = result(rebuild());
  fs::remove_all(options_.map);
  fs::remove_all(options_.work);
  const PackageMaker by_units = [&](const std::string& part, const fs::path& target,
                                    const ProgressCallback& progress) {
    for (const auto& step : unit_steps(2))
      for (const BuildUnit& unit : step)
        (void)do_rebuild_unit(options_, part, unit, 2, progress, cancel_);
    EXPECT_TRUE(fs::exists(target)) << target;
  };
  std::set<std::string> stages;
  const RebuildResult report = rebuild_map(
      options_, [&](std::string_view stage, std::size_t, std::size_t) { stages.emplace(stage); },
      cancel_, {}, by_units);
  EXPECT_EQ(result(report), whole);
  // The first pass is done once for both maps.
  EXPECT_THAT(stages, Contains("map: survey"));
  EXPECT_FALSE(stages.contains("keep: survey"));
  EXPECT_THROW((void)do_rebuild_unit(options_, "other", {}, 2, {}, cancel_), std::invalid_argument);
}

TEST_F(RebuildTest, SaysTheSameAgainWhenItIsDone) {
  const std::string whole = result(rebuild());
  EXPECT_EQ(result(rebuild()), whole);
  fs::remove_all(options_.work);
  EXPECT_THAT([&] { (void)rebuild(); },
              ThrowsSaying<maps::InputError>({options_.map.string(), "existing"}));
}

TEST_F(RebuildTest, ComparesWithThePreviousVersion) {
  // So that cells of the ground lie on no border of others.
  options_.build.given_poses = GivenPosesUse::kExact;
  // The entropy of surfaces without thickness is that of rounding.
  small_.pattern.noise_m = 0.02;
  options_.drives = {write_drive("noisy", 0.0)};
  const RebuildResult first = rebuild();
  options_.previous = options_.map;
  options_.map = folder_.path() / "newer";
  const RebuildResult second = rebuild();
  EXPECT_EQ(second.previous_digest, first.digest);
  ASSERT_TRUE(second.figures.previous);
  EXPECT_EQ(second.figures.previous->driven_coverage, 1.0);
  EXPECT_EQ(second.figures.previous->ground_coverage, 1.0);
  EXPECT_EQ(second.figures.previous->new_lost, 0U);
  // Nothing but the registration is new.
  const MapConsistency& before = second.figures.previous->consistency_before;
  const MapConsistency& now = second.figures.previous->consistency_now;
  EXPECT_GT(now.walls.planar_cells, 50U);
  EXPECT_GT(now.entropy_points, 50U);
  EXPECT_NEAR(now.walls.median_m, before.walls.median_m, 0.001);
  EXPECT_NEAR(now.mean_map_entropy, before.mean_map_entropy, 0.05);
  EXPECT_TRUE(second.verdict.passed) << to_json(second, options_);
  EXPECT_THAT(second.warnings, Contains(HasSubstr("work of another rebuild was thrown away")));
}

TEST_F(RebuildTest, PatchesThePreviousVersion) {
  options_.build.given_poses = GivenPosesUse::kExact;
  small_.pattern.noise_m = 0.02;
  options_.drives = {write_drive("noisy", 0.0)};
  const RebuildResult first = rebuild();
  options_.previous = options_.map;
  options_.map = folder_.path() / "newer";
  options_.drives = {write_drive("later", 0.5)};
  options_.patch = true;
  for (const std::string at : {"map: survey", "patch: seams", "patch: tiles", "keep: tiles",
                               "localize previous: localize"})
    cancel_at(at);
  const RebuildResult second = rebuild();
  ASSERT_TRUE(second.patch) << to_json(second, options_);
  EXPECT_EQ(second.patch->digest, second.digest);
  EXPECT_GT(second.patch->tiles_new, 0U);
  EXPECT_TRUE(second.verdict.passed) << to_json(second, options_);
  const auto map = maps::MapPackage::open(options_.map);
  EXPECT_EQ(map->digest(), second.digest);
  EXPECT_EQ(map->manifest().drives.size(), 2U);
  EXPECT_EQ(map->manifest().registration->previous_digest, first.digest);
  for (const StageShare& each : rebuild_stages(options_)) EXPECT_FALSE(each.stage.empty());
  // Asked for again, it says the same.
  EXPECT_EQ(result(rebuild()), result(second));
}

TEST_F(RebuildTest, NeedsAPreviousVersionToPatch) {
  options_.patch = true;
  EXPECT_THAT([&] { (void)rebuild(); },
              ThrowsSaying<std::invalid_argument>({"--patch", "--previous MAP"}));
}

TEST_F(RebuildTest, DoesNotPassAMapWhosePosesBecameWorse) {
  options_.build.voxel_size_m = 0.1;
  (void)rebuild();
  options_.previous = options_.map;
  options_.map = folder_.path() / "newer";
  options_.drives = {write_drive("shaken", 0.0, 0.05)};
  options_.build.given_poses = GivenPosesUse::kExact;
  const RebuildResult report = rebuild();
  EXPECT_FALSE(report.verdict.passed);
  EXPECT_THAT(report.verdict.reasons, Contains(HasSubstr("walls are")));
  EXPECT_THAT(report.verdict.reasons, Contains(HasSubstr("mean map entropy is")));
}

TEST_F(RebuildTest, AsksForTheScansOfAnotherDrive) {
  options_.held_back = write_drive("another", 0.7);
  const RebuildResult report = rebuild();
  EXPECT_EQ(report.answers.queries, kScans);
  EXPECT_EQ(report.answers.found, kScans);
  EXPECT_EQ(maps::MapPackage::open(options_.map)->manifest().counts.at("scans"), kScans);
  EXPECT_THAT(report.warnings, IsEmpty());
}

TEST_F(RebuildTest, AsksForTheScansOfAnotherDriveAtAPlaceThatIsGiven) {
  options_.held_back = write_drive("another", 0.7);
  options_.build.geodetic_origin = maps::GeodeticOrigin{49.0, 8.4, 116.5};
  const RebuildResult report = rebuild();
  EXPECT_EQ(report.answers.found, kScans);
}

TEST_F(RebuildTest, ShiftsThePosesOfAnotherDriveAsThoseOfTheMap) {
  options_.drives = {write_drive("late", 0.0, 0.0, 4)};
  options_.held_back = write_drive("another", 0.7, 0.0, 4);
  options_.build.pose_time_offset_s = 0.4;
  const RebuildResult report = rebuild();
  EXPECT_GE(report.answers.queries, kScans - 4);
  EXPECT_EQ(report.answers.found, report.answers.queries);
}

TEST_F(RebuildTest, MakesAgainWhatWasRemovedSince) {
  const std::string whole = result(rebuild());
  fs::remove_all(options_.map);
  const RebuildResult again = rebuild();
  EXPECT_EQ(result(again), whole);
  EXPECT_THAT(again.resumed_stages, Not(Contains("map")));
  EXPECT_THAT(again.resumed_stages, Contains("localize map"));
  fs::remove_all(options_.map);
  fs::remove_all(options_.work / "keep");
  EXPECT_EQ(result(rebuild()), whole);
}

TEST_F(RebuildTest, TakesNoOtherMapAtItsPlaceForItsOwn) {
  (void)rebuild();
  fs::remove_all(options_.map);
  cancel_at("map: tiles");
  RebuildOptions others = options_;
  others.work = folder_.path() / "another work";
  others.build.voxel_size_m = 0.3;
  cancel_ = false;
  (void)rebuild_map(others, {}, cancel_);
  EXPECT_THAT([&] { (void)rebuild(); },
              ThrowsSaying<maps::InputError>({options_.map.string(), "another map"}));
}

/// Opens no more files than so many while it lives.
class FewFiles {
 public:
  explicit FewFiles(rlim_t most) {
    getrlimit(RLIMIT_NOFILE, &before_);
    const rlimit few{most, before_.rlim_max};
    setrlimit(RLIMIT_NOFILE, &few);
  }
  ~FewFiles() { setrlimit(RLIMIT_NOFILE, &before_); }
  FewFiles(const FewFiles&) = delete;
  FewFiles& operator=(const FewFiles&) = delete;

 private:
  rlimit before_{};
};

TEST(RebuildWork, ThatWasThrownAwayByHalfIsNotTakenForTheWhole) {
  const test::TemporaryFolder folder;
  const auto open = [&](const char* key) { return RebuildWork(folder.path() / "work", key); };
  open("a: 1\n").remember("map", "done");
  EXPECT_EQ(open("a: 1\n").remembered("map"), "done");
  // Too deep to be removed with few open files, wherever it comes in the order of the folder.
  fs::path deep = folder.path() / "work" / "journal";
  for (int i = 0; i < 200; ++i) deep /= "d";
  fs::create_directories(deep);
  {
    const FewFiles few(100);
    EXPECT_THAT([&] { (void)open("a: 2\n"); }, ThrowsSaying<maps::StorageError>({"journal"}));
  }
  EXPECT_EQ(open("a: 1\n").remembered("map"), std::nullopt);
  EXPECT_FALSE(fs::exists(folder.path() / "work" / "journal"));
}

TEST_F(RebuildTest, RefusesToLookForTheOffsetOfPoses) {
  options_.build.finds_pose_time_offset = true;
  EXPECT_THAT([&] { (void)rebuild(); },
              ThrowsSaying<std::invalid_argument>({"auto is not possible", "--motion"}));
}

TEST_F(RebuildTest, RefusesADriveToJudgeByWhosePosesMeanNothing) {
  options_.held_back = write_drive("another", 0.7);
  fs::remove(*options_.held_back / "poses.txt");
  EXPECT_THAT([&] { (void)rebuild(); },
              ThrowsSaying<maps::InputError>({"another", "without poses"}));
  options_.held_back = drive_;
  options_.build.odometry = "default";
  EXPECT_THAT([&] { (void)rebuild(); }, ThrowsSaying<maps::InputError>({"estimated"}));
  EXPECT_FALSE(fs::exists(options_.work));
}

TEST_F(RebuildTest, WorksInNoFolderOfOthers) {
  folder_.write("work/thesis.tex", "do not lose");
  EXPECT_THAT([&] { (void)rebuild(); }, ThrowsSaying<maps::InputError>({"work", "other things"}));
  EXPECT_TRUE(fs::exists(options_.work / "thesis.tex"));
}

TEST_F(RebuildTest, JudgesAgainByOtherLimitsWithoutBuildingAgain) {
  (void)rebuild();
  options_.limits.least_queries = 100;
  const RebuildResult report = rebuild();
  EXPECT_FALSE(report.verdict.passed);
  EXPECT_THAT(report.resumed_stages, Contains("map"));
}

TEST_F(RebuildTest, DoesAStageAgainWhoseResultWasSpoiled) {
  const std::string whole = result(rebuild());
  const fs::path remembered = options_.work / "localize map.done";
  ASSERT_TRUE(fs::exists(remembered));
  std::ofstream(remembered, std::ios::app) << "x";
  const RebuildResult report = rebuild();
  EXPECT_EQ(result(report), whole);
  EXPECT_THAT(report.resumed_stages, Not(Contains("localize map")));
}

TEST_F(RebuildTest, EstimatesFromScansAndPoints) {
  const RebuildEstimate estimate = estimate_rebuild(options_);
  EXPECT_EQ(estimate.scans, kScans);
  const std::uint64_t points = maps::Drive::open(drive_).read(0).points_in_file * kScans;
  EXPECT_NEAR(static_cast<double>(estimate.points), static_cast<double>(points),
              0.2 * static_cast<double>(points));
  const RebuildEstimate twice = estimate_rebuild(2 * estimate.scans, 2 * estimate.points, 0.2);
  EXPECT_GT(twice.bytes(), estimate.bytes());
  EXPECT_EQ(twice.bytes(), twice.package_bytes + twice.work_bytes);
  EXPECT_GE(estimate_rebuild(10, 1'000'000, 0.1).bytes(),
            estimate_rebuild(10, 1'000'000, 0.4).bytes());
  EXPECT_THROW((void)estimate_rebuild(1, 1, 0.0), std::invalid_argument);
}

}  // namespace rebuild_test
}  // namespace stillmap::mapping
