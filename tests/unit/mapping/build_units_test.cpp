#include <stillmap/mapping/build_units.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fstream>
#include <iterator>

#include "small_drive.hpp"
#include "units/unit_lock.hpp"

namespace stillmap::mapping {
namespace build_units_test {

namespace fs = std::filesystem;
using Kind = BuildUnit::Kind;
using ::testing::AllOf;
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

  std::string whole_name() {
    (void)whole();
    return "whole";
  }
  MapBuildResult whole() { return build_map({drive_}, maps_ / "whole", options_, {}, cancel_); }
  MapBuildResult run(const BuildUnit& unit, std::size_t units,
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
      MapBuildResult result;
      for (const auto& step : unit_steps(units)) {
        // In any order.
        for (auto unit = step.rbegin(); unit != step.rend(); ++unit) result = run(*unit, units);
      }
      EXPECT_EQ(result.digest, expected.digest) << units;
      EXPECT_EQ(result.points, expected.points);
      EXPECT_EQ(result.objects, expected.objects);
      EXPECT_EQ(result.consistency.mean_map_entropy, expected.consistency.mean_map_entropy);
      EXPECT_THAT(maps::MapPackage::open(target_)->verify(), IsEmpty());
      EXPECT_FALSE(fs::exists(units_folder(target_)));
      fs::remove_all(target_);
    }
    fs::remove_all(maps_ / "whole");
  }
}

