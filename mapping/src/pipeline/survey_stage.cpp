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

struct Journaled {
  SurveyedScan scan;
  /// For the journal; empty when it is there already.
  std::string record;
};

SurveyedScan from_journal(const BuildJournal& journal, const DriveSet& drives, std::size_t scan) {
  const std::optional<std::string> bytes = journal.read(scan);
  if (!bytes) throw UnusableRecord(scan, {});
  try {
    SurveyedScan surveyed = surveyed_scan_from(*bytes);
    if (surveyed.scan != scan) throw UnusableRecord(scan, {});
    const std::string sha256 = drives.sha256(scan);
    if (surveyed.sha256 == sha256) return surveyed;
  } catch (const std::invalid_argument&) {
    throw UnusableRecord(scan, {});
  }
  throw UnusableRecord(0, drives.name(scan) + " has changed");
}

Journaled journaled(SurveyedScan scan) {
  Journaled out{std::move(scan), {}};
  const StageTimer timer(out.scan.stage_seconds, "journal");
  out.record = to_bytes(out.scan);
  return out;
}

class Surveying {
 public:
  Surveying(const Build& build, BuildJournal& journal)
      : drives_(*build.drives),
        journal_(journal),
        progress_(build.task.progress),
        survey_(std::make_unique<Survey>(build.task.scratch)) {
    survey_->resumed = journal.size();
  }

  void take(Journaled next) {
    SurveyedScan& scan = next.scan;
    const bool resumed = next.record.empty();
    {
      const StageTimer timer(scan.stage_seconds, "fuse ground");
      survey_->ground.add(scan.ground_cells);
    }
    {
      const StageTimer timer(scan.stage_seconds, "obstacles");
      survey_->obstacles.add(drives_.place(scan.scan).drive, scan.obstacles);
    }
    survey_->views.append(*scan.view);
    if (!resumed) {
      const StageTimer timer(scan.stage_seconds, "journal");
      journal_.append(next.record);
    }
    survey_->sources += fmt::format("{}  {}\n", scan.sha256, drives_.name(scan.scan));
    add_to(survey_->counts, scan.counts);
    add_to(survey_->stage_seconds, scan.stage_seconds);
    survey_->is_ground.append(scan.is_ground);
    survey_->weather.append(scan.weather);
    survey_->boxes.push_back(std::move(scan.boxes));
    if (survey_->boxes.size() % kRestScans == 0) survey_->ground.rest();
    tell_progress(resumed);
  }

  std::unique_ptr<Survey> finish() {
    survey_->obstacles.finish();
    return std::move(survey_);
  }

 private:
  /// Taking over is a stage of its own: it is far faster, and would spoil the estimate of the time
  /// that is left.
  void tell_progress(bool resumed) const {
    if (!progress_) return;
    const std::size_t before = survey_->resumed;
    if (resumed)
      progress_("resume", survey_->boxes.size(), before);
    else
      progress_("survey", survey_->boxes.size() - before, drives_.size() - before);
  }

  const DriveSet& drives_;
  BuildJournal& journal_;
  const ProgressCallback& progress_;
  std::unique_ptr<Survey> survey_;
};

std::unique_ptr<Survey> surveyed(const Build& build, BuildJournal& journal) {
  const DriveSet& drives = *build.drives;
  while (true) {
    try {
      journal.keep(drives.size());
      const std::size_t found = journal.size();
      Surveying surveying(build, journal);
      process_in_order(
          drives.size(), build.task.options.threads,
          [&](std::size_t scan) -> Journaled {
            if (scan < found) return {from_journal(journal, drives, scan), {}};
            return journaled(build.scan_work->survey(scan));
          },
          [&](Journaled scan) { surveying.take(std::move(scan)); }, build.task.cancel);
      journal.complete();
      return surveying.finish();
    } catch (const UnusableRecord& unusable) {
      const std::string why = unusable.what();
      if (why.empty())
        journal.keep(unusable.keep);
      else
        journal.discard(why);
    }
  }
}

}  // namespace

PosedViews posed_views(const DriveSet& drives, const RangeViewStore& views,
                       const Eigen::Vector3d& origin) {
  PosedViews posed;
  for (std::size_t scan = 0; scan < drives.size(); ++scan) {
    Eigen::Isometry3d T = drives.T_map_scan(scan);
    T.translation() -= origin;
    posed.T_local_lidar.push_back(T);
    posed.doubts.push_back(drives.doubt(scan));
  }
  posed.read = [&views](std::size_t scan) { return views.read(scan); };
  return posed;
}

void survey_scans(Build& build) {
  const MapBuildOptions& options = build.task.options;
  build.scan_work.emplace(*build.drives, options, *build.grid);
  build.scan_work->learn(build.task.cancel);
  BuildJournal journal(build.task.journal_folder, "survey", survey_key(build));
  build.survey = surveyed(build, journal);
  add_to(build.result.stage_seconds, build.survey->stage_seconds);
  add_to(build.result.points, build.survey->counts);
  build.result.resumed_scans = build.survey->resumed;
  warn_of_discarded(journal, build.result);
}

}  // namespace stillmap::mapping
