#include "store/store_state.hpp"

#include <algorithm>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "support/disk_calls.hpp"
#include "support/states.hpp"
#include "support/store_refusals.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace job_table_test {

using ::stillmap::test::expect_refused;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using ::stillmap::test::UnsyncedCalls;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using Reason = StoreRefusal::Reason;

class JobTableTest : public ::testing::Test {
 protected:
  JobTableTest() {
    state_.create_map("town", 1);
    state_.create_map("depot", 1);
  }
  std::int64_t enqueue(const std::string& request = "{}", const std::string& map = "town") {
    return jobs_.enqueue({.map = map, .request = request}, ++now_).job.id;
  }
  [[nodiscard]] std::vector<std::int64_t> ids(const JobTable::Filter& filter,
                                              std::size_t limit = 10,
                                              std::optional<std::int64_t> before = {}) {
    std::vector<std::int64_t> ids;
    for (const StoredJob& job : jobs_.list(filter, limit, before).jobs) ids.push_back(job.id);
    return ids;
  }

  TemporaryFolder folder_;
  UnsyncedCalls unsynced_;
  std::filesystem::path file_ = folder_.path() / "state.db";
  StoreState state_ = test::state_at(file_, unsynced_);
  JobTable& jobs_ = state_.jobs();
  std::int64_t now_ = 100;
};

TEST_F(JobTableTest, TakesAJobFromTheQueueToItsEnd) {
  const StoredJob asked =
      jobs_
          .enqueue(
              {.kind = JobKind::kConvert, .map = "town", .request = "{\"a\": 1}", .asker = "k"}, 5)
          .job;
  EXPECT_EQ(asked.status, JobStatus::kEnqueued);
  EXPECT_EQ(asked.kind, JobKind::kConvert);
  EXPECT_EQ(asked.request, "{\"a\": 1}");
  const std::optional<StoredJob> claimed = jobs_.claim(6);
  ASSERT_TRUE(claimed);
  EXPECT_EQ(claimed->id, asked.id);
  EXPECT_EQ(claimed->status, JobStatus::kProcessing);
  EXPECT_EQ(claimed->attempts, 1);
  EXPECT_EQ(claimed->started_ns, 6);
  EXPECT_FALSE(jobs_.claim(6));
  jobs_.set_stage(*claimed, "odometry");
  EXPECT_EQ(jobs_.job(asked.id).stage, "odometry");
  const StoredJob done = jobs_.succeed(*claimed, "v2", 9);
  EXPECT_EQ(done.status, JobStatus::kSucceeded);
  EXPECT_EQ(done.result_version, "v2");
  EXPECT_EQ(done.finished_ns, 9);
  const StoreState reopened = test::state_at(file_, unsynced_);
  EXPECT_EQ(jobs_.job(asked.id), done);
}

TEST_F(JobTableTest, GivesTheOldestFirst) {
  const std::int64_t first = enqueue(), second = enqueue(), third = enqueue();
  EXPECT_EQ(jobs_.claim(now_)->id, first);
  EXPECT_EQ(jobs_.claim(now_)->id, second);
  jobs_.put_back(jobs_.job(first), "the mapper was killed", now_);
  EXPECT_EQ(jobs_.claim(now_)->id, first);
  EXPECT_EQ(jobs_.claim(now_)->id, third);
}

TEST_F(JobTableTest, GivesEachJobToOneCallerOnly) {
  for (int i = 0; i < 40; ++i) enqueue();
  StoreState other = test::state_at(file_, unsynced_);
  std::mutex mutex;
  std::vector<std::int64_t> claimed;
  std::vector<std::thread> threads;
  for (JobTable* table : {&jobs_, &jobs_, &other.jobs(), &other.jobs()})
    threads.emplace_back([&, table] {
      while (const std::optional<StoredJob> job = table->claim(1)) {
        const std::scoped_lock lock(mutex);
        claimed.push_back(job->id);
      }
    });
  for (std::thread& thread : threads) thread.join();
  std::sort(claimed.begin(), claimed.end());
  EXPECT_EQ(claimed.size(), 40U);
  EXPECT_EQ(std::unique(claimed.begin(), claimed.end()), claimed.end());
}

