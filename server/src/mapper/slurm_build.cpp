#include "mapper/slurm_build.hpp"

#include <stillmap/mapping/build_units.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/hidden_beside.hpp>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <stdexcept>
#include <system_error>
#include <thread>
#include <utility>

#include "command_line/command_text.hpp"
#include "command_line/option_value.hpp"
#include "command_line/text_file.hpp"
#include "errors/exit_codes.hpp"
#include "mapper/slurm_folder.hpp"
#include "mapper/slurm_jobs.hpp"
#include "mapper/slurm_name.hpp"
#include "mapper/slurm_program.hpp"

namespace stillmap::mapper {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr std::chrono::seconds kBetweenLooks{2};
constexpr milliseconds kBetweenFlags{100};
/// Of the second in which a cancelled program ends: for an `sbatch` that runs, and for `scancel`.
constexpr milliseconds kForSubmission{400};
constexpr milliseconds kForCancel{400};
/// A program of Slurm that takes longer is taken for one without an answer.
constexpr std::chrono::seconds kForAnswer{60};

/// What a job runs. The words of a build come as arguments, so no shell reads them.
constexpr const char* kScript = R"(#!/bin/sh
# Does a unit of a build: unit.sh FOLDER STEP NAME EARLIER COUNT COMMAND...
# NAME is that of the step in --unit; COUNT units of the step EARLIER must be done.
folder=$1 step=$2 name=$3 earlier=$4 count=$5
shift 5
file=$folder/$step
case $step in survey | finish) file=${file}_$SLURM_ARRAY_TASK_ID name=$name:$SLURM_ARRAY_TASK_ID ;; esac
found=0
for each in "$folder/$earlier"*.done; do
  if [ -e "$each" ]; then found=$((found + 1)); fi
done
if [ "$found" -ne "$count" ]; then
  echo "stillmap: $name was not begun: $found of $count units of the step '$earlier' are done" >&2
  exit 75
fi
while kill -0 $$; do date +%s >"$file.alive"; sleep 10; done 2>/dev/null &
beat=$!
# An earlier attempt may still run, although Slurm has lost it: the files are its own until it ends.
exec 9>"$file.lock"
flock 9 || exit 75
exec >"$file.out.new" 3>"$file.progress"
"$@" --unit "$name"
code=$?
kill $beat
if [ $code -eq 0 ]; then mv "$file.out.new" "$file.out" && : >"$file.done"; else echo $code >"$file.failed"; fi
exit $code
)";

std::string trimmed(const std::string& text) {
  const std::size_t end = text.find_last_not_of(" \n");
  return end == std::string::npos ? "" : text.substr(0, end + 1);
}

/// Everything that decides what the jobs do, and where.
std::string plan_of(const SlurmBuild& build) {
  return fmt::format("{}\n{}\n{}\n{}\n", STILLMAP_VERSION, fs::current_path().string(),
                     fs::absolute(build.target).lexically_normal().string(),
                     fmt::join(build.command, "\n"));
}

void require_new(const fs::path& target) {
  if (fs::exists(fs::symlink_status(target)))
    throw maps::InputError(target.string(), "an existing path", "a new one: give another name");
}

/// What a unit last said of its progress.
struct UnitProgress {
  std::string stage;
  std::size_t done = 0;
  std::size_t total = 0;
  double fraction = 0.0;
};

std::optional<UnitProgress> progress_in(const fs::path& file, const std::string& unit) {
  const auto json = nlohmann::json::parse(last_line_in(file), nullptr, false);
  if (!json.is_object()) return std::nullopt;
  UnitProgress progress{json.value("stage", ""), json.value("done", std::size_t{0}),
                        json.value("total", std::size_t{0}), json.value("fraction", 0.0)};
  const std::string head = unit + ": ";
  if (progress.stage.starts_with(head)) progress.stage.erase(0, head.size());
  return progress;
}

/// The jobs of one build.
class SlurmJobs {
 public:
  SlurmJobs(const SlurmBuild& build, const mapping::ProgressCallback& progress,
            const mapping::CancelFlag& cancel)
      : build_(build),
        progress_(progress),
        cancel_(cancel),
        folder_(slurm_folder(build.target)),
        held_(std::make_shared<HeldFolder>(folder_, cancel)),
        plan_(plan_of(build)),
        name_(slurm_job_name(plan_)) {
    for (const auto& step : mapping::unit_steps(build.units)) {
      const std::string name = mapping::name_of(step.front());
      steps_.push_back({name.substr(0, name.find(':')), step.size(), {}});
    }
  }

