#pragma once

#include <chrono>
#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// What to do about the jobs of a build in Slurm, decided from what is known of them. Nothing here
/// runs anything (`slurm_build.hpp` does).
namespace stillmap::mapper {

/// A task of a job.
struct SlurmTask {
  /// As `scancel` takes it: `12`, or `12_3` in an array.
  std::string id;
  /// `survey` of the unit `survey:3`.
  std::string step;
  /// 3 of the unit `survey:3`; 1 where a step is one unit; 0 if unknown of one that has ended.
  std::size_t number = 1;
  /// `PENDING`, `RUNNING`, `COMPLETING` and others.
  std::string state;
  /// Why it waits.
  std::string reason;
  /// How often Slurm has put it back into its queue.
  std::size_t restarts = 0;
  /// How long it has been seen waiting since then [s].
  double waited_s = 0.0;
};

/// What `squeue` is asked for.
inline constexpr const char* kSqueueFormat =
    "ArrayJobID:|,ArrayTaskID:|,State:|,Comment:|,Reason:|,RestartCnt:|";
/// Its answer, a task a line. @throws std::runtime_error for lines of another form.
[[nodiscard]] std::vector<SlurmTask> tasks_from(std::string_view text);

[[nodiscard]] bool has_ended(const SlurmTask& task);

/// A job that `sbatch` has taken.
struct SlurmJob {
  std::string id;
  std::string step;
};
/// @return the jobs of which there is no task of their step, ended or not.
[[nodiscard]] std::vector<SlurmJob> without_task(const std::vector<SlurmJob>& jobs,
                                                 const std::vector<SlurmTask>& tasks);

/// @param options  for `sbatch`.
/// @throws std::invalid_argument naming one that hides the jobs, or changes which there are.
void require_usable_options(const std::vector<std::string>& options);

/// What is known of a unit.
struct UnitState {
  bool is_done = false;
  /// Exit code of the last attempt that failed.
  std::optional<int> failed;
  /// That have not ended.
  std::vector<SlurmTask> tasks;
  /// How long a running task of it has shown no life [s].
  double silent_s = 0.0;
  /// How often it was submitted although the step before was done.
  std::size_t attempts = 0;
};
/// The units of one step.
struct StepState {
  std::string name;
  std::vector<UnitState> units;
};

/// The step to do now; `steps.size()` when all are done.
[[nodiscard]] std::size_t first_not_done(const std::vector<StepState>& steps);

/// Then a unit is not tried again.
inline constexpr std::size_t kMostAttempts = 5;
/// A running task that is silent for so long is lost: its programs were killed, and Slurm's
/// daemon that would have said so, too [s]. Units show life every 10 s.
inline constexpr double kLostAfterS = 120.0;
/// The same, for one whose unit is done [s].
inline constexpr double kLostWhenDoneAfterS = 30.0;

/// How long running units have been silent, by the clock of this process: those of other machines
/// may differ.
class UnitSilence {
 public:
  using Clock = std::chrono::steady_clock;
  /// @param signs  what each running unit last wrote as a sign of life, as it was just read.
  /// @param now    when the last of them was read.
  /// @return since when a unit shows the same sign [s]. Signs that were read before a pause longer
  ///         than `kBlindAfterS` do not count: the disk may have been away, also from the units.
  [[nodiscard]] std::map<std::string, double> look(const std::map<std::string, std::string>& signs,
                                                   Clock::time_point now);

 private:
  struct Sign {
    std::string text;
    Clock::time_point since;
  };
  std::map<std::string, Sign> signs_;
  Clock::time_point looked_;
};
/// See `UnitSilence` [s].
inline constexpr double kBlindAfterS = 30.0;

/// A task that Slurm has put back waits for two minutes, so that what ran before can end. After so
/// long it has ended, or its node is lost: Slurm's `KillWait` is 30 s [s]. Sooner, Slurm would find
/// two of it on one node, take the node out of service and hold the task.
inline constexpr double kEndedAfterS = 40.0;

/// After so many refusals the build fails, unless Slurm has taken a job of it before.
inline constexpr int kMostRefusals = 3;
/// How long to wait before `sbatch` is called again. Limits of a user's jobs, reservations and the
/// change to another controller pass by themselves.
/// @param refusals  in a row, at least 1.
[[nodiscard]] std::chrono::seconds wait_after(int refusals);

/// Units of one step that become one job.
struct SlurmSubmission {
  std::size_t step = 0;
  std::vector<std::size_t> numbers;
  /// Tasks that it waits for, besides the submission before this one.
  std::vector<std::string> after;
};

struct SlurmActions {
  bool is_finished = false;
  /// A unit that will not be tried again.
  struct Failure {
    std::size_t step = 0;
    std::size_t number = 1;
  };
  std::optional<Failure> failure;
  /// Tasks.
  std::vector<std::string> cancel, start_now;
  /// In this order. Each waits for the end of the one before.
  std::vector<SlurmSubmission> submit;
};

/// @param steps  in order. Each needs all units of the one before.
[[nodiscard]] SlurmActions decide(const std::vector<StepState>& steps);

}  // namespace stillmap::mapper
