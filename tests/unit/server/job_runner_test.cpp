#include <gmock/gmock.h>

#include <fcntl.h>
#include <sys/file.h>

#include <cstdlib>
#include <functional>
#include <latch>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <thread>

#include <stillmap/maps/map_package.hpp>

#include "job_fixture.hpp"
#include "jobs/housekeeping.hpp"
#include "store/store_upkeep.hpp"
#include "support/disk_calls.hpp"

namespace stillmap::server {
namespace job_runner_test {

using ::testing::HasSubstr;

/// Runs jobs without a service around it, and waits only a moment for room.
class JobsOfARunner : public JobTest {
 protected:
  void start_runner(PackageStore& store) {
    start();
    make_drive();
    service_.reset();
    catalog_.emplace(
        store, [this](const maps::MapPackage& package, const localization::LocalizationOptions&) {
          if (package.digest() != store_.digest() && on_load_) on_load_();
          return Aligners{{"default", aligner_}};
        });
    drives_.emplace(store);
    run_jobs(store);
  }
  void run_jobs(PackageStore& store) {
    const auto pause = std::chrono::milliseconds(1);
    jobs_.emplace(
        JobSetup{live_, store, *drives_, *catalog_, metrics_, mapper_, pause, silent_after_});
  }
  void ask_for_rebuild() {
    RebuildRequest request;
    request.drives = {1};
    request.version = "v2";
    request.activate = request.new_frame = true;
    static_cast<void>(jobs_->orders.rebuild("town", request, {}));
  }
  /// Another server has not heard of this one, and puts it back.
  void lose(std::int64_t job) {
    JobTable& jobs = jobs_->setup.store.jobs();
    while (true) {
      for (const JobTable::Beat& beat : jobs.beats())
        if (beat.claim.id == job && jobs.put_back_silent(beat, "lost", 1)) return;
    }
  }
  JobView end_of(std::int64_t job) {
    const auto latest = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (!is_finished(jobs_->live.view(job).job.status)) {
      if (std::chrono::steady_clock::now() > latest) throw std::runtime_error("the job has no end");
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return jobs_->live.view(job);
  }
  /// Runner and catalog have ended, too: they use the store, which a test may own.
  StoredJob end_of_rebuild() {
    ask_for_rebuild();
    const JobView end = end_of(1);
    outcome_ = end.outcome;
    jobs_.reset();
    drives_.reset();
    catalog_.reset();
    return end.job;
  }

  std::chrono::milliseconds silent_after_ = std::chrono::seconds(30);
  /// When the version that a job made is loaded.
  std::function<void()> on_load_;
  /// Of the job that has ended.
  std::string outcome_;
  OptionsHolder live_{options_};
  Metrics metrics_{"1"};
  std::optional<MapCatalog> catalog_;
  std::optional<DriveStore> drives_;
  std::optional<Jobs> jobs_;
};

/// Calls back when a package begins to come into the store.
class CallsWhenCopied : public test::UnsyncedCalls {
 public:
  explicit CallsWhenCopied(std::function<void()> begin) : begin_(std::move(begin)) {}
  std::int64_t pass(const DiskCall& call, const Perform& perform) override {
    if (call.kind == DiskCall::Kind::kCreateFile &&
        call.path.string().find("/.incoming-") != std::string::npos)
      begin_();
    return UnsyncedCalls::pass(call, perform);
  }

