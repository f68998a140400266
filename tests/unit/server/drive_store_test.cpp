#include "store/drive_store.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/text.hpp>
#include "store/drive_table.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <fstream>
#include <functional>
#include <future>
#include <iterator>
#include <span>
#include <string>
#include <thread>
#include <utility>

#include "support/bag_bytes.hpp"
#include "support/disk_calls.hpp"
#include "support/store_refusals.hpp"
#include "support/tar_bytes.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace drive_store_test {

namespace fs = std::filesystem;
using ::stillmap::test::expect_refused;
using ::stillmap::test::source_of;
using ::stillmap::test::tar_end;
using ::stillmap::test::tar_file;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using ::stillmap::test::UnsyncedCalls;
using ::testing::HasSubstr;
using Reason = StoreRefusal::Reason;

class DriveStoreTest : public ::testing::Test {
 protected:
  DriveStoreTest() {
    store_.create_map("town");
    id_ = store_.drives().open("town", "monday", 1).id;
  }

  static std::string scan() { return std::string(64, '\x3f'); }
  static std::string tar() {
    return tar_file("0.bin", scan()) + tar_file("1.bin", scan()) + tar_end();
  }
  DriveStore::Added add(std::int64_t n, const std::string& bytes,
                        const DriveStore::Limits& limits = {}) {
    return drives_.add_part(id_, {n, bytes.size(), source_of(bytes)}, limits);
  }
  [[nodiscard]] fs::path home() const { return folder_.path() / "drives" / std::to_string(id_); }
  [[nodiscard]] std::size_t parts_on_disk() const {
    return static_cast<std::size_t>(std::distance(fs::directory_iterator(home() / "parts"), {}));
  }

  TemporaryFolder folder_;
  UnsyncedCalls calls_;
  PackageStore store_{folder_.path(), calls_};
  DriveStore drives_{store_, calls_};
  std::int64_t id_ = 0;
};

TEST_F(DriveStoreTest, MakesADriveOfPartsInAnyOrder) {
  EXPECT_TRUE(add(2, tar().substr(1000)).is_new);
  const DriveStore::Added first = add(1, tar().substr(0, 1000));
  EXPECT_EQ(first.part, store_.drives().parts(id_).front());
  EXPECT_EQ(first.part.bytes, 1000U);
  EXPECT_EQ(drives_.complete(id_, {}).status, DriveStatus::kComplete);
  std::ifstream file(drives_.folder(id_) / "1.bin", std::ios::binary);
  EXPECT_EQ(std::string(std::istreambuf_iterator<char>(file), {}), scan());
  EXPECT_FALSE(fs::exists(home() / "parts"));
  EXPECT_EQ(drives_.complete(id_, {}).bytes, tar().size()) << "twice is once";
  expect_refused(Reason::kDriveNotOpen, [&] { add(3, "x"); });
  EXPECT_FALSE(fs::exists(home() / "parts"));
}

TEST_F(DriveStoreTest, TakesAPartAgainOnlyWhenItIsTheSame) {
  EXPECT_TRUE(add(1, "same").is_new);
  EXPECT_FALSE(add(1, "same").is_new);
  expect_refused(Reason::kOtherDigest, [&] { add(1, "else"); });
  EXPECT_EQ(parts_on_disk(), 1U);
  std::ifstream file(home() / "parts" / "1");
  EXPECT_EQ(std::string(std::istreambuf_iterator<char>(file), {}), "same");
}

