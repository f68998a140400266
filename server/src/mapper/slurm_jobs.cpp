#include "mapper/slurm_jobs.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <iterator>
#include <stdexcept>

#include "errors/exit_codes.hpp"

namespace stillmap::mapper {
namespace {

constexpr std::size_t kFields = 6;

std::optional<std::size_t> number_from(std::string_view text) {
  std::size_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return number;
}

bool is_end(std::string_view state) {
  constexpr std::array<std::string_view, 10> kEnds{
      "BOOT_FAIL", "CANCELLED", "COMPLETED",     "DEADLINE", "FAILED",
      "NODE_FAIL", "PREEMPTED", "OUT_OF_MEMORY", "REVOKED",  "TIMEOUT"};
  return std::ranges::find(kEnds, state) != kEnds.end();
}

SlurmTask task_from(std::string_view line) {
  std::array<std::string_view, kFields> fields;
  std::string_view rest = line;
  bool whole = true;
  for (std::string_view& field : fields) {
    const std::size_t end = rest.find('|');
    whole = whole && end != std::string_view::npos;
    field = rest.substr(0, end);
    rest.remove_prefix(whole ? end + 1 : rest.size());
  }
  const auto [job, task, state, step, reason, restarts] = fields;
  const std::optional<std::size_t> number = task == "N/A" ? 1 : number_from(task);
  const std::optional<std::size_t> requeued = number_from(restarts);
  const bool is_known = number || is_end(state);
  if (!whole || !rest.empty() || !number_from(job) || !is_known || !requeued)
    throw std::runtime_error(fmt::format(
        "squeue: found '{}', expected {}; use a Slurm of 20.02 or newer", line, kSqueueFormat));
  return {.id = task == "N/A" ? std::string(job) : fmt::format("{}_{}", job, task),
          .step = std::string(step),
          .number = number.value_or(0),
          .state = std::string(state),
          .reason = std::string(reason),
          .restarts = *requeued,
          .waited_s = 0.0};
}

/// The same would come out again.
bool is_final(int code) {
  return code == exit_code::kFailed || code == exit_code::kUsage || code == exit_code::kDiskFull;
}

/// Nothing but a person would start it again.
bool is_held(const SlurmTask& task) {
  return task.state == "PENDING" && task.reason.starts_with("launch");
}

bool is_lost(const UnitState& unit, const SlurmTask& task) {
  if (is_held(task)) return true;
  return task.state == "RUNNING" &&
         unit.silent_s > (unit.is_done ? kLostWhenDoneAfterS : kLostAfterS);
}

bool waits_for_nothing(const SlurmTask& task) {
  return task.state == "PENDING" && task.reason == "BeginTime" && task.restarts > 0 &&
         task.waited_s >= kEndedAfterS;
}

std::vector<std::string> ids_of(const StepState& step) {
  std::vector<std::string> ids;
  for (const UnitState& unit : step.units)
    for (const SlurmTask& task : unit.tasks)
      if (!is_lost(unit, task)) ids.push_back(task.id);
  return ids;
}

bool has_ended(const UnitState& unit) {
  return std::ranges::all_of(unit.tasks,
                             [&](const SlurmTask& task) { return is_lost(unit, task); });
}

/// What is not done and has no job; with `all`, what is not done.
std::vector<std::size_t> to_submit(const StepState& step, bool all) {
  std::vector<std::size_t> numbers;
  for (std::size_t i = 0; i < step.units.size(); ++i)
    if (!step.units[i].is_done && (all || has_ended(step.units[i]))) numbers.push_back(i + 1);
  return numbers;
}

std::optional<SlurmActions::Failure> failure_in(const StepState& step, std::size_t index) {
  for (const std::size_t number : to_submit(step, false)) {
    const UnitState& unit = step.units[number - 1];
    if ((unit.failed && is_final(*unit.failed)) || unit.attempts >= kMostAttempts)
      return SlurmActions::Failure{index, number};
  }
  return std::nullopt;
}

}  // namespace

std::vector<SlurmTask> tasks_from(std::string_view text) {
  std::vector<SlurmTask> tasks;
  while (!text.empty()) {
    const std::size_t end = text.find('\n');
    const std::string_view line = text.substr(0, end);
    if (!line.empty()) tasks.push_back(task_from(line));
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
  }
  return tasks;
}

bool has_ended(const SlurmTask& task) { return is_end(task.state); }

std::vector<SlurmJob> without_task(const std::vector<SlurmJob>& jobs,
                                   const std::vector<SlurmTask>& tasks) {
  std::vector<SlurmJob> missing;
  std::ranges::copy_if(jobs, std::back_inserter(missing), [&](const SlurmJob& job) {
    return std::ranges::none_of(tasks, [&](const SlurmTask& task) {
      return task.id.substr(0, task.id.find('_')) == job.id && task.step == job.step;
    });
  });
  return missing;
}

void require_usable_options(const std::vector<std::string>& options) {
  constexpr std::array<std::string_view, 4> kLong{"array", "clusters", "test-only", "wait"};
  constexpr std::string_view kShort = "aMW";
  for (const std::string& option : options) {
    const std::string_view word = std::string_view(option).substr(0, option.find('='));
    // sbatch takes the first letters of a long one, too.
    const bool is_long = word.size() > 2 && word.starts_with("--") &&
                         std::ranges::any_of(kLong, [&](std::string_view name) {
                           return name.starts_with(word.substr(2));
                         });
    const bool is_short =
        word.size() > 1 && word[0] == '-' && kShort.find(word[1]) != std::string_view::npos;
    if (is_long || is_short)
      throw std::invalid_argument(fmt::format(
          "--slurm-option: found '{}', expected none of --{}, which change the jobs or hide them "
          "from this command; leave it out",
          option, fmt::join(kLong, ", --")));
  }
}

std::size_t first_not_done(const std::vector<StepState>& steps) {
  const auto first = std::ranges::find_if(steps, [](const StepState& step) {
    return !std::ranges::all_of(step.units, &UnitState::is_done);
  });
  return static_cast<std::size_t>(first - steps.begin());
}

std::map<std::string, double> UnitSilence::look(const std::map<std::string, std::string>& signs,
                                                Clock::time_point now) {
  const auto seconds_since = [&](Clock::time_point then) {
    return std::chrono::duration<double>(now - then).count();
  };
  if (seconds_since(looked_) > kBlindAfterS) signs_.clear();
  looked_ = now;
  std::erase_if(signs_, [&](const auto& each) { return !signs.contains(each.first); });
  std::map<std::string, double> silences;
  for (const auto& [unit, text] : signs) {
    Sign& sign = signs_.try_emplace(unit, Sign{text, now}).first->second;
    if (sign.text != text) sign = {text, now};
    silences[unit] = seconds_since(sign.since);
  }
  return silences;
}

std::chrono::seconds wait_after(int refusals) {
  constexpr std::chrono::seconds kFirst{2};
  constexpr std::chrono::seconds kLongest{300};
  constexpr int kMostDoublings = 8;
  return std::min(kFirst * (1 << std::min(refusals - 1, kMostDoublings)), kLongest);
}

SlurmActions decide(const std::vector<StepState>& steps) {
  SlurmActions actions;
  const std::size_t current = first_not_done(steps);
  actions.is_finished = current == steps.size();
  if (actions.is_finished) return actions;
  actions.failure = failure_in(steps[current], current);
  if (actions.failure) return actions;
  for (const StepState& step : steps) {
    for (const UnitState& unit : step.units) {
      for (const SlurmTask& task : unit.tasks) {
        if (is_lost(unit, task)) actions.cancel.push_back(task.id);
        if (waits_for_nothing(task)) actions.start_now.push_back(task.id);
      }
    }
  }
  bool before_is_new = false;
  for (std::size_t i = current; i < steps.size(); ++i) {
    // Behind a job that is submitted, later steps wait for one that has ended: they come anew.
    const bool is_new = !actions.submit.empty();
    const std::vector<std::string> ids = ids_of(steps[i]);
    if (is_new) actions.cancel.insert(actions.cancel.end(), ids.begin(), ids.end());
    SlurmSubmission submission{.step = i, .numbers = to_submit(steps[i], is_new), .after = {}};
    if (i > current && !before_is_new) submission.after = ids_of(steps[i - 1]);
    if (!submission.numbers.empty()) actions.submit.push_back(std::move(submission));
    before_is_new = is_new;
  }
  return actions;
}

}  // namespace stillmap::mapper