TEST_F(JobTableTest, GivesJobsOnlyToAServerThatHasTheirFiles) {
  const auto drive_at = [&](const std::string& server) {
    const std::int64_t id = state_.drives().open("town", "monday", 1, server).id;
    state_.drives().add_part(id, {1, std::string(64, 'a'), 10});
    return state_.drives().complete(id, 1).id;
  };
  const std::int64_t at_a = drive_at("a"), at_b = drive_at("b"), of_older_program = drive_at("");
  EXPECT_EQ(state_.drives().drive(at_a).files_at, "a");
  const auto ask = [&](const std::vector<std::int64_t>& drives) {
    return jobs_.enqueue({.map = "town", .request = "{}", .drives = drives}, 1).job;
  };
  expect_refused(Reason::kOtherServer, [&] { ask({at_a, at_b}); });
  const StoredJob first = ask({of_older_program, at_a});
  EXPECT_EQ(first.files_at, "a");
  const StoredJob file =
      jobs_.enqueue({.kind = JobKind::kConvert, .map = "town", .files_at = "b"}, 1).job;
  const StoredJob anywhere = ask({of_older_program});
  EXPECT_EQ(anywhere.files_at, "");
  const StoredJob second = ask({at_a});
  EXPECT_EQ(jobs_.claim(2, "b", {"b", "drives of b"})->id, file.id);
  const StoredJob claimed = jobs_.claim(2, "b", {"b"}).value();
  EXPECT_EQ(claimed.id, anywhere.id);
  EXPECT_EQ(claimed.server, "b");
  EXPECT_EQ(jobs_.job(anywhere.id), claimed);
  EXPECT_FALSE(jobs_.claim(2, "b", {"b"}));
  EXPECT_EQ(jobs_.claim(2, "a", {"a"})->id, first.id);
  EXPECT_EQ(jobs_.claim(2)->id, second.id) << "where the state is not shared, all files are here";
}

TEST_F(JobTableTest, EndsOnlyWhatIsProcessing) {
  const std::int64_t id = enqueue();
  expect_refused(Reason::kNotProcessing, [&] { jobs_.succeed(jobs_.job(id), "v", 1); });
  expect_refused(Reason::kNotProcessing, [&] { jobs_.fail(jobs_.job(id), "x", 1); });
  expect_refused(Reason::kNotProcessing, [&] { jobs_.set_stage(jobs_.job(id), "x"); });
  expect_refused(Reason::kUnknownJob, [&] { jobs_.fail(StoredJob{.id = id + 1}, "x", 1); });
  expect_refused(Reason::kUnknownJob, [&] { (void)jobs_.job(id + 1); });
  expect_refused(Reason::kUnknownMap, [&] { enqueue("{}", "nowhere"); });
  jobs_.claim(1);
  EXPECT_EQ(jobs_.fail(jobs_.job(id), "out of memory", 7).error, "out of memory");
  expect_refused(Reason::kNotProcessing, [&] { jobs_.succeed(jobs_.job(id), "v", 8); });
  expect_refused(Reason::kNotProcessing, [&] { jobs_.put_back(jobs_.job(id), "again", 8); });
  expect_refused(Reason::kJobFinished, [&] { jobs_.request_cancel(id, 8); });
}

