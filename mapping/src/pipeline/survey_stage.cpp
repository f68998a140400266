#include "pipeline/survey_stage.hpp"

#include "core/ordered_pipeline.hpp"
#include "pipeline/build.hpp"
#include "pipeline/build_journal.hpp"
#include "pipeline/build_key.hpp"
#include "pipeline/build_warnings.hpp"
#include "pipeline/surveyed_scan_bytes.hpp"

#include <fmt/format.h>

#include <optional>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

/// A record cannot be used; the survey begins again with those before it.
struct UnusableRecord : std::runtime_error {
  /// @param why  empty: broken bytes, as a power cut leaves them.
  UnusableRecord(std::size_t keep_records, const std::string& why)
      : std::runtime_error(why), keep(keep_records) {}
  std::size_t keep;
};

/// @param journal  of the scans from `first` on.
SurveyedScan from_journal(const BuildJournal& journal, std::size_t first, const DriveSet& drives,
                          std::size_t scan) {
  const std::size_t record = scan - first;
  const std::optional<std::string> bytes = journal.read(record);
  if (!bytes) throw UnusableRecord(record, {});
  try {
    SurveyedScan surveyed = surveyed_scan_from(*bytes);
    if (surveyed.scan != scan) throw UnusableRecord(record, {});
    const std::string sha256 = drives.sha256(scan);
    if (surveyed.sha256 == sha256) return surveyed;
  } catch (const std::invalid_argument&) {
    throw UnusableRecord(record, {});
  }
  throw UnusableRecord(0, drives.name(scan) + " has changed");
}

struct Journaled {
  SurveyedScan scan;
  /// For the journal; empty when it is there already.
  std::string record;
};

Journaled journaled(SurveyedScan scan) {
  Journaled out{std::move(scan), {}};
  const StageTimer timer(out.scan.stage_seconds, "journal");
  out.record = to_bytes(out.scan);
  return out;
}

/// Gathers what was found, scan by scan.
class Gathering {
 public:
  explicit Gathering(const Build& build)
      : drives_(*build.drives), survey_(std::make_unique<Survey>(build.task.scratch)) {}

  void take(SurveyedScan scan) {
    {
      const StageTimer timer(scan.stage_seconds, "fuse ground");
      survey_->ground.add(scan.ground_cells);
    }
    {
      const StageTimer timer(scan.stage_seconds, "obstacles");
      survey_->obstacles.add(drives_.place(scan.scan).drive, scan.obstacles);
    }
    survey_->views.append(*scan.view);
    survey_->sources += fmt::format("{}  {}\n", scan.sha256, drives_.name(scan.scan));
    add_to(survey_->counts, scan.counts);
    add_to(survey_->stage_seconds, scan.stage_seconds);
    survey_->is_ground.append(scan.is_ground);
    survey_->weather.append(scan.weather);
    survey_->box_count += scan.boxes.size();
    survey_->boxes.push_back(std::move(scan.boxes));
    if (survey_->boxes.size() % kRestScans == 0) survey_->ground.rest();
  }

  std::unique_ptr<Survey> finish() {
    survey_->obstacles.finish();
    return std::move(survey_);
  }

 private:
  const DriveSet& drives_;
  std::unique_ptr<Survey> survey_;
};

/// Surveys a range of scans once, from what the journal has. @return null when nothing is kept.
/// @throws UnusableRecord.
std::unique_ptr<Survey> surveyed_from(const Build& build, ScanRange range, BuildJournal& journal,
                                      bool gathers) {
  const std::size_t found = journal.size();
  std::optional<Gathering> gathering;
  if (gathers) gathering.emplace(build);
  std::size_t taken = 0;
  process_in_order(
      range.size(), build.task.options.threads,
      [&](std::size_t i) -> Journaled {
        const std::size_t scan = range.begin + i;
        if (i < found) return {from_journal(journal, range.begin, *build.drives, scan), {}};
        return journaled(build.scan_work->survey(scan));
      },
      [&](Journaled next) {
        // Taking over is a stage of its own: it is far faster, and would spoil the estimate of the
        // time that is left.
        const bool resumed = ++taken <= found;
        if (!resumed) {
          const StageTimer timer(next.scan.stage_seconds, "journal");
          journal.append(next.record);
        }
        if (gathering) gathering->take(std::move(next.scan));
        if (resumed)
          build.tell("resume", taken, found);
        else
          build.tell("survey", taken - found, range.size() - found);
      },
      build.task.cancel);
  journal.complete();
  if (!gathering) return nullptr;
  std::unique_ptr<Survey> survey = gathering->finish();
  survey->resumed = found;
  return survey;
}

/// Surveys a range of scans, or takes what the journal has of it, and writes down what it has not.
/// @param gathers  whether what was found is kept.
std::unique_ptr<Survey> surveyed(const Build& build, ScanRange range, BuildJournal& journal,
                                 bool gathers) {
  journal.keep(range.size());
  while (true) {
    try {
      return surveyed_from(build, range, journal, gathers);
    } catch (const UnusableRecord& unusable) {
      const std::string why = unusable.what();
      if (why.empty())
        journal.keep(unusable.keep);
      else
        journal.discard(why);
    }
  }
}

void set_survey(Build& build, std::unique_ptr<Survey> survey) {
  build.survey = std::move(survey);
  add_to(build.result.stage_seconds, build.survey->stage_seconds);
  add_to(build.result.points, build.survey->counts);
  build.result.resumed_scans = build.survey->resumed;
}

}  // namespace

Survey::Survey(const std::filesystem::path& scratch)
    : is_ground(scratch),
      weather(scratch),
      ground(scratch),
      obstacles(scratch),
      views(scratch),
      found([this](std::size_t scan) {
        return FoundInScan{is_ground.read(scan), weather.read(scan)};
      }),
      view([this](std::size_t scan) { return views.read(scan); }) {}

PosedViews posed_views(const DriveSet& drives, const Survey& survey,
                       const Eigen::Vector3d& origin) {
  PosedViews posed;
  for (std::size_t scan = 0; scan < drives.size(); ++scan) {
    Eigen::Isometry3d T = drives.T_map_scan(scan);
    T.translation() -= origin;
    posed.T_local_lidar.push_back(T);
    posed.doubts.push_back(drives.doubt(scan));
  }
  posed.read = [&survey](std::size_t scan) { return survey.view(scan); };
  return posed;
}

void survey_scans(Build& build) {
  build.scan_work.emplace(*build.drives, build.task.options, *build.grid);
  build.scan_work->learn({0, build.drives->size()}, build.task.cancel);
  BuildJournal journal(build.task.journal_folder, "survey", survey_key(build));
  set_survey(build, surveyed(build, {0, build.drives->size()}, journal, true));
  warn_of_discarded(journal, build.result);
}

void survey_range(Build& build, ScanRange range, const std::string& stage) {
  build.scan_work.emplace(*build.drives, build.task.options, *build.grid);
  build.scan_work->learn(range, build.task.cancel);
  BuildJournal journal(build.task.journal_folder, stage, survey_key(build));
  (void)surveyed(build, range, journal, false);
  warn_of_discarded(journal, build.result);
}

void gather_survey(Build& build, const std::function<SurveyedScan(std::size_t scan)>& read) {
  Gathering gathering(build);
  const std::size_t scans = build.drives->size();
  std::size_t taken = 0;
  process_in_order(
      scans, build.task.options.threads, read,
      [&](SurveyedScan scan) {
        gathering.take(std::move(scan));
        build.tell("resume", ++taken, scans);
      },
      build.task.cancel);
  set_survey(build, gathering.finish());
}

}  // namespace stillmap::mapping