TEST_F(BuildUnits, GoOnWhereTheyWereCancelled) {
  const std::string expected = whole().digest;
  for (const std::string at : {"survey", "fuse", "place", "tiles"}) {
    std::size_t cancelled = 0;
    for (const auto& step : unit_steps(2)) {
      for (const BuildUnit& unit : step) {
        const ProgressCallback cancelling = [&](std::string_view stage, std::size_t, std::size_t) {
          if (stage == at) cancel_ = true;
        };
        try {
          (void)run(unit, 2, cancelling);
        } catch (const Cancelled&) {
          ++cancelled;
          cancel_ = false;
          (void)run(unit, 2);
        }
        cancel_ = false;
      }
    }
    EXPECT_GE(cancelled, 1U) << at;
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
  // The ground learns from ten scans of the twelve, not from the sixth.
  std::string poses;
  for (std::size_t i = 0; i < 12; ++i) {
    folder_.write(fmt::format("drive/{:06}.bin", i), test::bin_of(small_.scan(i % 4)));
    poses += test::kitti_line(small_.T_map_lidar[i % 4]);
  }
  folder_.write("drive/poses.txt", poses);
  const fs::path scan = drive_ / "000005.bin";
  const auto change = [&](const std::string& bytes) {
    // As no size and no time of the file tells.
    const auto time = fs::last_write_time(scan);
    {
      std::fstream file(scan, std::ios::binary | std::ios::in | std::ios::out);
      file.seekp(64);
      file << bytes;
    }
    fs::last_write_time(scan, time);
  };
  run_until(Kind::kSurvey, 2);
  change("abcd");
  EXPECT_THAT(refusal_of({Kind::kFuse}, 2),
              AllOf(HasSubstr("000005.bin"), HasSubstr("other bytes than were surveyed"),
                    HasSubstr("--unit survey:1")));
  run_until(Kind::kFuse, 2);
  change("efgh");
  EXPECT_THAT(refusal_of({Kind::kFinish, 1}, 2) + refusal_of({Kind::kFinish, 2}, 2),
              HasSubstr("other bytes than were surveyed"));
  run_until(Kind::kMerge, 2);
  EXPECT_EQ(maps::MapPackage::open(target_)->digest(), whole().digest);
}

TEST_F(BuildUnits, PosesNeverReplaceThoseOfAnotherBuild) {
  (void)run({Kind::kPoses}, 2);
  const fs::path journal = units_folder(target_) / "trajectory.journal";
  const auto bytes = fs::file_size(journal);
  options_.given_poses = GivenPosesUse::kExact;
  EXPECT_THAT(refusal_of({Kind::kPoses}, 2),
              AllOf(HasSubstr("the work of another build"), HasSubstr("given poses: refine"),
                    HasSubstr("remove " + units_folder(target_).string())));
  EXPECT_EQ(fs::file_size(journal), bytes);
}

TEST_F(BuildUnits, SayWhichFileHasBrokenBytes) {
  run_until(Kind::kFinish, 2);
  struct Case {
    const char* journal;
    BuildUnit reader;
    /// What the reader wrote: a unit that is done is not done again.
    const char* written;
  };
  for (const Case& each :
       {Case{"trajectory", {Kind::kMerge}, nullptr}, Case{"survey_1_of_2", {Kind::kFuse}, "fuse"},
        Case{"fuse", {Kind::kFinish, 1}, "finish_1_of_2"},
        Case{"finish_1_of_2", {Kind::kMerge}, nullptr}}) {
    const auto file_of = [&](const char* name) {
      return units_folder(target_) / (std::string(name) + ".journal");
    };
    const fs::path journal = file_of(each.journal);
    const auto at = static_cast<std::streamoff>(fs::file_size(journal) * 9 / 10);
    const auto change = [&](int by) {
      std::fstream file(journal, std::ios::binary | std::ios::in | std::ios::out);
      file.seekg(at);
      const int old = file.get();
      file.seekp(at);
      file.put(static_cast<char>(old + by));
    };
    if (each.written != nullptr) fs::remove(file_of(each.written));
    change(1);
    EXPECT_THAT(refusal_of(each.reader, 2),
                AllOf(HasSubstr(journal.string()), HasSubstr("broken"), HasSubstr("again")));
    change(-1);
    run_until(Kind::kFinish, 2);
  }
  EXPECT_FALSE(run({Kind::kMerge}, 2).digest.empty());
}

TEST_F(BuildUnits, AreDoneByOneProcessAtATime) {
  const UnitLock other(units_folder(target_), "survey:1");
  EXPECT_THAT(refusal_of({Kind::kSurvey, 1}, 2), HasSubstr("by another process"));
  EXPECT_THAT(refusal_of({Kind::kSurvey, 2}, 2), HasSubstr("--unit poses first"));
}

TEST_F(BuildUnits, MergeIsDoneOnceHoweverItEnds) {
  run_until(Kind::kFinish, 2);
  const fs::path folder = units_folder(target_);
  const fs::path copy = folder_.path() / "copy";
  fs::copy(folder, copy, fs::copy_options::recursive);
  const MapBuildResult first = run({Kind::kMerge}, 2);
  EXPECT_FALSE(first.digest.empty());
  // Its end was not heard of.
  EXPECT_EQ(to_json(run({Kind::kMerge}, 2)), to_json(first));
  EXPECT_FALSE(fs::exists(folder));
  // Killed before it could remove the folder.
  fs::rename(copy, folder);
  EXPECT_EQ(to_json(run({Kind::kMerge}, 2)), to_json(first));
  EXPECT_FALSE(fs::exists(folder));
  EXPECT_THAT(maps::MapPackage::open(target_)->verify(), IsEmpty());
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
  run_until(Kind::kFinish, 2);
  fs::rename(maps_ / whole_name(), target_);
  EXPECT_THAT(refusal_of({Kind::kPoses}, 2), HasSubstr("an existing path"));
  EXPECT_THAT(refusal_of({Kind::kMerge}, 2), HasSubstr("an existing path"));
  EXPECT_TRUE(fs::exists(units_folder(target_) / "finish_2_of_2.journal"));
  fs::remove_all(units_folder(target_));
  EXPECT_THAT(refusal_of({Kind::kMerge}, 2), HasSubstr("an existing path"));
  EXPECT_FALSE(fs::exists(units_folder(target_)));
}

TEST_F(BuildUnits, RefuseMethodsThatNeedTheWholeMap) {
  options_.clean = "erasor";
  EXPECT_THAT(message_of<std::invalid_argument>([&] { (void)run({Kind::kPoses}, 2); }),
              HasSubstr("whole map"));
}

/// A street of 900 m with walls and cars, driven there and, by a second drive, back: most units see
/// a part of the scans and of the ground.
class BuildUnitsOfAStreet : public BuildUnits {
 protected:
  BuildUnitsOfAStreet() {
    test::SmallDrive street;
    street.world.boxes.clear();
    for (int i = 0; i < 30; ++i) {
      const double x = 30.0 * i;
      street.world.boxes.push_back({{x, 8.0, 0.0}, {x + 22.0, 8.5, 5.0}});
      street.world.boxes.push_back({{x + 5.0, -9.0, 0.0}, {x + 25.0, -8.5, 4.0}});
      street.world.boxes.push_back({{x + 12.0, 3.0, 0.2}, {x + 16.3, 4.8, 1.5}});
    }
    street.pattern.columns = 180;
    write(street, "there", [](int i) { return test::pose_at(30.0 * i, 0.0, 0.0); });
    write(street, "back", [](int i) { return test::pose_at(880.0 - 30.0 * i, 1.0, 3.14); });
    options_.max_range_m = 20.0;
    options_.given_poses = GivenPosesUse::kExact;
  }

  template <typename Pose>
  void write(test::SmallDrive& street, const std::string& name, const Pose& pose) {
    std::string poses;
    street.T_map_lidar.clear();
    for (int i = 0; i < 30; ++i) {
      street.T_map_lidar.push_back(pose(i));
      poses += test::kitti_line(street.T_map_lidar.back());
      folder_.write(fmt::format("{}/{:06}.bin", name, i),
                    test::bin_of(street.scan(static_cast<std::size_t>(i))));
    }
    folder_.write(name + "/poses.txt", poses);
    drives_.push_back(folder_.path() / name);
  }
  void expect_equal_maps(std::size_t units) {
    const MapBuildResult one = build_map(drives_, maps_ / "whole", options_, {}, cancel_);
    MapBuildResult result;
    for (const auto& step : unit_steps(units)) {
      for (const BuildUnit& unit : step)
        result = do_unit(drives_, target_, options_, unit, units, {}, cancel_);
    }
    EXPECT_EQ(result.digest, one.digest);
    EXPECT_EQ(result.points, one.points);
    fs::remove_all(target_);
    fs::remove_all(maps_ / "whole");
  }

  std::vector<fs::path> drives_;
};

TEST_F(BuildUnitsOfAStreet, MakeTheMapOfOneProcess) { expect_equal_maps(4); }

TEST_F(BuildUnitsOfAStreet, MakeTheMapOfOneProcessWithCorrectionsAndScansHeldBack) {
  options_.projection.policy = MovablePolicy::kDelete;
  options_.held_back_every = 3;
  options_.edits_file = folder_.write("edits.json", R"({"format": "stillmap-edits", "version": 1,
    "edits": [{"action": "remove", "box": {"centre": [404, 3.9, 0.8], "size": [8, 3, 2], "yaw": 0}},
              {"action": "keep", "box": {"centre": [704, 3.9, 0.8], "size": [8, 3, 2], "yaw": 0}}]})");
  expect_equal_maps(3);
}

TEST_F(BuildUnitsOfAStreet, MakeTheMapOfOneProcessWhereCarsStay) {
  options_.projection.policy = MovablePolicy::kKeep;
  options_.clean = "none";
  options_.fusion = false;
  expect_equal_maps(5);
}

}  // namespace build_units_test
}  // namespace stillmap::mapping