  SlurmResult run() {
    // Another process has followed jobs to their end, and removed the folder.
    if (!fs::exists(folder_ / kSlurmPlan) && fs::exists(build_.target)) {
      held_->set_done();
      if (held_->plan_of_other() == plan_) return {std::nullopt, held_};
    }
    begin();
    while (true) {
      if (cancel_) throw_cancelled();
      if (const std::optional<std::vector<SlurmTask>> tasks = tasks_in_queue(name_)) {
        const std::vector<StepState> states = states_with(*tasks);
        const SlurmActions actions = decide(states);
        if (actions.is_finished) return finish(*tasks);
        if (actions.failure) fail(*actions.failure);
        act(actions, states);
        tell(states);
      }
      pause();
    }
  }

 private:
  struct Step {
    std::string name;
    std::size_t units = 1;
    std::map<std::size_t, std::size_t> attempts;
  };

  /// Of a file of a unit.
  [[nodiscard]] fs::path path(const Step& step, std::size_t number, const char* ending) const {
    return folder_ / fmt::format("{}{}.{}", step.name,
                                 is_array(step) ? fmt::format("_{}", number) : "", ending);
  }
  [[nodiscard]] static bool is_array(const Step& step) {
    return step.name == "survey" || step.name == "finish";
  }
  [[nodiscard]] static std::string unit_name(const Step& step, std::size_t number) {
    return is_array(step) ? fmt::format("{}:{}", step.name, number) : step.name;
  }

  /// Waits for a program of Slurm.
  /// @param when_cancelled  at most so long after the build is cancelled.
  [[nodiscard]] ProgramOutput ask(const std::vector<std::string>& arguments,
                                  milliseconds when_cancelled = milliseconds{0}) const {
    Clock::time_point end = Clock::now() + kForAnswer;
    bool is_cancelled = false;
    return run_slurm_program(arguments, [&] {
      if (cancel_ && !std::exchange(is_cancelled, true))
        end = std::min(end, Clock::now() + when_cancelled);
      return Clock::now() >= end;
    });
  }
  [[nodiscard]] static bool did_well(const ProgramOutput& output) {
    return !output.was_left && output.exit_code == 0;
  }
  /// @param most  then `scancel` goes on by itself.
  static bool cancel_jobs(const std::string& name, milliseconds most) {
    const Clock::time_point end = Clock::now() + most;
    return did_well(run_slurm_program(
        {"scancel", own_jobs(), "--name=" + name}, [&] { return Clock::now() >= end; },
        Unawaited::kGoesOn));
  }

  /// For squeue and scancel.
  static std::string own_jobs() { return fmt::format("--user={}", ::geteuid()); }

  /// Until the next look.
  void pause() const {
    for (const auto end = Clock::now() + kBetweenLooks; !cancel_ && Clock::now() < end;)
      std::this_thread::sleep_for(kBetweenFlags);
  }

  /// Finds what an earlier call has left.
  void begin() {
    const fs::path plan = folder_ / kSlurmPlan;
    const std::string found = file_text(plan);
    if (found != plan_) require_new(build_.target);
    if (!found.empty() && found != plan_) end_jobs(slurm_job_name(found));
    std::optional<std::vector<SlurmTask>> tasks;
    while (!(tasks = tasks_in_queue(name_))) {
      if (cancel_) throw_cancelled();
      pause();
    }
    // What failed is tried again. Without jobs every unit is asked again whether it is done: the
    // drives may have changed.
    const bool is_new = found != plan_ || (tasks->empty() && !fs::exists(build_.target));
    was_taken_ = !tasks->empty();
    for (const Step& step : steps_) {
      for (std::size_t number = 1; number <= step.units; ++number) {
        if (found != plan_) fs::remove(path(step, number, "alive"));
        was_taken_ = was_taken_ || fs::exists(path(step, number, "alive"));
        fs::remove(path(step, number, "failed"));
        if (is_new) fs::remove(path(step, number, "done"));
      }
    }
    command_line::write_text_file(folder_ / "unit.sh", kScript);
    command_line::write_text_file(plan, plan_);
  }

  /// Cancels jobs of another plan until none is left: they write into the same folder.
  void end_jobs(const std::string& name) {
    for (bool told = false; true; told = true) {
      if (cancel_) throw_cancelled();
      const std::optional<std::vector<SlurmTask>> tasks = tasks_in_queue(name);
      if (tasks && tasks->empty()) return;
      if (tasks) (void)cancel_jobs(name, kForAnswer);
      if (!told)
        fmt::print(stderr,
                   "stillmap: cancels the jobs of another build to {}, and waits for their end\n",
                   build_.target.string());
      pause();
    }
  }

