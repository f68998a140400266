#include <gmock/gmock.h>

#include <algorithm>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <fcntl.h>
#include <sys/file.h>
#include <sys/resource.h>

#include <stillmap/maps/edits.hpp>

#include "job_fixture.hpp"
#include "jobs/housekeeping.hpp"
#include "jobs/job_log.hpp"
#include "store/store_migration.hpp"
#include "support/disk_calls.hpp"

namespace stillmap::server {
namespace jobs_test {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::Le;
using ::testing::Not;
using ::testing::Pair;

class Jobs : public JobTest {};

TEST_F(Jobs, RebuildBecomesAVersionAndLeavesItsLogAlone) {
  start_with("say 0.5 'map: survey'; echo working; publish");
  const HttpResponse accepted = send("POST", "/v1/maps/town/rebuild",
                                     R"({"drives": [1], "version": "v2",
                                         "options": {"movable": "delete", "voxel": 0.2,
                                                     "pose-time-offset": -37.5}})");
  ASSERT_EQ(accepted.status, 202);
  EXPECT_THAT(accepted.headers, Contains(Pair("Location", "/v1/jobs/1")));
  const nlohmann::json job = wait_for_end("/v1/jobs/1");
  EXPECT_EQ(job["status"], "succeeded") << job.dump();
  EXPECT_EQ(job["progress"], 1.0);
  EXPECT_EQ(job["result"]["version"], "v2");
  EXPECT_EQ(job["result"]["activated"], false);
  EXPECT_EQ(job["result"]["gate"]["verdict"], "pass");
  EXPECT_EQ(job["request"]["options"]["voxel"], 0.2);
  EXPECT_EQ(job["request"]["options"]["pose-time-offset"], -37.5);
  EXPECT_EQ(store_.open().state().version("town", "v2").digest, job["result"]["digest"]);
  EXPECT_EQ(store_.open().state().map("town").active, store_.version());
  EXPECT_EQ(log_of("/v1/jobs/1"), "working\n");
  expect_cleared(1);
}

TEST_F(Jobs, VersionIsNamedByDayAndJobWhereNobodyDoes) {
  start_with("publish");
  const nlohmann::json job = wait_for_end(rebuild());
  EXPECT_THAT(job["result"]["version"].get<std::string>(),
              ::testing::MatchesRegex("20[0-9]+-job1"));
}

TEST_F(Jobs, CommandHoldsWhatWasAskedForAndTheGateOfTheOptions) {
  options_.gate.max_new_lost = 3;
  options_.gate.max_wall_thickening = 0.5;
  options_.gate.max_entropy_rise = 0.75;
  options_.jobs.cores = 1;
  start_with("echo \"$0\"; cat $gate $edits; tr '\\0' ' ' < /proc/$$/cmdline; publish");
  make_drive();
  const std::string job = rebuild(R"({"drives": [1], "held_back": 2, "options":
      {"preset": "paper", "detector": "geometric", "edits": {"format": "stillmap-edits", "version": 1, "edits": []}}})");
  EXPECT_EQ(wait_for_end(job)["status"], "succeeded");
  const std::string log = log_of(job);
  EXPECT_THAT(log, HasSubstr("\"new_lost\":3"));
  EXPECT_THAT(log, HasSubstr("\"wall_thickening\":0.5,\"entropy_rise\":0.75"));
  EXPECT_THAT(log, HasSubstr(std::string(maps::kNoEdits)));
  EXPECT_THAT(log, HasSubstr("/drives/1/drive-1 --detector geometric --preset paper --output "));
  EXPECT_THAT(log, HasSubstr("/drives/2/drive-2 --previous "));
  EXPECT_THAT(log, HasSubstr("/previous-map --threads 1 --progress json --progress-fd 3"));
}

TEST_F(Jobs, PatchesTheActiveVersionWhenAsked) {
  start_with("tr '\\0' ' ' < /proc/$$/cmdline; publish");
  make_drive();
  const std::string job = rebuild(R"({"drives": [1], "patch": true})");
  EXPECT_EQ(wait_for_end(job)["status"], "succeeded");
  EXPECT_THAT(log_of(job), HasSubstr("/previous-map --patch "));
}