TEST_F(JobTableTest, CancelsAWaitingJobAtOnceAndAsksARunningOneToEnd) {
  const std::int64_t running = enqueue(), waiting = enqueue();
  jobs_.claim(1);
  EXPECT_EQ(jobs_.request_cancel(waiting, 2).status, JobStatus::kCanceled);
  EXPECT_EQ(jobs_.request_cancel(waiting, 3).finished_ns, 2) << "twice is once";
  EXPECT_FALSE(jobs_.claim(3));
  const StoredJob asked = jobs_.request_cancel(running, 4);
  EXPECT_EQ(asked.status, JobStatus::kProcessing);
  EXPECT_TRUE(asked.cancel_requested);
  const StoredJob ended = jobs_.end_canceled(jobs_.job(running), 5);
  EXPECT_EQ(ended.status, JobStatus::kCanceled);
  EXPECT_FALSE(ended.cancel_requested);
}

TEST_F(JobTableTest, IsPublishedOrCanceledAndNeverBoth) {
  const std::int64_t canceled = enqueue(), published = enqueue();
  const StoredVersion version{.name = "v2", .digest = std::string(64, 'a')};
  expect_refused(Reason::kNotProcessing,
                 [&] { state_.add_version("town", version, {}, jobs_.job(canceled)); });
  jobs_.claim(1);
  jobs_.claim(1);
  jobs_.request_cancel(canceled, 2);
  expect_refused(Reason::kNotProcessing,
                 [&] { state_.add_version("town", version, {}, jobs_.job(canceled)); });
  EXPECT_FALSE(state_.find_version("town", "v2"));
  EXPECT_TRUE(state_.add_version("town", version, {}, jobs_.job(published)));
  EXPECT_EQ(jobs_.job(published).result_version, "v2");
  expect_refused(Reason::kJobFinished, [&] { jobs_.request_cancel(published, 3); });
  // Nor when the server dies before it has ended.
  jobs_.put_back_all("the server ended", 4);
  EXPECT_EQ(jobs_.job(published).status, JobStatus::kEnqueued);
  EXPECT_EQ(jobs_.job(canceled).status, JobStatus::kCanceled);
  expect_refused(Reason::kJobFinished, [&] { jobs_.request_cancel(published, 5); });
  jobs_.claim(6);
  EXPECT_FALSE(state_.add_version("town", version, {}, jobs_.job(published))) << "twice is once";
}

TEST_F(JobTableTest, OnlyTheLatestAttemptCounts) {
  const std::int64_t id = enqueue();
  const StoredJob first = jobs_.claim(1, "a").value();
  EXPECT_TRUE(jobs_.beat(first));
  // Another server looks, and looks again later.
  const std::vector<JobTable::Beat> seen = jobs_.beats();
  ASSERT_EQ(seen.size(), 1U);
  EXPECT_EQ(seen[0].beats, 1);
  EXPECT_TRUE(jobs_.beat(first));
  EXPECT_FALSE(jobs_.put_back_silent(seen[0], "silent", 2)) << "it has said something since";
  const JobTable::Beat silent = jobs_.beats().at(0);
  EXPECT_TRUE(jobs_.put_back_silent(silent, "silent", 3));
  EXPECT_FALSE(jobs_.put_back_silent(silent, "silent", 3)) << "taken over once";
  EXPECT_EQ(jobs_.job(id).error, "silent");

  EXPECT_FALSE(jobs_.beat(first));
  const StoredJob second = jobs_.claim(4, "b").value();
  EXPECT_EQ(second.attempts, 2);
  EXPECT_FALSE(jobs_.beat(first));
  const StoredVersion version{.name = "v2", .digest = std::string(64, 'a')};
  expect_refused(Reason::kNotProcessing, [&] { state_.add_version("town", version, {}, first); });
  for (const auto& change : std::vector<std::function<void()>>{
           [&] { jobs_.set_stage(first, "fusion"); }, [&] { jobs_.succeed(first, "v2", 5); },
           [&] { jobs_.fail(first, "x", 5); }, [&] { jobs_.end_canceled(first, 5); },
           [&] { jobs_.put_back(first, "x", 5); }})
    expect_refused(Reason::kNotProcessing, change);
  EXPECT_EQ(jobs_.put_back_all("ended", 6, "a"), 0U) << "that of another server goes on";
  EXPECT_TRUE(state_.add_version("town", version, {}, second));
  EXPECT_EQ(jobs_.succeed(second, "v2", 7).status, JobStatus::kSucceeded);
  EXPECT_TRUE(jobs_.beats().empty());
}

