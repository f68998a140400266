#include <stillmap/mapping/build_units.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fstream>
#include <iterator>

#include "small_drive.hpp"

namespace stillmap::mapping {
namespace build_units_test {

namespace fs = std::filesystem;
using Kind = BuildUnit::Kind;
using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

/// What something says that throws; empty when it does not.
template <typename Exception, typename Call>
std::string message_of(const Call& call) {
  try {
    call();
  } catch (const Exception& error) {
    return error.what();
  }
  return {};
}

TEST(BuildUnitNames, AreReadAsTheyAreWritten) {
  for (const auto& step : unit_steps(7)) {
    for (const BuildUnit& unit : step) EXPECT_THAT(units_from(name_of(unit), 7), ElementsAre(unit));
  }
  EXPECT_THAT(units_from("survey:2,fuse", 2),
              ElementsAre(BuildUnit{Kind::kSurvey, 2}, BuildUnit{Kind::kFuse, 1}));
  for (const char* none : {"", "survey", "survey:", "survey:0", "survey:8", "survey:1x", "fuse:1",
                           "poses,", "merge:1", "Fuse"})
    EXPECT_THAT(message_of<std::invalid_argument>([&] { (void)units_from(none, 7); }),
                HasSubstr("from 1 to 7"))
        << none;
}

TEST(BuildUnitSteps, HoldEachUnitOnce) {
  const auto steps = unit_steps(3);
  ASSERT_THAT(steps, SizeIs(5));
  EXPECT_THAT(steps[1], ElementsAre(BuildUnit{Kind::kSurvey, 1}, BuildUnit{Kind::kSurvey, 2},
                                    BuildUnit{Kind::kSurvey, 3}));
  EXPECT_THAT(steps[4], ElementsAre(BuildUnit{Kind::kMerge, 1}));
}

class BuildUnits : public ::testing::Test {
 protected:
  BuildUnits() : drive_(small_.write(folder_)) {
    options_.threads = 1;
    options_.detector = "geometric";
    fs::create_directories(maps_);
  }

  MapBuildResult whole() { return build_map({drive_}, maps_ / "whole", options_, {}, cancel_); }
  std::optional<MapBuildResult> run(const BuildUnit& unit, std::size_t units,
                                    const ProgressCallback& progress = {}) {
    return do_unit({drive_}, target_, options_, unit, units, progress, cancel_);
  }
  void run_until(Kind last, std::size_t units) {
    for (const auto& step : unit_steps(units)) {
      for (const BuildUnit& unit : step) (void)run(unit, units);
      if (step.front().kind == last) return;
    }
  }
  std::string refusal_of(const BuildUnit& unit, std::size_t units) {
    return message_of<maps::InputError>([&] { (void)run(unit, units); });
  }