TEST_F(Jobs, IsActivatedOnlyWhenAskedAndInTheSameFrame) {
  start_with("publish");
  const std::string other_frame = rebuild(R"({"drives": [1], "activate": true})");
  const nlohmann::json kept = wait_for_end(other_frame);
  EXPECT_EQ(kept["status"], "succeeded");
  EXPECT_EQ(kept["result"]["activated"], false);
  EXPECT_FALSE(kept["result"]["not_activated_because"].empty());
  EXPECT_EQ(store_.open().state().map("town").active, store_.version());
  const std::string asked =
      rebuild(R"({"drives": [1], "activate": true, "new_frame": true, "version": "v3"})");
  EXPECT_EQ(wait_for_end(asked)["result"]["activated"], true);
  EXPECT_EQ(store_.open().state().map("town").active, "v3");
}

TEST_F(Jobs, FailedGateIsAResultAndNotAFailure) {
  start_with(R"(publish; printf '{"verdict":"fail","reasons":["7 new lost"]}' > $report; exit 4)");
  const nlohmann::json job = wait_for_end(
      rebuild(R"({"drives": [1], "activate": true, "new_frame": true, "version": "v2"})"));
  EXPECT_EQ(job["status"], "succeeded");
  EXPECT_EQ(job["result"]["activated"], false);
  EXPECT_EQ(job["result"]["not_activated_because"][0], "7 new lost");
  EXPECT_TRUE(store_.open().state().find_version("town", "v2").has_value());
}

TEST_F(Jobs, WhatTheMapperRefusesIsNotTriedAgain) {
  start_with("echo 'stillmap: /x: found nothing'; exit 1");
  const nlohmann::json job = wait_for_end(rebuild());
  EXPECT_EQ(job["status"], "failed");
  EXPECT_EQ(job["error"], "stillmap: /x: found nothing");
  EXPECT_EQ(job["attempts"], 1);
  expect_cleared(1);
}

TEST_F(Jobs, CrashIsTriedAgainInTheSameFolderAndThenFailsInWords) {
  start_with("echo x >> $work/tries; cat $work/tries | wc -l; kill -SEGV $$");
  const std::string job = rebuild();
  const nlohmann::json failed = wait_for_end(job);
  EXPECT_EQ(failed["status"], "failed");
  EXPECT_EQ(failed["attempts"], 3);
  EXPECT_THAT(failed["error"].get<std::string>(), HasSubstr("signal 11"));
  EXPECT_THAT(failed["error"].get<std::string>(), HasSubstr("3 times"));
  EXPECT_EQ(log_of(job), "1\n2\n3\n");
}

TEST_F(Jobs, GoesOnAfterACrash) {
  start_with("if [ -e $work/half ]; then publish; else touch $work/half; kill -KILL $$; fi");
  const nlohmann::json job = wait_for_end(rebuild());
  EXPECT_EQ(job["status"], "succeeded");
  EXPECT_EQ(job["attempts"], 2);
  EXPECT_EQ(job["error"], "");
}

TEST_F(Jobs, IsTriedAgainWhenTheEstimateOfItsRoomCrashes) {
  // The first is that of the request.
  const std::string asked = (scripts_.path() / "asked").string();
  start_with("publish", "1000'; echo x >> " + asked + "; [ $(wc -l < " + asked +
                            ") -ne 2 ] || kill -KILL $$; printf '");
  const nlohmann::json job = wait_for_end(rebuild());
  EXPECT_EQ(job["status"], "succeeded") << job;
  EXPECT_EQ(job["attempts"], 2);
}

TEST_F(Jobs, AreTakenWhenTheEstimateForTheirRequestCrashes) {
  const std::string asked = (scripts_.path() / "asked").string();
  start_with("publish", "1000'; echo x >> " + asked + "; [ $(wc -l < " + asked +
                            ") -ne 1 ] || kill -KILL $$; printf '");
  const nlohmann::json job = wait_for_end(rebuild());
  EXPECT_EQ(job["status"], "succeeded") << job;
  EXPECT_EQ(job["attempts"], 1);
}

TEST_F(Jobs, CancelAndStopEndTheEstimateOfItsRoom) {
  // Every second one is that of the job itself.
  const std::string asked = (scripts_.path() / "asked").string();
  start_with("publish", "1000'; echo x >> " + asked + "; [ $(($(wc -l < " + asked +
                            ") % 2)) -eq 1 ] || sleep 50; printf '");
  const auto begin = std::chrono::steady_clock::now();
  const auto wait_until_asked = [&](std::uintmax_t times) {
    while (std::filesystem::file_size(asked) < 2 * times)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
  };
  const std::string job = rebuild();
  wait_until_asked(2);
  EXPECT_EQ(send("POST", job + "/cancel").status, 202);
  EXPECT_EQ(wait_for_end(job)["status"], "canceled");
  static_cast<void>(rebuild(R"({"drives": [1], "version": "v2"})"));
  wait_until_asked(4);
  service_.reset();
  EXPECT_EQ(store_.open().jobs().job(2).status, JobStatus::kEnqueued);
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(25));
}