  /// @return nothing while Slurm does not answer.
  std::optional<std::vector<SlurmTask>> tasks_in_queue(const std::string& name) {
    const ProgramOutput output = ask({"squeue", "--noheader", "--array", "--all", "--states=all",
                                      own_jobs(), "--name=" + name, "-O", kSqueueFormat});
    if (cancel_) return std::nullopt;
    const bool answers = did_well(output);
    if (answers != answers_)
      fmt::print(
          stderr, "stillmap: Slurm {}\n",
          answers ? "answers again" : "does not answer, waiting for it: " + trimmed(output.err));
    answers_ = answers;
    if (!answers) {
      refusals_ = 0;
      return std::nullopt;
    }
    std::vector<SlurmTask> tasks = tasks_from(output.out);
    require_seen(tasks);
    std::erase_if(tasks, [](const SlurmTask& task) { return has_ended(task); });
    return tasks;
  }

  /// Jobs that squeue does not show would be submitted again at every look.
  void require_seen(const std::vector<SlurmTask>& tasks) {
    if (submitted_.empty()) return;
    const std::vector<SlurmJob> unseen = without_task(std::exchange(submitted_, {}), tasks);
    if (unseen.empty()) unseen_.clear();
    // A controller that takes the place of another may not know its last jobs: once is no fault.
    const bool is_first = unseen_.empty();
    for (const SlurmJob& job : unseen) unseen_.push_back(job.id);
    if (unseen.empty() || is_first) return;
    (void)cancel_jobs(name_, kForAnswer);
    std::vector<std::string> words{"scancel"};
    words.insert(words.end(), unseen_.begin(), unseen_.end());
    (void)ask(words);
    throw std::runtime_error(fmt::format(
        "squeue does not list the job {0}, which sbatch has just submitted, with the name {1} and "
        "the comment '{2}'; leave these as they are (see 'scontrol show job {0}' and the site's "
        "filters of jobs)",
        unseen.front().id, name_, unseen.front().step));
  }