TEST_F(JobTableTest, PutsBackWhatARestartInterrupted) {
  const std::int64_t canceled = enqueue(), resumed = enqueue(), waiting = enqueue();
  jobs_.claim(1);
  jobs_.claim(1);
  jobs_.request_cancel(canceled, 2);
  EXPECT_EQ(jobs_.put_back_all("the server was stopped", 3), 2U);
  EXPECT_EQ(jobs_.job(canceled).status, JobStatus::kCanceled);
  EXPECT_EQ(jobs_.job(resumed).status, JobStatus::kEnqueued);
  EXPECT_EQ(jobs_.job(resumed).error, "the server was stopped");
  const StoredJob again = jobs_.claim(4).value();
  EXPECT_EQ(again.id, resumed);
  EXPECT_EQ(again.attempts, 2);
  EXPECT_EQ(again.crashes, 1);
  EXPECT_EQ(jobs_.succeed(jobs_.job(resumed), "v", 5).error, "");
  EXPECT_EQ(jobs_.claim(6)->id, waiting);
}

TEST_F(JobTableTest, CountsAttemptsThatCrashedOrWereLostWithTheirServer) {
  const std::int64_t id = enqueue();
  const auto crashes = [&] { return jobs_.job(id).crashes; };
  jobs_.put_back(jobs_.claim(1, "a").value(), "the server was stopped", 2);
  EXPECT_EQ(crashes(), 0);
  jobs_.put_back(jobs_.claim(1, "a").value(), "signal 11", 2, JobTable::Crashed::kYes);
  EXPECT_EQ(crashes(), 1);
  jobs_.claim(1, "a");
  jobs_.put_back_all("its server ended", 2, "a");
  EXPECT_EQ(crashes(), 2);
  jobs_.claim(1, "a");
  EXPECT_TRUE(jobs_.put_back_silent(jobs_.beats().at(0), "silent", 2));
  EXPECT_EQ(crashes(), 3);
  // Of a server that ended in order nothing counts.
  for (const bool at_its_next_start : {true, false}) {
    const StoredJob claimed = jobs_.claim(1, "a").value();
    jobs_.excuse(claimed);
    if (at_its_next_start) {
      EXPECT_EQ(jobs_.put_back_all("its server ended", 2, "a"), 1U);
    } else {
      EXPECT_TRUE(jobs_.put_back_silent(jobs_.beats().at(0), "silent", 2));
    }
    EXPECT_EQ(crashes(), 3);
    expect_refused(Reason::kNotProcessing, [&] { jobs_.excuse(claimed); });
  }
}

TEST_F(JobTableTest, TellsHowFarAJobIsAndWhatItCameTo) {
  const std::int64_t id = enqueue();
  const StoredJob first = jobs_.claim(1).value();
  EXPECT_TRUE(jobs_.beat(first, {.fraction = 0.25, .eta_s = 7.5}));
  EXPECT_EQ(jobs_.job(id).advance, (JobAdvance{.fraction = 0.25, .eta_s = 7.5}));
  EXPECT_TRUE(jobs_.beat(first, {.fraction = 0.5}));
  EXPECT_EQ(jobs_.job(id).advance.eta_s, std::nullopt);
  jobs_.put_back(first, "x", 2);
  const StoredJob second = jobs_.claim(3).value();
  EXPECT_EQ(second.advance.fraction, 0.0);
  EXPECT_EQ(jobs_.job(id), second);
  const StoredJob done = jobs_.succeed(second, "v2", 4, R"({"version": "v2"})");
  EXPECT_EQ(done.outcome, R"({"version": "v2"})");
  EXPECT_EQ(jobs_.job(id), done);
}