TEST_F(Jobs, OneThatMeetsAFullDiskKeepsItsWorkAndCanBeCancelledAndStopped) {
  start_with(kMeetsAFullDisk);
  const std::string job = rebuild();
  wait_for_stage(job, "wait for room on the disk");
  EXPECT_TRUE(std::filesystem::exists(job_folder(1) / "scratch" / "work" / "tries"));
  service_.reset();
  EXPECT_EQ(store_.open().jobs().job(1).status, JobStatus::kEnqueued);
  EXPECT_EQ(store_.open().jobs().job(1).error, "stillmap: /x: No space left on device");
  start();
  wait_for_stage(job, "wait for room on the disk");
  EXPECT_EQ(send("POST", job + "/cancel").status, 202);
  EXPECT_EQ(wait_for_end(job)["status"], "canceled");
  expect_cleared(1);
}

TEST_F(Jobs, GoesOnAfterARestartOfTheServer) {
  start_with(
      "if [ -e $work/half ]; then publish; else touch $work/half; say 0.1 half; sleep 60; fi");
  const std::string job = rebuild();
  wait_for_stage(job, "half");
  service_.reset();
  EXPECT_EQ(store_.open().jobs().job(1).status, JobStatus::kEnqueued);
  EXPECT_TRUE(std::filesystem::exists(job_folder(1) / "scratch" / "work" / "half"));
  start();
  EXPECT_EQ(wait_for_end(job)["status"], "succeeded");
}

/// Its package is registered to the active version by the digest that this one had.
TEST_F(Jobs, IsActivatedThoughTheActiveVersionWasMigratedMeanwhile) {
  const std::string former = test::write_package(scripts_.path() / "old", 3, 100, {}, 1);
  store_.open().add("town", "old", scripts_.path() / "old");
  store_.open().activate("town", "old");
  std::filesystem::remove_all(scripts_.path() / "package");
  test::write_package(scripts_.path() / "package", 7, 100,
                      maps::Registration{.previous_digest = former});
  start_with("say 0.1 waiting; while [ ! -e $0.go ]; do sleep 0.05; done; publish");
  const std::string job = rebuild(R"({"drives": [1], "activate": true, "version": "v2"})");
  wait_for_stage(job, "waiting");
  service_.reset();
  EXPECT_EQ(migrate_store(store_.open(), plan_migration(store_.open())).migrated.size(), 1U);
  std::ofstream(mapper_.string() + ".go") << "x";
  start();
  const nlohmann::json end = wait_for_end(job);
  EXPECT_EQ(end["result"]["activated"], true) << end;
  EXPECT_EQ(store_.open().state().map("town").active, "v2");
}

TEST_F(Jobs, OneThatDoesNotListenIsKilledTwoSecondsAfterACancel) {
  start_with("trap '' TERM; say 0.25 deaf; while true; do sleep 0.1; done");
  const std::string job = rebuild();
  const nlohmann::json deaf = wait_for_stage(job, "deaf");
  EXPECT_EQ(deaf["progress"], 0.25);
  EXPECT_EQ(deaf["eta_s"], 2.5);
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_EQ(send("POST", job + "/cancel").status, 202);
  EXPECT_EQ(wait_for_end(job)["status"], "canceled");
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(10));
  EXPECT_EQ(body(send("POST", job + "/cancel"))["status"], "canceled") << "twice is once";
  EXPECT_EQ(get("/v1/jobs/1").status, 200);
}

TEST_F(Jobs, OneThatWaitsIsCancelledAtOnceAndReleasesItsDrive) {
  start_with("say 0.1 first; while [ ! -e $work/../../../../go ]; do sleep 0.05; done; publish");
  const std::string first = rebuild();
  wait_for_stage(first, "first");
  const std::string second = rebuild(R"({"drives": [1], "version": "v2"})");
  EXPECT_EQ(body(get(second))["status"], "enqueued");
  EXPECT_EQ(send("POST", second + "/cancel").status, 200);
  EXPECT_EQ(body(get(second))["status"], "canceled");
  EXPECT_EQ(send("POST", second + "/cancel").status, 200) << "twice is once, also where counted";
  EXPECT_NE(service_->metrics().text().find("jobs_ended_total{status=\"canceled\"} 1\n"),
            std::string::npos);
  EXPECT_EQ(body(send("DELETE", "/v1/maps/town/drives/1"))["code"], "InUse");
  std::ofstream(store_.folder().path() / "go") << "x";
  EXPECT_EQ(wait_for_end(first)["status"], "succeeded");
  EXPECT_EQ(body(send("POST", first + "/cancel"))["code"], "JobFinished");
  EXPECT_EQ(send("DELETE", "/v1/maps/town/drives/1").status, 204);
}