  std::vector<StepState> states_with(const std::vector<SlurmTask>& tasks) {
    std::set<std::string> files;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder_))
      files.insert(entry.path().filename().string());
    std::vector<StepState> states;
    for (Step& step : steps_) {
      StepState& state = states.emplace_back(StepState{step.name, {}});
      state.units.resize(step.units);
      for (std::size_t number = 1; number <= step.units; ++number) {
        UnitState& unit = state.units[number - 1];
        unit.is_done = files.contains(path(step, number, "done").filename().string());
        if (files.contains(path(step, number, "failed").filename().string()))
          unit.failed = number_in(path(step, number, "failed"));
        unit.attempts = step.attempts[number];
      }
      for (SlurmTask task : tasks) {
        if (task.step != step.name || task.number < 1 || task.number > step.units) continue;
        task.waited_s = waited_s(task);
        state.units[task.number - 1].tasks.push_back(std::move(task));
      }
    }
    add_silence(states);
    return states;
  }

  /// Since it was put back, as far as this process has seen it.
  double waited_s(const SlurmTask& task) {
    if (task.state != "PENDING" || task.restarts == 0) return 0.0;
    const auto [since, is_new] = waits_.try_emplace({task.id, task.restarts}, Clock::now());
    return std::chrono::duration<double>(Clock::now() - since->second).count();
  }

  void add_silence(std::vector<StepState>& states) {
    std::map<std::string, UnitState*> running;
    std::map<std::string, std::string> signs;
    for (std::size_t i = 0; i < states.size(); ++i) {
      for (std::size_t number = 1; number <= steps_[i].units; ++number) {
        UnitState& unit = states[i].units[number - 1];
        if (std::ranges::none_of(unit.tasks,
                                 [](const SlurmTask& task) { return task.state == "RUNNING"; }))
          continue;
        const std::string name = unit_name(steps_[i], number);
        running[name] = &unit;
        signs[name] = file_text(path(steps_[i], number, "alive"));
      }
    }
    for (const auto& [name, seconds] : silence_.look(signs, Clock::now()))
      running.at(name)->silent_s = seconds;
  }

  void act(const SlurmActions& actions, const std::vector<StepState>& states) {
    for (const std::string& task : actions.start_now)
      (void)ask({"scontrol", "update", "jobid=" + task, "StartTime=now"});
    if (!actions.cancel.empty()) {
      std::vector<std::string> words{"scancel"};
      words.insert(words.end(), actions.cancel.begin(), actions.cancel.end());
      if (!did_well(ask(words))) return;
    }
    if (Clock::now() < next_submission_) return;
    const std::size_t current = first_not_done(states);
    std::string before;
    for (const SlurmSubmission& submission : actions.submit) {
      if (cancel_) return;
      std::vector<std::string> after = submission.after;
      if (!before.empty()) after.push_back(before);
      before = submit(submission, after);
      if (before.empty()) return;
      if (submission.step == current)
        for (const std::size_t number : submission.numbers)
          ++steps_[submission.step].attempts[number];
    }
  }

  /// @return the job; empty when Slurm did not take it this time.
  std::string submit(const SlurmSubmission& submission, const std::vector<std::string>& after) {
    const Step& step = steps_[submission.step];
    const Step* const earlier = submission.step > 0 ? &steps_[submission.step - 1] : nullptr;
    // Neither limits of this process nor secrets of its environment are for the jobs.
    std::vector<std::string> words{"sbatch", "--parsable", "--requeue", "--propagate=NONE",
                                   "--export=PATH,HOME,LANG,LD_LIBRARY_PATH,STILLMAP_ONNXRUNTIME"};
    constexpr std::uint64_t kMiB = 1U << 20U;
    if (build_.memory_bytes > 0)
      words.push_back(fmt::format("--mem={}M", (build_.memory_bytes + kMiB - 1) / kMiB));
    words.push_back(build_.threads > 0 ? fmt::format("--cpus-per-task={}", build_.threads)
                                       : std::string("--exclusive"));
    words.insert(words.end(), build_.options.begin(), build_.options.end());
    words.push_back("--job-name=" + name_);
    words.push_back("--comment=" + step.name);
    words.push_back(fmt::format("--output={}", log_pattern(step)));
    words.emplace_back("--open-mode=append");
    if (is_array(step))
      words.push_back(fmt::format("--array={}", fmt::join(submission.numbers, ",")));
    if (!after.empty())
      words.push_back(fmt::format("--dependency=afterany:{}", fmt::join(after, ":")));
    words.push_back((folder_ / "unit.sh").string());
    words.insert(words.end(), {folder_.string(), step.name, build_.prefix + step.name,
                               earlier != nullptr ? earlier->name : "-",
                               std::to_string(earlier != nullptr ? earlier->units : 0)});
    words.insert(words.end(), build_.command.begin(), build_.command.end());
    // Jobs that Slurm takes after `scancel` would stay.
    const ProgramOutput output = ask(words, kForSubmission);
    if (cancel_) {
      is_taken_perhaps_ = output.was_left;
      return {};
    }
    // "12", or "12;cluster"
    std::string job = output.out.substr(0, output.out.find_first_of(";\n"));
    if (did_well(output) && !job.empty()) {
      was_taken_ = true;
      refusals_ = 0;
      submitted_.push_back({job, step.name});
      return job;
    }
    ++refusals_;
    const std::string refusal = fmt::format("sbatch refused the units of the step '{}': {}",
                                            step.name, trimmed(output.err));
    if (!was_taken_ && refusals_ == kMostRefusals) {
      // One that did not answer may have been taken.
      (void)cancel_jobs(name_, kForAnswer);
      throw std::runtime_error(refusal +
                               "; change what is asked for with --slurm-option and --threads");
    }
    if (was_taken_ && refusals_ == 1)
      fmt::print(stderr,
                 "stillmap: {}; asks again, after 5 minutes at the latest. If it goes on, stop "
                 "this command, and give it again with other --slurm-option\n",
                 refusal);
    next_submission_ = Clock::now() + wait_after(refusals_);
    return {};
  }

  /// In sbatch's own form, where % begins a symbol.
  [[nodiscard]] std::string log_pattern(const Step& step) const {
    std::string pattern;
    for (const char letter : folder_.string())
      pattern += letter == '%' ? std::string("%%") : std::string(1, letter);
    return fmt::format("{}/{}{}.log", pattern, step.name, is_array(step) ? "_%a" : "");
  }

  [[noreturn]] void throw_cancelled() const {
    if (!cancel_jobs(name_, kForCancel) || is_taken_perhaps_)
      fmt::print(stderr,
                 "stillmap: Slurm may not have cancelled all jobs; see 'squeue --name={0}', and "
                 "cancel them with 'scancel --name={0}'\n",
                 name_);
    throw mapping::Cancelled();
  }

  [[noreturn]] void fail(const SlurmActions::Failure& failure) const {
    (void)cancel_jobs(name_, kForAnswer);
    const Step& step = steps_[failure.step];
    const std::string code = trimmed(file_text(path(step, failure.number, "failed")));
    const fs::path log = path(step, failure.number, "log");
    const std::string said = last_line_in(log);
    throw std::runtime_error(fmt::format(
        "the unit {} failed {}: {}; see {}, and give the same command again once that is mended",
        unit_name(step, failure.number),
        code.empty() ? fmt::format("{} times without saying why", kMostAttempts)
                     : "with exit code " + code,
        said.empty() ? "its log is empty" : said, log.string()));
  }

  /// As a build of one process tells of its stages.
  void tell(const std::vector<StepState>& states) const {
    const std::size_t now = first_not_done(states);
    const Step& step = steps_[now];
    std::optional<UnitProgress> last;
    double sum = 0.0;
    bool waits = true;
    for (std::size_t number = 1; number <= step.units; ++number) {
      const UnitState& unit = states[now].units[number - 1];
      if (unit.is_done) sum += 1.0;
      if (unit.is_done || unit.tasks.empty()) continue;
      for (const SlurmTask& task : unit.tasks) waits = waits && task.state == "PENDING";
      last = progress_in(path(step, number, "progress"), unit_name(step, number));
      if (last) sum += last->fraction;
    }
    constexpr std::size_t kParts = 1000;
    if (waits)
      progress_("waiting in Slurm's queue", 0, 0);
    else if (is_array(step))
      progress_(step.name == "survey" ? "survey" : "place",
                static_cast<std::size_t>(kParts * sum / static_cast<double>(step.units)), kParts);
    else if (last)
      progress_(last->stage, last->done, last->total);
  }

  SlurmResult finish(const std::vector<SlurmTask>& tasks) const {
    // Attempts that another one overtook.
    if (!tasks.empty()) (void)cancel_jobs(name_, kForAnswer);
    held_->set_done();
    return {file_text(path(steps_.back(), 1, "out")), held_};
  }

  const SlurmBuild& build_;
  const mapping::ProgressCallback& progress_;
  const mapping::CancelFlag& cancel_;
  fs::path folder_;
  std::shared_ptr<HeldFolder> held_;
  std::string plan_;
  std::string name_;
  std::vector<Step> steps_;
  /// When a task was first seen waiting, by how often it was put back.
  std::map<std::pair<std::string, std::size_t>, Clock::time_point> waits_;
  UnitSilence silence_;
  /// Since the last answer of squeue.
  std::vector<SlurmJob> submitted_;
  /// Numbers of jobs that it did not list.
  std::vector<std::string> unseen_;
  bool answers_ = true;
  /// Slurm has taken a job of this plan.
  bool was_taken_ = false;
  /// Slurm may have taken one after this process stopped waiting for `sbatch`.
  bool is_taken_perhaps_ = false;
  int refusals_ = 0;
  Clock::time_point next_submission_;
};

}  // namespace

