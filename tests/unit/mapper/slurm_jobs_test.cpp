#include "mapper/slurm_jobs.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>

#include "errors/exit_codes.hpp"

namespace stillmap::mapper {
namespace slurm_jobs_test {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

/// The five steps of a build of two shares; nothing is done, and nothing is submitted.
std::vector<StepState> steps() {
  std::vector<StepState> steps;
  for (const char* name : {"poses", "survey", "fuse", "finish", "merge"}) {
    const std::string text = name;
    steps.push_back({text, std::vector<UnitState>(text == "survey" || text == "finish" ? 2 : 1)});
  }
  return steps;
}

enum Step : std::size_t { kPoses, kSurvey, kFuse, kFinish, kMerge };

SlurmTask task(std::string id, std::string state = "PENDING", std::string reason = "Dependency") {
  return {.id = std::move(id),
          .step = {},
          .number = 1,
          .state = std::move(state),
          .reason = std::move(reason),
          .restarts = 0,
          .waited_s = 0.0};
}

/// All five jobs are in Slurm, 1 to 5, and the first step is done.
std::vector<StepState> surveying() {
  std::vector<StepState> all = steps();
  all[kPoses].units[0].is_done = true;
  all[kSurvey].units[0].tasks = {task("2_1", "RUNNING", "None")};
  all[kSurvey].units[1].tasks = {task("2_2", "RUNNING", "None")};
  all[kFuse].units[0].tasks = {task("3")};
  all[kFinish].units[0].tasks = {task("4_1")};
  all[kFinish].units[1].tasks = {task("4_2")};
  all[kMerge].units[0].tasks = {task("5")};
  return all;
}

void expect_nothing(const SlurmActions& actions) {
  EXPECT_FALSE(actions.is_finished);
  EXPECT_FALSE(actions.failure);
  EXPECT_THAT(actions.cancel, IsEmpty());
  EXPECT_THAT(actions.start_now, IsEmpty());
  EXPECT_THAT(actions.submit, IsEmpty());
}

TEST(SlurmQueue, IsReadTaskByTask) {
  const auto tasks = tasks_from(
      "7|N/A|PENDING|poses|None|0|\n"
      "8|12|RUNNING|survey|BeginTime|3|\n");
  ASSERT_THAT(tasks, SizeIs(2));
  EXPECT_EQ(tasks[0].id, "7");
  EXPECT_EQ(tasks[0].step, "poses");
  EXPECT_EQ(tasks[0].number, 1U);
  EXPECT_EQ(tasks[1].id, "8_12");
  EXPECT_EQ(tasks[1].number, 12U);
  EXPECT_EQ(tasks[1].state, "RUNNING");
  EXPECT_EQ(tasks[1].reason, "BeginTime");
  EXPECT_EQ(tasks[1].restarts, 3U);
  EXPECT_THAT(tasks_from(""), IsEmpty());
}

TEST(SlurmQueue, OfAnotherFormIsRefused) {
  for (const char* text :
       {"8|1|RUNNING|survey|None|", "8|1|RUNNING|survey|None|0|more|", "x|1|RUNNING|survey|None|0|",
        "8|1-4|RUNNING|survey|None|0|", "8|1|RUNNING|survey|None||", "slurm_load_jobs error"})
    EXPECT_THROW((void)tasks_from(text), std::runtime_error) << text;
}

TEST(SlurmQueue, SaysWhatHasEnded) {
  const auto tasks = tasks_from(
      "7|N/A|COMPLETED|poses|None|0|\n"
      "8|1|COMPLETING|survey|None|0|\n"
      "9|1-4|CANCELLED|survey|None|0|\n");
  ASSERT_THAT(tasks, SizeIs(3));
  EXPECT_TRUE(has_ended(tasks[0]));
  EXPECT_FALSE(has_ended(tasks[1]));
  EXPECT_TRUE(has_ended(tasks[2]));
  EXPECT_EQ(tasks[2].number, 0U);
}

TEST(SlurmQueue, ListsAJobByItsNumberAndStep) {
  const auto tasks = tasks_from(
      "7|N/A|COMPLETED|poses|None|0|\n"
      "8|2|RUNNING|survey|None|0|\n"
      "9|N/A|PENDING|of the site|None|0|\n");
  const std::vector<SlurmJob> jobs{{"7", "poses"}, {"8", "survey"}, {"9", "fuse"}, {"10", "merge"}};
  const auto missing = without_task(jobs, tasks);
  ASSERT_THAT(missing, SizeIs(2));
  EXPECT_EQ(missing[0].id, "9");
  EXPECT_EQ(missing[1].id, "10");
}

TEST(SlurmOptions, ThatHideJobsAreRefused) {
  for (const char* option : {"--clusters=x", "--cluster=x", "-M", "-Mx", "--wait", "-W",
                             "--test-only", "--te", "--array=1-4", "-a1"})
    EXPECT_THROW(require_usable_options({"--time=9", option}), std::invalid_argument) << option;
  EXPECT_NO_THROW(require_usable_options({"--wait-all-nodes=1", "--account=a", "-Aa", "--time=9",
                                          "--mem=8G", "-p", "long", "--constraint=a", "--", "-"}));
}

TEST(SlurmDecision, SubmitsFiveStepsThatWaitForEachOther) {
  const SlurmActions actions = decide(steps());
  ASSERT_THAT(actions.submit, SizeIs(5));
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_EQ(actions.submit[i].step, i);
    EXPECT_THAT(actions.submit[i].after, IsEmpty());
  }
  EXPECT_THAT(actions.submit[kPoses].numbers, ElementsAre(1));
  EXPECT_THAT(actions.submit[kSurvey].numbers, ElementsAre(1, 2));
  EXPECT_THAT(actions.cancel, IsEmpty());
}

TEST(SlurmDecision, LeavesAloneWhatRuns) { expect_nothing(decide(surveying())); }

TEST(SlurmDecision, GoesOnWhereASubmissionWasInterrupted) {
  auto all = surveying();
  all[kFinish].units[0].tasks = {};
  all[kFinish].units[1].tasks = {};
  all[kMerge].units[0].tasks = {};
  const SlurmActions actions = decide(all);
  ASSERT_THAT(actions.submit, SizeIs(2));
  EXPECT_EQ(actions.submit[0].step, kFinish);
  EXPECT_THAT(actions.submit[0].after, ElementsAre("3"));
  EXPECT_EQ(actions.submit[1].step, kMerge);
  EXPECT_THAT(actions.submit[1].after, IsEmpty());
  EXPECT_THAT(actions.cancel, IsEmpty());
}

TEST(SlurmDecision, SubmitsAUnitThatEndedAgainAndWhatWaitedForIt) {
  auto all = surveying();
  all[kSurvey].units[1].tasks = {};
  const SlurmActions actions = decide(all);
  EXPECT_THAT(actions.cancel, ElementsAre("3", "4_1", "4_2", "5"));
  ASSERT_THAT(actions.submit, SizeIs(4));
  EXPECT_EQ(actions.submit[0].step, kSurvey);
  EXPECT_THAT(actions.submit[0].numbers, ElementsAre(2));
  EXPECT_THAT(actions.submit[0].after, IsEmpty());
  // It waits for the share that still runs, too.
  EXPECT_EQ(actions.submit[1].step, kFuse);
  EXPECT_THAT(actions.submit[1].after, ElementsAre("2_1"));
  EXPECT_THAT(actions.submit[2].after, IsEmpty());
  EXPECT_THAT(actions.submit[2].numbers, ElementsAre(1, 2));
}

TEST(SlurmDecision, DoesNotSubmitAgainWhatIsDone) {
  auto all = surveying();
  all[kSurvey].units[0] = {.is_done = true, .failed = {}, .tasks = {}};
  expect_nothing(decide(all));
}

TEST(SlurmDecision, SubmitsAgainWhatSlurmHolds) {
  auto all = surveying();
  SlurmTask& held = all[kSurvey].units[0].tasks[0];
  held = task("2_1", "PENDING", "launch_failed_requeued_held");
  held.restarts = 2;
  const SlurmActions actions = decide(all);
  EXPECT_THAT(actions.cancel, testing::Contains("2_1"));
  ASSERT_FALSE(actions.submit.empty());
  EXPECT_EQ(actions.submit[0].step, kSurvey);
  EXPECT_THAT(actions.submit[0].numbers, ElementsAre(1));
  // A person may hold one.
  held.reason = "JobHeldUser";
  expect_nothing(decide(all));
}

TEST(SlurmDecision, StartsWhatSlurmHasPutBackWhenTheAttemptBeforeHasEnded) {
  auto all = surveying();
  SlurmTask& back = all[kSurvey].units[0].tasks[0];
  back = task("2_1", "PENDING", "BeginTime");
  // Somebody wants it to begin later.
  expect_nothing(decide(all));
  back.restarts = 1;
  back.waited_s = kEndedAfterS - 1.0;
  expect_nothing(decide(all));
  back.waited_s = kEndedAfterS;
  EXPECT_THAT(decide(all).start_now, ElementsAre("2_1"));
  back.reason = "Resources";
  expect_nothing(decide(all));
}

TEST(SlurmDecision, EndsWithAUnitThatWouldFailAgain) {
  for (const int code : {exit_code::kFailed, exit_code::kUsage, exit_code::kDiskFull}) {
    auto all = surveying();
    all[kSurvey].units[1] = {.is_done = false, .failed = code, .tasks = {}};
    const SlurmActions actions = decide(all);
    ASSERT_TRUE(actions.failure) << code;
    EXPECT_EQ(actions.failure->step, kSurvey);
    EXPECT_EQ(actions.failure->number, 2U);
    EXPECT_THAT(actions.submit, IsEmpty());
  }
}

TEST(SlurmDecision, TriesAgainWhatWasKilled) {
  auto all = surveying();
  all[kSurvey].units[1] = {.is_done = false, .failed = 137, .tasks = {}};
  EXPECT_FALSE(decide(all).failure);
  EXPECT_THAT(decide(all).submit, SizeIs(4));
  all[kSurvey].units[1].attempts = kMostAttempts;
  EXPECT_TRUE(decide(all).failure);
  // Its last attempt is on its way.
  all[kSurvey].units[1].tasks = {task("9_2")};
  expect_nothing(decide(all));
}

TEST(SlurmSilence, LastsUntilTheSignOfAUnitChanges) {
  UnitSilence silence;
  UnitSilence::Clock::time_point now = UnitSilence::Clock::now();
  const auto later = [&](int seconds) { return now += std::chrono::seconds(seconds); };
  EXPECT_EQ(silence.look({{"survey:1", "a"}, {"survey:2", "a"}}, now).at("survey:1"), 0.0);
  EXPECT_EQ(silence.look({{"survey:1", "a"}, {"survey:2", "b"}}, later(20)),
            (std::map<std::string, double>{{"survey:1", 20.0}, {"survey:2", 0.0}}));
  EXPECT_EQ(silence.look({{"survey:1", "a"}}, later(30)).at("survey:1"), 50.0);
  // It ran in between on another machine, or not at all.
  EXPECT_EQ(silence.look({{"survey:1", "a"}, {"survey:2", "b"}}, later(1)).at("survey:2"), 0.0);
}

TEST(SlurmSilence, CountsOnlyWhileSomebodyLooks) {
  UnitSilence silence;
  UnitSilence::Clock::time_point now = UnitSilence::Clock::now();
  const auto after = [&](int seconds) {
    now += std::chrono::seconds(seconds);
    return silence.look({{"fuse", "a"}}, now).at("fuse");
  };
  EXPECT_EQ(after(0), 0.0);
  EXPECT_EQ(after(20), 20.0);
  // The disk was away.
  EXPECT_EQ(after(180), 0.0);
  EXPECT_EQ(after(20), 20.0);
}

TEST(SlurmDecision, CancelsATaskThatIsLostAndSubmitsItsUnitAgain) {
  auto all = surveying();
  all[kSurvey].units[1].silent_s = kLostAfterS;
  expect_nothing(decide(all));
  all[kSurvey].units[1].silent_s = kLostAfterS + 1.0;
  const SlurmActions actions = decide(all);
  EXPECT_THAT(actions.cancel, ElementsAre("2_2", "3", "4_1", "4_2", "5"));
  ASSERT_THAT(actions.submit, SizeIs(4));
  EXPECT_THAT(actions.submit[0].numbers, ElementsAre(2));
  EXPECT_THAT(actions.submit[1].after, ElementsAre("2_1"));
}

TEST(SlurmDecision, CancelsATaskThatIsLostThoughItsUnitIsDone) {
  auto all = surveying();
  all[kSurvey].units[1].is_done = true;
  all[kSurvey].units[1].silent_s = kLostWhenDoneAfterS + 1.0;
  const SlurmActions actions = decide(all);
  EXPECT_THAT(actions.cancel, ElementsAre("2_2"));
  EXPECT_THAT(actions.submit, IsEmpty());
}

TEST(SlurmRefusals, AreFollowedByLongerAndLongerWaits) {
  using std::chrono::seconds;
  EXPECT_EQ(wait_after(1), seconds(2));
  EXPECT_EQ(wait_after(2), seconds(4));
  EXPECT_EQ(wait_after(8), seconds(256));
  EXPECT_EQ(wait_after(9), seconds(300));
  EXPECT_EQ(wait_after(1'000'000), seconds(300));
}

TEST(SlurmDecision, IsFinishedWithTheLastUnit) {
  auto all = surveying();
  for (StepState& step : all)
    for (UnitState& unit : step.units) unit.is_done = true;
  EXPECT_TRUE(decide(all).is_finished);
  EXPECT_EQ(first_not_done(all), all.size());
}

}  // namespace slurm_jobs_test
}  // namespace stillmap::mapper