TEST_F(DriveStoreTest, TakesNothingOfAPartThatIsNotWhatWasAnnounced) {
  const auto send = [&](std::uint64_t announced, const std::optional<std::string>& sha256) {
    return [=, this] { drives_.add_part(id_, {1, announced, source_of("abc"), sha256}, {}); };
  };
  EXPECT_THAT(send(2, {}), ThrowsSaying<maps::InputError>({"part 1", "more bytes", "2"}));
  EXPECT_THAT(send(4, {}), ThrowsSaying<maps::InputError>({"3 bytes", "4 as announced"}));
  EXPECT_THAT(send(3, std::string(64, 'a')), ThrowsSaying<maps::InputError>({"SHA-256", "aaaa"}));
  EXPECT_THAT([&] { add(0, "abc"); }, ThrowsSaying<std::invalid_argument>({"1 to 10000"}));
  EXPECT_EQ(parts_on_disk(), 0U);
  EXPECT_TRUE(store_.drives().parts(id_).empty());
  send(3, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad")();
  EXPECT_EQ(store_.drives().parts(id_).size(), 1U);
}

TEST_F(DriveStoreTest, BoundsAllPartsTogetherButNotTheirRepetition) {
  const DriveStore::Limits limits{.bytes = 10};
  add(1, "123456", limits);
  EXPECT_THAT([&] { add(2, "12345", limits); }, ThrowsSaying<maps::InputError>({"at most 10"}));
  EXPECT_FALSE(add(1, "123456", limits).is_new);
  EXPECT_TRUE(add(2, "1234", limits).is_new);
  store_.set_quota({.map_bytes = 12});
  expect_refused(Reason::kOverQuota, [&] { add(3, "123"); });
  EXPECT_TRUE(add(3, "12").is_new);
}

TEST_F(DriveStoreTest, BoundsPartsThatComeAtOneTimeTogether) {
  const DriveStore::Limits limits{.bytes = 10};
  // A part that comes whole while the other is under way.
  bool other_came = false;
  const auto slow = [&, sent = false](std::span<char> to) mutable -> std::size_t {
    if (std::exchange(sent, true)) return 0;
    EXPECT_TRUE(add(2, "abcdef", limits).is_new);
    other_came = true;
    std::fill_n(to.begin(), 6, 'x');
    return 6;
  };
  EXPECT_THAT(
      [&] {
        drives_.add_part(id_, {1, 6, slow}, limits);
      },
      ThrowsSaying<maps::InputError>({"part 1", "6 bytes more than 6", "at most 10"}));
  EXPECT_TRUE(other_came);
  EXPECT_EQ(store_.drives().drive(id_).bytes, 6U);
  EXPECT_EQ(parts_on_disk(), 1U);
}

TEST_F(DriveStoreTest, FailsForGoodWhenThePartsAreNoDrive) {
  add(1, tar_file("a/readme.txt", "x") + tar_end());
  EXPECT_THAT([&] { drives_.complete(id_, {}); }, ThrowsSaying<maps::InputError>({"no layout"}));
  EXPECT_EQ(store_.drives().drive(id_).status, DriveStatus::kFailed);
  EXPECT_THAT(store_.drives().drive(id_).error, HasSubstr("no layout"));
  EXPECT_FALSE(fs::exists(home()));
  expect_refused(Reason::kDriveNotOpen, [&] { drives_.complete(id_, {}); });
}

/// A bag of two lidars.
std::string two_clouds() { return tar_file("run.mcap", test::bag_of_two_clouds()) + tar_end(); }

/// What was opened, as an inspection.
DriveStore::Found kind_of(const OpenedDrive& opened) {
  return {.needs_choice = {}, .inspection = opened.drive ? "drive" : "recording"};
}

TEST_F(DriveStoreTest, KeepsARecordingUntilAChoiceOpensIt) {
  add(1, two_clouds());
  const StoredDrive asked = drives_.complete(id_, {.inspect = kind_of});
  EXPECT_EQ(asked.status, DriveStatus::kNeedsChoice);
  EXPECT_THAT(asked.error, HasSubstr("/cloud2 (1 clouds"));
  EXPECT_EQ(asked.inspection, "recording");
  EXPECT_EQ(asked, store_.drives().drive(id_));
  EXPECT_FALSE(asked.finished_ns);
  EXPECT_FALSE(fs::exists(home() / "parts")) << "its bytes lie there once";
  expect_refused(Reason::kDriveNotOpen, [&] { add(2, "x"); });
  expect_refused(Reason::kDriveNotComplete,
                 [&] { (void)store_.jobs().enqueue({.map = "town", .drives = {id_}}, 2); });
  EXPECT_EQ(drives_.complete(id_, {}), asked) << "without a choice it asks again";
  const StoredDrive wrong = drives_.complete(id_, {.choice = "cloud=/none", .inspect = kind_of});
  EXPECT_EQ(wrong.status, DriveStatus::kNeedsChoice);
  EXPECT_THAT(wrong.error, HasSubstr("no clouds on /none"));

  const DriveStore reopened(store_, calls_);
  EXPECT_TRUE(fs::exists(reopened.folder(id_) / "run.mcap")) << "a restart takes nothing of it";
  const StoredDrive done = drives_.complete(id_, {.choice = "cloud=/cloud2", .inspect = kind_of});
  EXPECT_EQ(done.status, DriveStatus::kComplete);
  EXPECT_EQ(done.error, "");
  EXPECT_EQ(done.inspection, "drive");
  EXPECT_TRUE(done.finished_ns);
  EXPECT_EQ(maps::Drive::open(drives_.folder(id_)).contents().entries.topic, "/cloud2");
  EXPECT_EQ(drives_.complete(id_, {.choice = "cloud=/cloud2"}), done) << "twice is once";
  expect_refused(Reason::kDriveNotOpen,
                 [&] { drives_.complete(id_, {.choice = "cloud=/cloud1"}); });
}

TEST_F(DriveStoreTest, TakesTheChoiceThatComesWithTheEndOfTheUpload) {
  add(1, two_clouds());
  EXPECT_EQ(drives_.complete(id_, {.choice = "cloud=/cloud1"}).status, DriveStatus::kComplete);
  EXPECT_EQ(maps::Drive::open(drives_.folder(id_)).contents().entries.topic, "/cloud1");
}

TEST_F(DriveStoreTest, KeepsARecordingWhoseOnlyTopicWasMistyped) {
  add(1, tar_file("run.mcap", test::bag_of_clouds({"/points"})) + tar_end());
  const StoredDrive wrong = drives_.complete(id_, {.choice = "cloud=/point"});
  EXPECT_EQ(wrong.status, DriveStatus::kNeedsChoice);
  EXPECT_THAT(wrong.error, HasSubstr("no clouds on /point"));
  EXPECT_FALSE(fs::exists(drives_.folder(id_) / kTopicsFile)) << "what opens nothing is not kept";
  const StoredDrive done = drives_.complete(id_, {.choice = "cloud=/points"});
  EXPECT_EQ(done.status, DriveStatus::kComplete);
  EXPECT_EQ(maps::Drive::open(drives_.folder(id_)).size(), 1U);
}

TEST_F(DriveStoreTest, KeepsARecordingWhoseOwnChoiceIsWrong) {
  add(1, tar_file("run.mcap", test::bag_of_clouds({"/points"})) +
             tar_file("topics.txt", "cloud=/point\n") + tar_end());
  EXPECT_EQ(drives_.complete(id_, {}).status, DriveStatus::kNeedsChoice);
  EXPECT_EQ(drives_.complete(id_, {.choice = "cloud=/points"}).status, DriveStatus::kComplete);
}

TEST_F(DriveStoreTest, KeepsARecordingThatAnotherChoiceThanATopicOpens) {
  test::McapBytes bag;
  bag.add(test::McapBytes::schema(1, "sensor_msgs/msg/PointCloud2") +
          test::McapBytes::channel(1, 1, "/points"));
  // Headers without a time.
  for (const std::uint64_t recorded_ns : {1'000'000'000U, 1'100'000'000U})
    bag.add(test::McapBytes::message(1, test::one_point(0, 1.0F), recorded_ns));
  add(1, tar_file("run.mcap", bag.finished()) + tar_end());
  const StoredDrive asked = drives_.complete(
      id_, {.inspect = [](const OpenedDrive& opened) {
        return DriveStore::Found{{}, opened.needs_choice.value().topics().at(0).name};
      }});
  EXPECT_EQ(asked.status, DriveStatus::kNeedsChoice);
  EXPECT_EQ(asked.inspection, "/points") << "which can be chosen";
  EXPECT_EQ(drives_.complete(id_, {.choice = "stamps=recorded"}).status, DriveStatus::kComplete);
}

TEST_F(DriveStoreTest, AChoiceLeavesTheWordsThatCameWithTheRecording) {
  add(1, tar_file("run.mcap", test::bag_of_two_clouds()) +
             tar_file("topics.txt", "cloud=/cloud1\nimu=none\n") + tar_end());
  EXPECT_EQ(drives_.complete(id_, {.choice = "cloud=/cloud3&stamps=recorded"}).status,
            DriveStatus::kNeedsChoice);
  EXPECT_EQ(drives_.complete(id_, {.choice = "poses=none&cloud=/cloud2"}).status,
            DriveStatus::kComplete);
  EXPECT_EQ(maps::read_text(drives_.folder(id_) / kTopicsFile),
            "cloud=/cloud2&poses=none&imu=none");
  EXPECT_EQ(drives_.complete(id_, {.choice = "cloud=/cloud2&poses=none"}).status,
            DriveStatus::kComplete)
      << "the same words in another order";
  try {
    (void)drives_.complete(id_, {.choice = "cloud=/cloud1"});
    ADD_FAILURE() << "completed with another choice";
  } catch (const StoreRefusal& refusal) {
    EXPECT_THAT(refusal.what(), HasSubstr("drive 1 is complete already, with cloud=/cloud2&poses"));
  }
}

TEST_F(DriveStoreTest, RefusesAChoiceForWhatIsNoRecordingAndKeepsIt) {
  add(1, tar());
  EXPECT_THAT([&] { drives_.complete(id_, {.choice = "cloud=/points"}); },
              ThrowsSaying<ChoiceRefused>({"no recording", "leave it out"}));
  EXPECT_EQ(store_.drives().drive(id_).status, DriveStatus::kOpen);
  EXPECT_EQ(drives_.complete(id_, {}).status, DriveStatus::kComplete);
  EXPECT_FALSE(fs::exists(drives_.folder(id_) / kTopicsFile));
  expect_refused(Reason::kDriveNotOpen,
                 [&] { drives_.complete(id_, {.choice = "cloud=/points"}); });
}

TEST_F(DriveStoreTest, InspectsOneDriveAtATime) {
  const std::int64_t other = store_.drives().open("town", "tuesday", 2).id;
  add(1, tar());
  drives_.add_part(other, {1, tar().size(), source_of(tar())}, {});
  std::atomic<int> at_once = 0, most = 0;
  const auto inspect = [&](const OpenedDrive&) {
    most = std::max(most.load(), ++at_once);
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    --at_once;
    return DriveStore::Found{};
  };
  auto first = std::async(std::launch::async, [&] { drives_.complete(id_, {.inspect = inspect}); });
  drives_.complete(other, {.inspect = inspect});
  first.get();
  EXPECT_EQ(most, 1);
}

/// As the tar of a day's folder holds it.
TEST_F(DriveStoreTest, KeepsTheCalibrationThatKittiHasBesideADrive) {
  const std::string day = "2011_09_26/", drive = day + "2011_09_26_drive_0001_sync/";
  std::string tar = tar_file(day + "calib_imu_to_velo.txt", "R: 1 0 0 0 1 0 0 0 1\nT: 0 0 1\n");
  std::string times;
  for (const std::string scan_number : {"0000000000", "0000000001"}) {
    tar += tar_file(drive + "velodyne_points/data/" + scan_number + ".bin", scan());
    std::string oxts = "49 8.4 110 0 0 0";
    for (int i = 6; i < 30; ++i) oxts += " 0";
    tar += tar_file(drive + "oxts/data/" + scan_number + ".txt", oxts + "\n");
    times += "2011-09-26 13:00:0" + scan_number.substr(9) + ".000000000\n";
  }
  for (const char* folder : {"velodyne_points", "oxts"})
    tar += tar_file(drive + folder + "/timestamps.txt", times);
  for (const char* edge : {"start", "end"})
    tar += tar_file(drive + "velodyne_points/timestamps_" + edge + ".txt", times);
  add(1, tar + tar_end());
  EXPECT_EQ(drives_.complete(id_, {}).status, DriveStatus::kComplete);
  const maps::Drive opened = maps::Drive::open(drives_.folder(id_));
  EXPECT_EQ(opened.contents().layout, maps::DriveLayout::kKittiRaw);
  EXPECT_TRUE(opened.has_poses());
  EXPECT_FALSE(fs::exists(home() / ".incoming-drive"));
}

TEST_F(DriveStoreTest, KeepsWhatMulranHasAboveItsSensors) {
  const std::string stamps[] = {"1561000444390857630", "1561000444490857630"};
  std::string tar, poses;
  for (const std::string& stamp : stamps) {
    tar += tar_file("DCC01/sensor_data/Ouster/" + stamp + ".bin", scan());
    poses += stamp + ",1,0,0,0,0,1,0,0,0,0,1,0\n";
  }
  add(1, tar + tar_file("DCC01/global_pose.csv", poses) + tar_end());
  drives_.complete(id_, {});
  const maps::Drive opened = maps::Drive::open(drives_.folder(id_));
  EXPECT_EQ(opened.contents().layout, maps::DriveLayout::kMulran);
  EXPECT_TRUE(opened.has_poses());
}

/// Calls back once, when a part lies in its place.
class CallsWhenPlaced : public UnsyncedCalls {
 public:
  std::function<void()> placed;
  std::int64_t pass(const DiskCall& call, const Perform& perform) override {
    const std::int64_t done = UnsyncedCalls::pass(call, perform);
    if (call.kind == DiskCall::Kind::kRename && placed) std::exchange(placed, {})();
    return done;
  }
};

TEST_F(DriveStoreTest, PartsOfTwoDrivesDoNotPassTheQuotaTogether) {
  const std::int64_t other = store_.drives().open("town", "tuesday", 1).id;
  store_.set_quota({.map_bytes = 1000});
  CallsWhenPlaced calls;
  calls.placed = [&] { EXPECT_TRUE(add(1, std::string(600, 'x')).is_new); };
  DriveStore drives(store_, calls);
  expect_refused(Reason::kOverQuota, [&] {
    drives.add_part(other, {1, 600, source_of(std::string(600, 'y'))}, {});
  });
  EXPECT_FALSE(fs::exists(folder_.path() / "drives" / std::to_string(other) / "parts" / "1"));
  EXPECT_TRUE(store_.drives().parts(other).empty());
  EXPECT_EQ(parts_on_disk(), 1U);
}

TEST_F(DriveStoreTest, StaysOpenWhilePartsAreMissing) {
  expect_refused(Reason::kPartsMissing, [&] { drives_.complete(id_, {}); });
  add(2, tar().substr(1000));
  expect_refused(Reason::kPartsMissing, [&] { drives_.complete(id_, {}); });
  add(1, tar().substr(0, 1000));
  EXPECT_EQ(drives_.complete(id_, {}).status, DriveStatus::kComplete);
}

TEST_F(DriveStoreTest, LeavesNothingOfWhatIsRemovedUnlessAJobReadsIt) {
  add(1, tar());
  drives_.complete(id_, {});
  const StoredJob job = store_.jobs().enqueue({.map = "town", .drives = {id_}}, 2).job;
  expect_refused(Reason::kInUse, [&] { drives_.remove(id_); });
  EXPECT_TRUE(fs::exists(drives_.folder(id_)));
  store_.jobs().request_cancel(job.id, 3);
  drives_.remove(id_);
  EXPECT_FALSE(fs::exists(home()));
  expect_refused(Reason::kUnknownDrive, [&] { drives_.remove(id_); });
  expect_refused(Reason::kUnknownDrive, [&] { add(1, "x"); });
}

TEST_F(DriveStoreTest, ClearsWhatAKilledProcessLeft) {
  add(1, "abc");
  const auto make = [](const fs::path& folder) {
    fs::create_directories(folder);
    std::ofstream(folder / "file") << "x";
  };
  make(folder_.path() / "drives" / "77" / "parts");
  make(folder_.path() / "drives" / "not-a-drive");
  make(home() / ".incoming-drive");
  make(drives_.folder(id_));
  std::ofstream(home() / "parts" / ".incoming-5") << "half";
  const DriveStore again(store_, calls_);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path() / "drives"), {}), 1);
  EXPECT_EQ(std::distance(fs::directory_iterator(home()), {}), 1);
  EXPECT_EQ(parts_on_disk(), 1U);
}

TEST_F(DriveStoreTest, OthersGoOnWhileOneDriveIsSlow) {
  // Its bytes come only once another drive's part was taken.
  std::promise<void> other_taken;
  const std::int64_t other = store_.drives().open("town", "tuesday", 2).id;
  bool given = false;
  const auto slow = [&](std::span<char> into) -> std::size_t {
    if (given) return 0;
    other_taken.get_future().wait();
    given = true;
    into[0] = 'x';
    return 1;
  };
  auto taken = std::async(std::launch::async, [&] {
    return drives_.add_part(id_, {1, 1, slow}, {}).is_new;
  });
  EXPECT_TRUE(drives_.add_part(other, {1, 1, source_of("y")}, {}).is_new);
  EXPECT_TRUE(drives_.add_part(id_, {2, 1, source_of("z")}, {}).is_new);
  other_taken.set_value();
  EXPECT_TRUE(taken.get());
}

}  // namespace drive_store_test
}  // namespace stillmap::server