void add_executor_options(CLI::App& command, ExecutorArguments& arguments) {
  auto* executor =
      command
          .add_option("--executor", arguments.executor,
                      "What does the build: process (this one), or slurm (--units shares of it, as "
                      "jobs that this process submits and follows)")
          ->capture_default_str()
          ->check(command_line::one_of({"process", "slurm"}))
          ->group(kUnitGroup);
  command
      .add_option("--slurm-option", arguments.slurm_options,
                  "An option for sbatch, such as --slurm-option=--partition=long; can be repeated")
      ->take_all()
      ->needs(executor)
      ->group(kUnitGroup);
}

std::vector<std::string> unit_command(const CLI::App& command,
                                      const std::vector<std::string>& except) {
  std::vector<std::string> left_out{"--executor", "--slurm-option", "--progress", "--progress-fd"};
  left_out.insert(left_out.end(), except.begin(), except.end());
  std::vector<std::string> words{fs::canonical("/proc/self/exe").string(), command.get_name()};
  for (std::string& word : command_line::arguments_of(command, left_out))
    words.push_back(std::move(word));
  words.insert(words.end(), {"--progress", "json", "--progress-fd", "3"});
  return words;
}

fs::path slurm_folder(const fs::path& target) { return maps::hidden_beside(target, kSlurmFolder); }

SlurmResult build_in_slurm(const SlurmBuild& build, const mapping::ProgressCallback& progress,
                           const mapping::CancelFlag& cancel) {
  if (!fs::exists(slurm_folder(build.target))) require_new(build.target);
  return SlurmJobs(build, progress, cancel).run();
}

}  // namespace stillmap::mapper