/// The version may be removed as soon as another one is active.
TEST_F(Jobs, KeepsTheVersionThatItBeganWith) {
  start_with(
      "previous=$(tr '\\0' '\\n' < /proc/$$/cmdline | grep -A1 -x -e --previous | tail -n 1)\n"
      "say 0.1 first; while [ ! -e $0.go ]; do sleep 0.05; done\n"
      "ls $previous/packs $previous/index; publish");
  std::filesystem::create_directory(store_.package() / "index");
  std::ofstream(store_.package() / "index" / "1-0.idx") << "derived";
  std::ofstream(store_.package() / "index" / ".1-1.idx.partial") << "half";
  const std::string job = rebuild();
  wait_for_stage(job, "first");
  test::write_package(scripts_.path() / "other", 8);
  store_.open().add("town", "other", scripts_.path() / "other");
  store_.open().activate("town", "other");
  ASSERT_TRUE(store_.open().remove("town", store_.version()));
  EXPECT_FALSE(std::filesystem::exists(store_.package()));
  std::ofstream(mapper_.string() + ".go") << "x";
  EXPECT_EQ(wait_for_end(job)["status"], "succeeded");
  EXPECT_THAT(log_of(job), HasSubstr(".pack\n"));
  EXPECT_THAT(log_of(job), HasSubstr("1-0.idx\n"));
  EXPECT_THAT(log_of(job), Not(HasSubstr("1-1.idx")));
  expect_cleared(1);
}

TEST_F(Jobs, OneThatTakesTooLongHasFailed) {
  options_.jobs.time_limit_s = 1;
  start_with("say 0.1 slow; sleep 60");
  const nlohmann::json job = wait_for_end(rebuild());
  EXPECT_EQ(job["status"], "failed");
  EXPECT_EQ(job["error"], "took longer than 1 s");
}

TEST_F(Jobs, FloodOfTextLeavesABoundedLogWithItsEnd) {
  start_with("head -c 9000000 /dev/zero | tr '\\0' 'a'; echo; echo the end; exit 1");
  const std::string job = rebuild();
  EXPECT_EQ(wait_for_end(job)["error"], "the end");
  const std::string log = log_of(job);
  EXPECT_THAT(log.size(), Le(JobLog::kMostBytes + JobLog::kEndBytes + 100));
  EXPECT_THAT(log, HasSubstr("bytes are left out here"));
  EXPECT_THAT(log, EndsWith("the end\n"));
}

TEST_F(Jobs, GarbageForProgressCostsNothingButTheProgress) {
  start_with(
      "printf '\\377\\000{]\\n[1]\\n{\"fraction\":7}\\n{\"fraction\":\"x\"}\\n' >&3;"
      "head -c 100000 /dev/zero | tr '\\0' '[' >&3; echo >&3; say 0.5 real; publish");
  const std::string job = rebuild();
  EXPECT_EQ(wait_for_end(job)["status"], "succeeded");
  EXPECT_THAT(log_of(job), HasSubstr("5 lines of progress could not be read"));
}

TEST_F(Jobs, RunsBelowTheServerWithNothingOfIts) {
  options_.jobs.nice = 5;
  options_.jobs.cores = 1;
  options_.jobs.memory_bytes = std::int64_t{1} << 30U;
  start_with(
      "nice; cat /proc/self/oom_score_adj; ulimit -c; ulimit -v;"
      "grep Cpus_allowed_list /proc/self/status; ls /proc/$$/fd; publish");
  const std::string job = rebuild();
  EXPECT_EQ(wait_for_end(job)["status"], "succeeded");
  const int niceness = std::min(19, ::getpriority(PRIO_PROCESS, 0) + 5);
  // sh itself reads its script from 10.
  EXPECT_THAT(log_of(job),
              ::testing::MatchesRegex(std::to_string(niceness) +
                                      "\n1000\n0\n1048576\nCpus_allowed_list:\t[0-9]+\n"
                                      "0\n1\n(10\n)?2\n3\n"));
}