 private:
  std::function<void()> begin_;
};

TEST_F(JobsOfARunner, LeaveNoVersionWhenTheyAreCancelledWhileItIsCopied) {
  write_mapper("publish");
  CallsWhenCopied calls([&] { EXPECT_TRUE(jobs_->live.cancel(1).cancel_requested); });
  PackageStore store(store_.folder().path(), calls);
  start_runner(store);
  EXPECT_EQ(end_of_rebuild().status, JobStatus::kCanceled);
  EXPECT_FALSE(store.state().find_version("town", "v2"));
  EXPECT_TRUE(unnamed_packages(store).empty());
  EXPECT_EQ(store.state().map("town").active, store_.version());
  expect_cleared(1);
}

TEST_F(JobsOfARunner, CannotBeCancelledOnceTheirVersionIsThere) {
  write_mapper("publish");
  bool refused = false;
  on_load_ = [&] {
    try {
      jobs_->live.cancel(1);
    } catch (const StoreRefusal& refusal) {
      refused = refusal.reason() == StoreRefusal::Reason::kJobFinished;
    }
  };
  start_runner(store_.open());
  EXPECT_EQ(end_of_rebuild().status, JobStatus::kSucceeded);
  EXPECT_TRUE(refused);
  EXPECT_EQ(store_.open().state().map("town").active, "v2");
}

/// As after a server died of it.
TEST_F(JobsOfARunner, SucceedWithoutActivationWhenOnlyThatFails) {
  write_mapper("if [ -e $out ]; then kill -SEGV $$; fi; publish");
  on_load_ = [&] {
    lose(1);
    throw std::runtime_error("too large");
  };
  start_runner(store_.open());
  const StoredJob job = end_of_rebuild();
  EXPECT_EQ(job.status, JobStatus::kSucceeded) << job.error;
  EXPECT_THAT(outcome_, HasSubstr("signal 11"));
  EXPECT_EQ(job.result_version, "v2");
}

/// However often it publishes.
TEST_F(JobsOfARunner, ActivateOnce) {
  write_mapper("if [ -e $out ]; then while [ ! -e $0.go ]; do sleep 0.01; done; else publish; fi");
  on_load_ = [&] { lose(1); };
  start_runner(store_.open());
  ask_for_rebuild();
  const StoreState& state = store_.open().state();
  while (state.jobs().job(1).attempts < 2)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_EQ(state.map("town").active, "v2");
  store_.open().roll_back("town");
  std::ofstream(mapper_.string() + ".go") << "x";
  const JobView end = end_of(1);
  EXPECT_EQ(end.job.status, JobStatus::kSucceeded) << end.job.error;
  EXPECT_THAT(end.outcome, HasSubstr("\"activated\":false"));
  EXPECT_THAT(end.outcome, HasSubstr("another version"));
  EXPECT_EQ(state.map("town").active, store_.version());
}

/// As one that ends its server each time.
TEST_F(JobsOfARunner, FailWhenTheirServerEndsAgainAndAgain) {
  silent_after_ = std::chrono::milliseconds(60);
  write_mapper("touch $0.runs; sleep 60");
  start_runner(store_.open());
  ask_for_rebuild();
  for (int death = 1; death <= 3; ++death) {
    while (!std::filesystem::remove(mapper_.string() + ".runs"))
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    lose(1);
  }
  const StoredJob end = end_of(1).job;
  EXPECT_EQ(end.status, JobStatus::kFailed);
  EXPECT_THAT(end.error, HasSubstr("lost, 3 times: ask again with less at a time"));
  EXPECT_EQ(end.attempts, 4) << "the last one only says so";
  EXPECT_FALSE(std::filesystem::exists(mapper_.string() + ".runs"));
}

TEST_F(JobsOfARunner, DoNotCountServersThatEndInOrder) {
  write_mapper("touch $0.runs; while [ ! -e $0.go ]; do sleep 0.01; done; publish");
  start_runner(store_.open());
  ask_for_rebuild();
  for (int stop = 1; stop <= 4; ++stop) {
    while (!std::filesystem::remove(mapper_.string() + ".runs"))
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    jobs_.reset();
    run_jobs(store_.open());
  }
  std::ofstream(mapper_.string() + ".go") << "x";
  const StoredJob end = end_of(1).job;
  EXPECT_EQ(end.status, JobStatus::kSucceeded) << end.error;
  EXPECT_EQ(end.crashes, 0);
}

TEST_F(JobsOfARunner, AreCancelledWithinASecondByAnotherServer) {
  write_mapper("touch $0.runs; sleep 60");
  start_runner(store_.open());
  ask_for_rebuild();
  while (!std::filesystem::exists(mapper_.string() + ".runs"))
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_TRUE(store_.open().jobs().request_cancel(1, 2).cancel_requested);
  EXPECT_EQ(end_of(1).job.status, JobStatus::kCanceled);
}

/// One that was lost and taken back by the same server.
TEST_F(JobsOfARunner, HaveOneAttemptAtATimeInTheirFolder) {
  options_.jobs.concurrent = 2;
  live_.replace(options_);
  silent_after_ = std::chrono::seconds(3);
  // It needs a moment to end.
  write_mapper(
      "trap 'sleep 0.3; rmdir $work/here; exit 130' TERM; mkdir $work/here || touch $0.two;"
      "echo x >> $0.runs; while [ ! -e $0.go ]; do sleep 0.01; done; publish");
  start_runner(store_.open());
  ask_for_rebuild();
  const std::filesystem::path runs = mapper_.string() + ".runs";
  const auto wait_runs = [&](std::uintmax_t times) {
    std::error_code error;
    while (std::filesystem::file_size(runs, error) != 2 * times || error)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
  };
  wait_runs(1);
  lose(1);
  wait_runs(2);
  EXPECT_FALSE(std::filesystem::exists(mapper_.string() + ".two"));
  // It says that it works on it.
  JobTable& jobs = store_.open().jobs();
  const JobTable::Beat now = jobs.beats().at(0);
  EXPECT_EQ(now.claim.attempt, 2);
  while (jobs.beats().at(0) == now) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  std::ofstream(mapper_.string() + ".go") << "x";
  const StoredJob end = end_of(1).job;
  EXPECT_EQ(end.status, JobStatus::kSucceeded) << end.error;
  EXPECT_EQ(end.attempts, 2);
}

TEST_F(JobsOfARunner, LeaveAloneWhatIsBeingReceivedWhenTheyAreTakenFromAnotherServer) {
  const std::filesystem::path root = store_.folder().path() / "jobs";
  const std::filesystem::path left = root / "uploads" / ".incoming-1-0";
  std::filesystem::create_directories(root / "uploads");
  std::ofstream(left) << "half";
  Descriptor lock(::open((root / ".lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0640));
  ASSERT_EQ(::flock(lock.get(), LOCK_EX | LOCK_NB), 0);
  write_mapper("publish");
  start_runner(store_.open());
  const std::string bytes = kPly;
  const std::string sha256 = jobs_->uploads.receive(
      [&, sent = std::size_t{0}](std::span<char> to) mutable {
        const std::size_t count =
            std::string_view(bytes).substr(sent, 9).copy(to.data(), to.size());
        if (sent > 0) lock = {};
        const auto latest = std::chrono::steady_clock::now() + std::chrono::seconds(60);
        while (sent > 0 && std::filesystem::exists(left) &&
               std::chrono::steady_clock::now() < latest)
          std::this_thread::sleep_for(std::chrono::milliseconds(5));
        sent += count;
        return count;
      },
      bytes.size(), std::nullopt, "town/v2");
  EXPECT_FALSE(std::filesystem::exists(left));
  EXPECT_EQ(std::filesystem::file_size(root / "uploads" / sha256), bytes.size());
}

class JobsInACluster : public JobsOfARunner {
 protected:
  JobsInACluster() {
    options_.jobs.executor = "slurm";
    options_.jobs.slurm_units = 3;
    options_.jobs.slurm_options = "--partition=long  --time=9";
    options_.jobs.cores = 2;
    live_.replace(options_);
  }

  /// Whether a mapper is asked to end when the server stops.
  bool is_asked_to_end() {
    const std::filesystem::path asked = scripts_.path() / "asked";
    const std::filesystem::path runs = scripts_.path() / "runs";
    write_mapper("trap 'touch " + asked.string() + "; exit 130' TERM; touch " + runs.string() +
                 "; while :; do sleep 0.01; done");
    start_runner(store_.open());
    ask_for_rebuild();
    const auto latest = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (!std::filesystem::exists(runs) && std::chrono::steady_clock::now() < latest)
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_TRUE(std::filesystem::exists(runs));
    jobs_.reset();
    EXPECT_EQ(store_.open().jobs().job(1).status, JobStatus::kEnqueued);
    return std::filesystem::exists(asked);
  }
};

TEST_F(JobsInACluster, AreFollowedWithItsOptions) {
  const std::filesystem::path words = scripts_.path() / "words";
  write_mapper("tr '\\0' ' ' < /proc/$$/cmdline > " + words.string() + "; publish");
  start_runner(store_.open());
  EXPECT_EQ(end_of_rebuild().status, JobStatus::kSucceeded);
  std::ifstream stream(words);
  const std::string text{std::istreambuf_iterator<char>(stream), {}};
  EXPECT_THAT(text, HasSubstr(" --threads 2 --executor slurm --units 3 "
                              "--slurm-option=--partition=long --slurm-option=--time=9 "));
}

/// Else they would go on beside those of the next attempt.
TEST_F(JobsInACluster, AreEndedWhenTheJobIsLost) {
  const std::filesystem::path asked = scripts_.path() / "asked";
  silent_after_ = std::chrono::milliseconds(60);
  write_mapper("[ ! -e " + asked.string() + " ] || { publish; exit 0; }; trap 'touch " +
               asked.string() + "; exit 130' TERM; touch $0.runs; while :; do sleep 0.01; done");
  start_runner(store_.open());
  ask_for_rebuild();
  while (!std::filesystem::exists(mapper_.string() + ".runs"))
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  lose(1);
  EXPECT_EQ(end_of(1).job.status, JobStatus::kSucceeded);
  EXPECT_TRUE(std::filesystem::exists(asked));
}

/// By a server that was away when its job was cancelled.
TEST_F(JobsInACluster, AreCancelledBeforeTheirFolderIsCleared) {
  const std::filesystem::path bin = scripts_.path() / "bin";
  const std::filesystem::path said = scripts_.path() / "said";
  std::filesystem::create_directory(bin);
  const auto scancel = [&](int code) {
    std::ofstream(bin / "scancel")
        << "#!/bin/sh\necho \"$@\" >> " << said.string() << "; exit " << code << "\n";
    std::filesystem::permissions(bin / "scancel", std::filesystem::perms::owner_all);
  };
  const std::string path = std::getenv("PATH");
  ::setenv("PATH", (bin.string() + ":" + path).c_str(), 1);
  write_mapper("publish");
  start_runner(store_.open());
  jobs_.reset();
  JobTable& jobs = store_.open().jobs();
  jobs.enqueue({.map = "town", .request = "{}"}, 1);
  jobs.request_cancel(1, 2);
  const std::filesystem::path slurm = job_folder(1) / "scratch" / "work" / ".town.slurm";
  std::filesystem::create_directories(slurm);
  std::ofstream(slurm / "plan") << "1\n/a\n/b\nbuild\n";
  scancel(1);
  run_jobs(store_.open());
  while (!std::filesystem::exists(said)) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  jobs_.reset();
  EXPECT_TRUE(std::filesystem::exists(slurm / "plan")) << "it is tried again";
  std::filesystem::remove(said);
  scancel(0);
  run_jobs(store_.open());
  expect_cleared(1);
  ::setenv("PATH", path.c_str(), 1);
  std::ifstream stream(said);
  std::string line;
  std::getline(stream, line);
  EXPECT_EQ(line, "--name=stillmap-" + maps::sha256_of("1\n/a\n/b\nbuild\n").substr(0, 12));
}

TEST_F(JobsInACluster, GoOnWhenTheServerStops) { EXPECT_FALSE(is_asked_to_end()); }

TEST_F(JobsInACluster, AreEndedWithTheServerWhereTheyAreProcesses) {
  options_.jobs.executor = "process";
  live_.replace(options_);
  EXPECT_TRUE(is_asked_to_end());
}

class JobsOnAFullDisk : public JobsOfARunner {};

TEST_F(JobsOnAFullDisk, AreMappedWhenThereIsRoom) {
  write_mapper(kMeetsAFullDisk);
  start_runner(store_.open());
  const StoredJob job = end_of_rebuild();
  EXPECT_EQ(job.status, JobStatus::kSucceeded) << job.error;
  EXPECT_EQ(job.attempts, 5) << "more than after crashes";
}

TEST_F(JobsOnAFullDisk, FailWhenNoRoomComesAndGiveBackWhatTheyTook) {
  write_mapper("touch $work/large; echo 'stillmap: /x: No space left on device' >&2; exit 3");
  start_runner(store_.open());
  const StoredJob job = end_of_rebuild();
  EXPECT_EQ(job.status, JobStatus::kFailed);
  EXPECT_THAT(job.error, HasSubstr("No space left on device, 6 times"));
  EXPECT_EQ(job.attempts, 6);
  expect_cleared(1);
}

TEST_F(JobsOnAFullDisk, ArePublishedWhenThereIsRoom) {
  write_mapper("[ -e $out ] || publish");
  int fails = 4;
  test::FailingCalls full(test::Fault::kNoSpace, [&](std::size_t, const DiskCall& call) {
    return call.kind == DiskCall::Kind::kMakeFolder &&
           call.path.string().find("/.incoming-") != std::string::npos && fails-- > 0;
  });
  PackageStore store(store_.folder().path(), full);
  start_runner(store);
  const StoredJob job = end_of_rebuild();
  EXPECT_EQ(job.status, JobStatus::kSucceeded) << job.error;
  EXPECT_EQ(job.attempts, 5);
}

TEST_F(JobsOfARunner, BelongToOneServerOfTheStoreWhereverEachOneWorks) {
  const std::filesystem::path root = store_.folder().path() / "jobs";
  std::filesystem::create_directories(root);
  ServerOptions elsewhere = options_;
  elsewhere.jobs.work_dir = scripts_.path() / "elsewhere";
  live_.replace(elsewhere);
  write_mapper("publish");
  start_runner(store_.open());
  jobs_.reset();
  Descriptor lock(::open((root / ".lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0640));
  ASSERT_EQ(::flock(lock.get(), LOCK_EX | LOCK_NB), 0);
  run_jobs(store_.open());
  ask_for_rebuild();
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_EQ(jobs_->live.view(1).job.status, JobStatus::kEnqueued);
  lock = {};
  EXPECT_EQ(end_of(1).job.status, JobStatus::kSucceeded);
}

TEST_F(JobsOfARunner, AreTakenOverOnceFromWhoeverIsSilent) {
  silent_after_ = std::chrono::milliseconds(300);
  write_mapper("echo x >> $0.runs; while [ ! -e $0.go ]; do sleep 0.01; done; publish");
  start_runner(store_.open());
  ask_for_rebuild();
  const std::string runs = mapper_.string() + ".runs";
  while (!std::filesystem::exists(runs)) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  // Another server that has heard nothing of this one takes the job, and falls silent itself.
  JobTable& jobs = store_.open().jobs();
  lose(1);
  std::optional<StoredJob> theirs;
  while (!theirs) theirs = jobs.claim(2, "other");
  EXPECT_EQ(theirs->attempts, 2);
  while (jobs.job(1).attempts == 2) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  std::ofstream(mapper_.string() + ".go") << "x";
  const StoredJob end = end_of(1).job;
  EXPECT_EQ(end.status, JobStatus::kSucceeded);
  EXPECT_EQ(end.attempts, 3);
  EXPECT_EQ(std::filesystem::file_size(runs), 4U) << "the mapper ran twice here";
}

TEST_F(JobsOfARunner, GoOnBehindOneThatAnotherServerHasEnded) {
  write_mapper(
      "case $out in */1/*) touch $0.runs; while [ ! -e $0.go ]; do sleep 0.01; done;; esac; "
      "publish");
  start_runner(store_.open());
  ask_for_rebuild();
  while (!std::filesystem::exists(mapper_.string() + ".runs"))
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  auto& jobs = store_.open().jobs();
  jobs.fail(jobs.job(1), "by another server", 1);
  std::ofstream(mapper_.string() + ".go") << "x";
  ask_for_rebuild();
  EXPECT_EQ(end_of(2).job.status, JobStatus::kSucceeded);
  EXPECT_EQ(jobs_->live.view(1).job.error, "by another server");
  EXPECT_EQ(jobs_->live.events(1), nullptr);
}

TEST_F(JobsOfARunner, WhoIsNotWaitedForWhileAMapIsLoadedHasNotCrashed) {
  write_mapper("publish");
  std::latch loading(1);
  std::latch loaded(1);
  on_load_ = [&] {
    loading.count_down();
    loaded.wait();
  };
  start_runner(store_.open());
  ask_for_rebuild();
  loading.wait();
  std::thread end([&] { jobs_.reset(); });
  JobTable& jobs = store_.open().jobs();
  // It is the last that the server says of it.
  const auto latest = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (jobs.beats().at(0).beats >= 0 && std::chrono::steady_clock::now() < latest)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_LT(jobs.beats().at(0).beats, 0);
  loaded.count_down();
  end.join();
}

/// A drive of which only a job tells that it was used later than it came.
TEST_F(JobsOfARunner, TellWhenADriveWasUsedAsLongAsItIsThere) {
  write_mapper("publish");
  start_runner(store_.open());
  jobs_.reset();
  JobTable& jobs = store_.open().jobs();
  const std::int64_t came_ns = store_.open().drives().drive(1).created_ns;
  const auto day = [&](int days) { return came_ns + days * std::int64_t{86'400'000'000'000}; };
  jobs.enqueue({.map = "town", .request = "{}", .drives = {1}}, day(70));
  jobs.claim(day(70));
  jobs.fail(jobs.job(1), "x", day(80));
  run_jobs(store_.open());
  const RetentionOptions retention{
      .versions = 0, .job_days = 30, .audit_days = 0, .drive_days = 90};
  for (const int days : {111, 112, 169}) {
    keep_house(retention, store_.open(), *drives_, jobs_->folders, day(days));
    EXPECT_EQ(store_.open().drives().all().size(), 1U) << days;
  }
  keep_house(retention, store_.open(), *drives_, jobs_->folders, day(171));
  EXPECT_TRUE(store_.open().drives().all().empty());
  EXPECT_TRUE(jobs.list({}, 1).jobs.empty());
}

}  // namespace job_runner_test
}  // namespace stillmap::server
