#include "evaluation/paper/paper_plan.hpp"

#include "evaluation/paper/paper_answers.hpp"
#include "evaluation/paper/plain_map.hpp"

#include <stillmap/mapping/localization_evaluation.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Time of a scan in each step beside the others, as measured with 64 beams; what is left to do is
/// estimated from it.
constexpr std::size_t kSimulateEffort = 3;
constexpr std::size_t kBuildEffort = 25;
constexpr std::size_t kPlainEffort = 1;
constexpr std::size_t kAskEffort = 12;

/// World and scans; two passes, cleaning and tiles.
constexpr std::size_t kSimulateStages = 2;
constexpr std::size_t kBuildStages = 4;

/// How much of one step is done, from the stages that it tells of; never goes back.
class StepProgress {
 public:
  explicit StepProgress(const PaperStep& step) : step_(step) {}

  std::size_t update(std::string_view stage, std::size_t done, std::size_t total) {
    if (stage != stage_) {
      if (!stage_.empty()) passed_ = std::min(passed_ + 1, step_.stages - 1);
      stage_ = stage;
    }
    if (total == 0) return part_;
    const std::size_t of_stage = step_.effort * std::min(done, total) / total;
    part_ = std::max(part_, (passed_ * step_.effort + of_stage) / step_.stages);
    return part_;
  }

 private:
  const PaperStep& step_;
  std::string stage_;
  std::size_t passed_ = 0;
  std::size_t part_ = 0;
};

PaperStep forget(const std::string& title, std::vector<std::filesystem::path> folders) {
  return {title, 0, 1, [folders = std::move(folders)](const ProgressCallback&) {
            for (const std::filesystem::path& folder : folders) std::filesystem::remove_all(folder);
          }};
}

}  // namespace

std::vector<PaperPlan::Open> PaperPlan::open_maps(const PaperStreet& street,
                                                  const std::vector<PaperMap>& maps) const {
  std::vector<Open> open;
  for (const PaperMap& map : maps) {
    std::vector<PaperQuestion> questions;
    for (const PaperQuestion& question : questions_of(options_)) {
      if (!read_answers(pieces_.answers(street, map, question),
                        pieces_.answers_key(street, map, question)))
        questions.push_back(question);
    }
    if (!questions.empty()) open.push_back({map, std::move(questions)});
  }
  return open;
}

std::vector<PaperStep> PaperPlan::steps(const PaperStreet& street,
                                        const std::vector<PaperMap>& maps) const {
  std::vector<PaperStep> steps;
  const std::vector<Open> open = open_maps(street, maps);
  if (open.empty()) return steps;
  add_drives(street, steps);
  std::set<std::filesystem::path> planned;
  for (std::size_t i = 0; i < open.size(); ++i) {
    if (cancel_) throw Cancelled();
    const PaperMap& map = open[i].map;
    const std::filesystem::path built = pieces_.built(street, map);
    add_map(street, map, planned.count(built) > 0, steps);
    planned.insert(built);
    for (const PaperQuestion& question : open[i].questions)
      steps.push_back(ask(street, map, question));
    if (keep_) continue;
    std::vector<std::filesystem::path> done;
    if (map.plain) done.push_back(pieces_.asked(street, map));
    const bool again =
        std::any_of(open.begin() + static_cast<std::ptrdiff_t>(i) + 1, open.end(),
                    [&](const Open& later) { return pieces_.built(street, later.map) == built; });
    if (!again) done.push_back(built);
    steps.push_back(forget(street.name + " done with " + map.name, std::move(done)));
  }
  if (!keep_ && street.seed)
    steps.push_back(forget(street.name + " done", {street.drives[0], street.drives[1]}));
  return steps;
}

void PaperPlan::add_drives(const PaperStreet& street, std::vector<PaperStep>& steps) const {
  if (!street.seed) return;
  for (const int day : {1, 2}) {
    const std::filesystem::path target = street.drives.at(static_cast<std::size_t>(day - 1));
    if (is_whole_drive(target, options_.scans)) continue;
    steps.push_back({fmt::format("{} day {}", street.name, day), options_.scans * kSimulateEffort,
                     kSimulateStages,
                     [this, seed = *street.seed, day, target](const ProgressCallback& progress) {
                       parts_.simulate(options_, {seed, day}, target, progress, cancel_);
                     }});
  }
}

void PaperPlan::add_map(const PaperStreet& street, const PaperMap& map, bool is_built,
                        std::vector<PaperStep>& steps) const {
  const std::filesystem::path built = pieces_.built(street, map);
  const std::filesystem::path asked = pieces_.asked(street, map);
  if (map.plain && whole_map(asked)) return;
  if (!is_built && !whole_map(built)) {
    steps.push_back({fmt::format("{} map {}", street.name, map.name), options_.scans * kBuildEffort,
                     kBuildStages, [this, street, map](const ProgressCallback& progress) {
                       build(street, map, progress);
                     }});
  }
  if (!map.plain) return;
  steps.push_back({fmt::format("{} map {}, all points", street.name, map.name),
                   options_.scans * kPlainEffort, 1, [built, asked](const ProgressCallback&) {
                     write_plain_map(*maps::MapPackage::open(built), asked);
                   }});
}

void PaperPlan::build(const PaperStreet& street, const PaperMap& map,
                      const ProgressCallback& progress) const {
  MapBuildOptions build = map.build;
  build.threads = options_.threads;
  if (build.projection.policy != MovablePolicy::kKeep)
    build.detector = pieces_.detector(street.drives[0]);
  (void)build_map({street.drives[0]}, pieces_.built(street, map), build, progress, cancel_,
                  parts_.make_cleaner);
}

PaperStep PaperPlan::ask(const PaperStreet& street, const PaperMap& map,
                         const PaperQuestion& question) const {
  const auto run = [this, street, map, question](const ProgressCallback& progress) {
    LocalizationEvaluationOptions options;
    options.prior = PriorSource::kPrevious;
    options.bias = BiasCorrection::kNone;
    options.threads = options_.threads;
    if (question.removed) {
      options.query_movable = MovablePolicy::kDelete;
      options.query_detector = pieces_.detector(street.drives[1]);
    }
    const auto package = maps::MapPackage::open(pieces_.asked(street, map));
    const LocalizationEvaluation evaluation = evaluate_localization(
        *package, maps::Drive::open(street.drives[1]), options,
        [&](const maps::MapPackage& of) { return parts_.make_aligner(question.method, of); },
        progress, cancel_);
    write_answers(pieces_.answers(street, map, question),
                  pieces_.answers_key(street, map, question), paper_answers(evaluation, *package));
  };
  return {fmt::format("{} {} in map {}, {} scans", street.name, question.method, map.name,
                      question.query()),
          options_.scans * kAskEffort, 1, run};
}

void run_steps(const std::vector<PaperStep>& steps, const ProgressCallback& progress,
               const CancelFlag& cancel) {
  std::size_t total = 0;
  for (const PaperStep& step : steps) total += step.effort;
  std::size_t done = 0;
  for (const PaperStep& step : steps) {
    if (cancel) throw Cancelled();
    StepProgress part(step);
    const auto tell = [&](std::string_view stage, std::size_t of_stage, std::size_t stage_total) {
      if (progress)
        progress(fmt::format("{}: {}", step.title, stage),
                 done + part.update(stage, of_stage, stage_total), total);
    };
    if (progress) progress(step.title, done, total);
    step.run(tell);
    done += step.effort;
  }
}

}  // namespace stillmap::mapping