  test::TemporaryFolder folder_;
  test::SmallDrive small_;
  fs::path drive_;
  fs::path maps_ = folder_.path() / "maps";
  fs::path target_ = maps_ / "map";
  MapBuildOptions options_;
  CancelFlag cancel_{false};
};

TEST_F(BuildUnits, MakeTheMapOfOneProcess) {
  for (const bool fusion : {true, false}) {
    options_.fusion = fusion;
    const MapBuildResult expected = whole();
    // Finish units of one region alone would show little.
    EXPECT_GT(maps::MapPackage::open(maps_ / "whole")->regions().size(), 1U);
    for (const std::size_t units : {1, 2, 3, 7}) {
      options_.threads = units == 3 ? 2 : 1;
      std::optional<MapBuildResult> result;
      for (const auto& step : unit_steps(units)) {
        // In any order.
        for (auto unit = step.rbegin(); unit != step.rend(); ++unit) result = run(*unit, units);
      }
      ASSERT_TRUE(result);
      EXPECT_EQ(result->digest, expected.digest) << units;
      EXPECT_EQ(result->points, expected.points);
      EXPECT_EQ(result->objects, expected.objects);
      EXPECT_EQ(result->consistency.mean_map_entropy, expected.consistency.mean_map_entropy);
      EXPECT_THAT(maps::MapPackage::open(target_)->verify(), IsEmpty());
      EXPECT_FALSE(fs::exists(units_folder(target_)));
      fs::remove_all(target_);
    }
    fs::remove_all(maps_ / "whole");
  }
}

TEST_F(BuildUnits, GoOnWhereTheyWereCancelled) {
  const std::string expected = whole().digest;
  const std::vector<std::string> stages{"survey", "fuse", "place", "tiles", "publish"};
  for (const std::string& at : stages) {
    for (const auto& step : unit_steps(2)) {
      for (const BuildUnit& unit : step) {
        const ProgressCallback cancelling = [&](std::string_view stage, std::size_t, std::size_t) {
          if (stage == at) cancel_ = true;
        };
        try {
          (void)run(unit, 2, cancelling);
        } catch (const Cancelled&) {
          cancel_ = false;
          (void)run(unit, 2);
        }
        cancel_ = false;
      }
    }
    EXPECT_EQ(maps::MapPackage::open(target_)->digest(), expected) << at;
    EXPECT_EQ(std::distance(fs::directory_iterator(maps_), {}), 2) << at;
    fs::remove_all(target_);
  }
}

TEST_F(BuildUnits, NameTheUnitThatIsMissing) {
  EXPECT_THAT(refusal_of({Kind::kSurvey, 1}, 2), HasSubstr("do --unit poses first"));
  (void)run({Kind::kPoses}, 2);
  (void)run({Kind::kSurvey, 1}, 2);
  EXPECT_THAT(refusal_of({Kind::kFuse}, 2), HasSubstr("do --unit survey:2 first"));
  (void)run({Kind::kSurvey, 2}, 2);
  EXPECT_THAT(refusal_of({Kind::kFinish, 1}, 2), HasSubstr("do --unit fuse first"));
  (void)run({Kind::kFuse}, 2);
  (void)run({Kind::kFinish, 2}, 2);
  EXPECT_THAT(refusal_of({Kind::kMerge}, 2), HasSubstr("do --unit finish:1 first"));
  EXPECT_FALSE(fs::exists(target_));
}

TEST_F(BuildUnits, RefuseTheWorkOfOtherOptions) {
  run_until(Kind::kFinish, 2);
  options_.voxel_size_m = 0.2;
  EXPECT_THAT(refusal_of({Kind::kMerge}, 2),
              AllOf(HasSubstr("found 'voxel_size_m: 0.1'"), HasSubstr("survey:1")));
  options_.voxel_size_m = 0.1;
  options_.projection.margin_m = 0.3;
  EXPECT_THAT(refusal_of({Kind::kMerge}, 2), HasSubstr("do --unit fuse first"));
}

TEST_F(BuildUnits, RefuseWhatWasMadeBeforeAnEarlierUnitWasDoneAgain) {
  run_until(Kind::kFinish, 2);
  fs::remove(units_folder(target_) / "survey_1_of_2.journal");
  (void)run({Kind::kSurvey, 1}, 2);
  EXPECT_THAT(refusal_of({Kind::kFinish, 1}, 2), HasSubstr("do --unit fuse first"));
  (void)run({Kind::kFuse}, 2);
  EXPECT_THAT(refusal_of({Kind::kMerge}, 2), HasSubstr("do --unit finish:1 first"));
}

TEST_F(BuildUnits, RefuseAScanThatHasChangedSinceItWasSurveyed) {
  run_until(Kind::kSurvey, 2);
  const fs::path scan = drive_ / "000001.bin";
  // As no size and no time of the file tells.
  const auto time = fs::last_write_time(scan);
  {
    std::fstream file(scan, std::ios::binary | std::ios::in | std::ios::out);
    file.seekp(64);
    file.write("\1\2\3\4", 4);
  }
  fs::last_write_time(scan, time);
  EXPECT_THAT(refusal_of({Kind::kFuse}, 2),
              AnyOf(HasSubstr("000001.bin has changed"), HasSubstr("survey:1")));
  for (const auto& step : unit_steps(2)) {
    for (const BuildUnit& unit : step) (void)run(unit, 2);
  }
  EXPECT_EQ(maps::MapPackage::open(target_)->digest(), whole().digest);
}

TEST_F(BuildUnits, DoWhatIsDoneOnlyOnce) {
  run_until(Kind::kFinish, 2);
  const auto written = [&] {
    std::vector<fs::file_time_type> times;
    for (const char* name : {"fuse", "finish_1_of_2", "survey_2_of_2"})
      times.push_back(
          fs::last_write_time(units_folder(target_) / (std::string(name) + ".journal")));
    return times;
  };
  const auto before = written();
  run_until(Kind::kFinish, 2);
  EXPECT_EQ(written(), before);
}

TEST_F(BuildUnits, LeaveAMapThatIsThereAlone) {
  (void)whole();
  target_ = maps_ / "whole";
  EXPECT_THAT(refusal_of({Kind::kPoses}, 2), HasSubstr("an existing path"));
  EXPECT_THAT(refusal_of({Kind::kMerge}, 2), HasSubstr("whole"));
}

TEST_F(BuildUnits, RefuseMethodsThatNeedTheWholeMap) {
  options_.clean = "erasor";
  EXPECT_THAT(message_of<std::invalid_argument>([&] { (void)run({Kind::kPoses}, 2); }),
              HasSubstr("whole map"));
}

}  // namespace build_units_test
}  // namespace stillmap::mapping