TEST_F(JobTableTest, KeepsTheRevisionAtWhichAJobMayActivate) {
  enqueue();
  const StoredJob first = jobs_.claim(1).value();
  EXPECT_EQ(jobs_.activates_at(first, 5), 5);
  EXPECT_EQ(jobs_.activates_at(first, 6), 5);
  jobs_.put_back(first, "x", 2);
  expect_refused(Reason::kNotProcessing, [&] { jobs_.activates_at(first, 7); });
  EXPECT_EQ(jobs_.activates_at(jobs_.claim(3).value(), 7), 5) << "that of the first attempt";
}

TEST_F(JobTableTest, SaysWhichJobsAreToEnd) {
  const std::int64_t running = enqueue(), other = enqueue();
  jobs_.claim(1);
  jobs_.claim(1);
  EXPECT_THAT(jobs_.cancel_requests(), IsEmpty());
  jobs_.request_cancel(running, 2);
  EXPECT_THAT(jobs_.cancel_requests(), ElementsAre(running));
  jobs_.end_canceled(jobs_.job(running), 3);
  jobs_.request_cancel(other, 4);
  EXPECT_THAT(jobs_.cancel_requests(), ElementsAre(other));
}

TEST_F(JobTableTest, TakesTheSameRequestOnce) {
  const NewJob job{.map = "town", .request = "{}", .asker = "a", .idempotency_key = "night 3"};
  const JobTable::Enqueued first = jobs_.enqueue(job, 1);
  EXPECT_TRUE(first.is_new);
  jobs_.claim(2);
  const JobTable::Enqueued again = jobs_.enqueue(job, 3);
  EXPECT_FALSE(again.is_new);
  EXPECT_EQ(again.job.id, first.job.id);
  EXPECT_EQ(again.job.status, JobStatus::kProcessing);
  NewJob other = job;
  other.request = "{\"x\": 1}";
  expect_refused(Reason::kOtherRequest, [&] { jobs_.enqueue(other, 4); });
  other = job;
  other.map = "depot";
  expect_refused(Reason::kOtherRequest, [&] { jobs_.enqueue(other, 4); });
  other = job;
  other.kind = JobKind::kConvert;
  expect_refused(Reason::kOtherRequest, [&] { jobs_.enqueue(other, 4); });
  other = job;
  other.asker = "b";
  EXPECT_TRUE(jobs_.enqueue(other, 5).is_new) << "keys are of their asker";
  other.idempotency_key = {};
  EXPECT_TRUE(jobs_.enqueue(other, 6).is_new);
  EXPECT_TRUE(jobs_.enqueue(other, 7).is_new);
}

TEST_F(JobTableTest, ListsNewestFirstInPages) {
  const std::int64_t a = enqueue(), b = enqueue("{}", "depot"), c = enqueue(), d = enqueue();
  EXPECT_THAT(ids({}), ElementsAre(d, c, b, a));
  EXPECT_THAT(ids({.map = "town"}), ElementsAre(d, c, a));
  jobs_.claim(1);
  EXPECT_THAT(ids({.status = JobStatus::kEnqueued, .map = "town"}), ElementsAre(d, c));
  EXPECT_EQ(jobs_.count(JobStatus::kEnqueued), 3U);
  const JobTable::Page page = jobs_.list({}, 3);
  EXPECT_EQ(page.next, b);
  EXPECT_THAT(ids({}, 3, page.next), ElementsAre(a));
  EXPECT_FALSE(jobs_.list({}, 4).next);
  EXPECT_THAT([&] { (void)jobs_.list({}, 0); }, ThrowsSaying<std::invalid_argument>({"limit: 0"}));
  EXPECT_THAT([&] { (void)jobs_.list({}, 1001); }, ThrowsSaying<std::invalid_argument>({"1001"}));
}