TEST_F(Jobs, EventsComeInOrderAndEndWithTheLast) {
  start_with("say 0.1 one; while [ ! -e $work/../../../../go ]; do sleep 0.02; done; publish");
  const std::string job = rebuild();
  const HttpResponse stream = get(job + "/events");
  ASSERT_NE(stream.events, nullptr);
  std::ofstream(store_.folder().path() / "go") << "x";
  std::string text;
  while (const auto more = stream.events->next(std::chrono::seconds(10))) text += *more;
  EXPECT_THAT(text, HasSubstr("\"stage\":\"publish\""));
  EXPECT_THAT(text, HasSubstr("event: end\n"));
  EXPECT_THAT(text, HasSubstr("\"status\":\"succeeded\""));
  std::uint64_t last = 0;
  for (std::size_t at = text.find("id: "); at != std::string::npos;
       at = text.find("id: ", at + 1)) {
    const std::uint64_t id = std::stoull(text.substr(at + 4));
    EXPECT_GT(id, last);
    last = id;
  }
  // Who comes back has missed nothing, and is told not to come again.
  HttpRequest again = request("GET", job + "/events");
  again.headers["last-event-id"] = std::to_string(last);
  EXPECT_EQ(service_->handle(again).status, 204);
  // Who comes late is told the end.
  const HttpResponse late = get(job + "/events");
  EXPECT_THAT(late.events->next(std::chrono::seconds(1)).value_or(""), HasSubstr("event: end"));
  EXPECT_FALSE(late.events->next(std::chrono::seconds(1)).has_value());
}

TEST_F(Jobs, AreListedNewestFirstAndFiltered) {
  start_with("publish");
  wait_for_end(rebuild());
  wait_for_end(rebuild());
  nlohmann::json list = body(get("/v1/jobs"));
  ASSERT_EQ(list["jobs"].size(), 2U);
  EXPECT_EQ(list["jobs"][0]["id"], 2);
  HttpRequest some = request("GET", "/v1/jobs");
  some.query = {{"limit", "1"}, {"status", "succeeded"}, {"map", "town"}};
  nlohmann::json page = body(service_->handle(some));
  EXPECT_EQ(page["jobs"].size(), 1U);
  some.query.emplace_back("before", std::to_string(page["next"].get<int>()));
  EXPECT_EQ(body(service_->handle(some))["jobs"][0]["id"], 1);
  for (const auto& [name, value] : std::vector<std::pair<std::string, std::string>>{
           {"status", "done"}, {"limit", "0"}, {"limit", "1001"}, {"before", "x"}, {"x", "1"}}) {
    HttpRequest bad = request("GET", "/v1/jobs");
    bad.query = {{name, value}};
    EXPECT_EQ(service_->handle(bad).status, 400) << name << "=" << value;
  }
  EXPECT_EQ(body(get("/v1/jobs/9"))["code"], "UnknownJob");
  EXPECT_EQ(body(get("/v1/jobs/x/log"))["code"], "UnknownJob");
}

TEST_F(Jobs, HousekeepingForgetsWhatIsOld) {
  start_with("publish");
  wait_for_end(rebuild());
  const StoredDrive drive = store_.open().drives().drive(1);
  Metrics metrics("1");
  MapCatalog catalog(
      store_.open(),
      [](const maps::MapPackage&, const localization::LocalizationOptions&) { return Aligners{}; });
  DriveStore drives(store_.open());
  service_.reset();
  const OptionsHolder live(options_);
  const JobSetup setup{live, store_.open(), drives, catalog, metrics, mapper_};
  const server::Jobs jobs(setup);
  const RetentionOptions retention{
      .versions = 0, .job_days = 30, .audit_days = 1, .drive_days = 40};
  const auto days_later = [&](int days) {
    return drive.created_ns + days * std::int64_t{86'400'000'000'000};
  };
  keep_house(retention, store_.open(), drives, jobs.folders, days_later(29));
  EXPECT_TRUE(std::filesystem::exists(job_folder(1)));
  EXPECT_TRUE(store_.open().audit().list(1).records.empty());
  keep_house(retention, store_.open(), drives, jobs.folders, days_later(31));
  EXPECT_TRUE(std::filesystem::exists(job_folder(1))) << "it tells when its drive was used";
  EXPECT_EQ(store_.open().drives().all().size(), 1U);
  keep_house(retention, store_.open(), drives, jobs.folders, days_later(41));
  EXPECT_FALSE(std::filesystem::exists(job_folder(1)));
  EXPECT_TRUE(store_.open().drives().all().empty());
}

}  // namespace jobs_test
}  // namespace stillmap::server
