#include <stillmap/mapping/paper_evaluation.hpp>

#include "evaluation/paper/paper_answers.hpp"
#include "evaluation/paper/paper_figures.hpp"
#include "evaluation/paper/paper_pieces.hpp"
#include "evaluation/paper/paper_plan.hpp"
#include "evaluation/require_once.hpp"

#include <stillmap/mapping/detector.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <iterator>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

using Clock = std::chrono::steady_clock;

void require_usable(const PaperEvaluationOptions& options, const PaperParts& parts) {
  if (const auto broken = options.violations(); !broken.empty())
    throw std::invalid_argument(fmt::format("{}", fmt::join(broken, "; ")));
  if (options.detector != "boxes") (void)make_detector(options.detector, 0);
  if (!parts.make_aligner || (options.drives.empty() && !parts.simulate))
    throw std::invalid_argument("paper: parts without a simulator or an aligner");
}

void make_folders(const std::filesystem::path& work) {
  for (const char* name : {"drives", "maps", "answers"})
    std::filesystem::create_directories(work / name);
}

}  // namespace

std::vector<std::string> PaperEvaluationOptions::violations() const {
  std::vector<std::string> broken;
  if (seeds.empty() && drives.empty()) broken.emplace_back("seeds: none, at least one");
  if (methods.empty()) broken.emplace_back("methods: none, at least one");
  require_once("seeds", seeds, broken);
  require_once("methods", methods, broken);
  if (scans < 3 || scans > 10000) broken.push_back(fmt::format("scans: {}, in [3, 10000]", scans));
  if (threads < 0 || threads > 256)
    broken.push_back(fmt::format("threads: {}, in [0, 256]", threads));
  if (detector.starts_with("boxes:"))
    broken.push_back(fmt::format("detector: {}, a name, or boxes for the drives' own", detector));
  return broken;
}

PaperEvaluation evaluate_paper(const PaperEvaluationOptions& options, const PaperParts& parts,
                               const std::filesystem::path& work, bool keep,
                               const ProgressCallback& progress, const CancelFlag& cancel) {
  const Clock::time_point began = Clock::now();
  require_usable(options, parts);
  const std::vector<PaperMap> maps = paper_maps(options.maps, parts.cleaners);
  make_folders(work);
  const PaperPieces pieces(options, work);
  const std::vector<PaperStreet> streets = pieces.streets();
  const PaperPlan plan(options, parts, pieces, keep, cancel);
  std::vector<PaperStep> steps;
  for (const PaperStreet& street : streets) {
    std::vector<PaperStep> more = plan.steps(street, maps);
    std::move(more.begin(), more.end(), std::back_inserter(steps));
  }
  run_steps(steps, progress, cancel);

  PaperEvaluation evaluation;
  evaluation.options = options;
  for (const PaperStreet& street : streets) evaluation.streets.push_back(street.name);
  for (const PaperQuestion& question : questions_of(options)) {
    for (const PaperMap& map : maps) {
      PaperRow& row = evaluation.rows.emplace_back();
      row.method = question.method;
      row.query = question.query();
      row.map = map.name;
      for (const PaperStreet& street : streets)
        row.streets.push_back(read_answers(pieces.answers(street, map, question),
                                           pieces.answers_key(street, map, question))
                                  .value());
    }
  }
  judge(evaluation);
  evaluation.seconds = std::chrono::duration<double>(Clock::now() - began).count();
  return evaluation;
}

}  // namespace stillmap::mapping
