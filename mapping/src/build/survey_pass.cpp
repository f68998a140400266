#include "build/survey_pass.hpp"

#include "build/ordered_pipeline.hpp"

#include <fmt/format.h>

#include <utility>

namespace stillmap::mapping {

std::unique_ptr<Survey> survey_scans(const DriveSet& drives, const ScanStages& stages,
                                     const std::filesystem::path& scratch, int threads,
                                     const ProgressCallback& progress, const CancelFlag& cancel) {
  auto survey = std::make_unique<Survey>(scratch);
  process_in_order(
      drives.size(), threads, [&](std::size_t scan) { return stages.survey(scan); },
      [&](SurveyedScan scan) {
        {
          const StageTimer timer(scan.stage_seconds, "fuse ground");
          survey->ground.add(scan.ground_cells);
        }
        {
          const StageTimer timer(scan.stage_seconds, "obstacles");
          survey->obstacles.add(drives.place(scan.scan).drive, scan.obstacles);
        }
        survey->views.append(*scan.view);
        survey->sources +=
            fmt::format("{}  {}\n", scan.sha256, drives.file(scan.scan).filename().string());
        add_to(survey->counts, scan.counts);
        add_to(survey->stage_seconds, scan.stage_seconds);
        survey->scans.push_back({std::move(scan.is_ground), std::move(scan.boxes)});
        if (progress) progress("survey", survey->scans.size(), drives.size());
      },
      cancel);
  survey->obstacles.finish();
  return survey;
}

}  // namespace stillmap::mapping