TEST_F(JobTableTest, EndsAPageWhereItsRequestsAreLong) {
  std::vector<std::int64_t> newest_first;
  for (int i = 0; i < 7; ++i)
    newest_first.insert(newest_first.begin(), enqueue(std::string(std::size_t{3} << 20U, 'x')));
  std::vector<std::int64_t> found;
  std::optional<std::int64_t> before;
  do {
    const JobTable::Page page = jobs_.list({}, 1000, before);
    EXPECT_LE(page.jobs.size(), 2U);
    for (const StoredJob& job : page.jobs) found.push_back(job.id);
    before = page.next;
  } while (before);
  EXPECT_EQ(found, newest_first);
}

TEST_F(JobTableTest, KnowsAllThatHaveNotEnded) {
  const std::int64_t done = enqueue(), processing = enqueue(), waiting = enqueue();
  jobs_.claim(1);
  jobs_.fail(jobs_.job(done), "x", 2);
  jobs_.claim(3);
  std::vector<std::int64_t> found;
  for (const StoredJob& job : jobs_.unfinished()) found.push_back(job.id);
  EXPECT_THAT(found, ElementsAre(waiting, processing));
}

TEST_F(JobTableTest, ForgetsOnlyWhatFinishedLongAgo) {
  const NewJob named{.map = "town", .request = "{}", .idempotency_key = "once"};
  const std::int64_t old = jobs_.enqueue(named, 1).job.id;
  const std::int64_t recent = enqueue(), waiting = enqueue();
  jobs_.claim(1);
  jobs_.claim(1);
  jobs_.fail(jobs_.job(old), "x", 10);
  jobs_.fail(jobs_.job(recent), "x", 20);
  EXPECT_EQ(jobs_.forget_finished_before(20, 100), 1U);
  EXPECT_THAT(ids({}), ElementsAre(waiting, recent));
  const JobTable::Enqueued again = jobs_.enqueue(named, 30);
  EXPECT_TRUE(again.is_new);
  EXPECT_GT(again.job.id, waiting) << "an id is never given twice";
}

TEST_F(JobTableTest, ReadsCompleteDrivesOfItsMap) {
  DriveTable& drives = state_.drives();
  const std::int64_t drive = drives.open("town", "monday", 1).id;
  NewJob job{.map = "town", .drives = {drive}};
  expect_refused(Reason::kDriveNotComplete, [&] { jobs_.enqueue(job, 2); });
  drives.add_part(drive, {1, std::string(64, 'a'), 10});
  drives.complete(drive, 3);
  const std::int64_t id = jobs_.enqueue(job, 4).job.id;
  EXPECT_THAT(jobs_.drives(id), ElementsAre(drive));
  EXPECT_THAT(drives.jobs_using(drive), ElementsAre(id));
  job.map = "depot";
  expect_refused(Reason::kUnknownDrive, [&] { jobs_.enqueue(job, 5); });
  expect_refused(Reason::kInUse, [&] { drives.remove(drive); });
  expect_refused(Reason::kInUse, [&] { state_.remove_map("town"); });
  jobs_.request_cancel(id, 6);
  EXPECT_EQ(jobs_.forget_finished_before(100, 6), 0U) << "it tells when its drive was used";
  drives.remove(drive);
  EXPECT_THAT(jobs_.drives(id), ElementsAre(drive)) << "what it was made of stays known";
  jobs_.forget_finished_before(100, 6);
  EXPECT_THAT(ids({}), IsEmpty());
}

TEST_F(JobTableTest, NamesEveryStatus) {
  for (const char* name : {"enqueued", "processing", "succeeded", "failed", "canceled"})
    EXPECT_EQ(name_of(job_status_of(name).value()), name);
  EXPECT_FALSE(job_status_of("done"));
}

}  // namespace job_table_test
}  // namespace stillmap::server
