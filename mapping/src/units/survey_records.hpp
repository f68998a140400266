#pragma once

#include "drives/drive_set.hpp"
#include "pipeline/build_journal.hpp"
#include "pipeline/scan_work.hpp"

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

namespace stillmap::mapping {

struct Build;

/// One of `shares` about equal shares of `scans` scans. @param number  in [1, shares].
[[nodiscard]] ScanRange share_of_scans(std::size_t scans, std::size_t number, std::size_t shares);

/// Name of the journal of a share.
[[nodiscard]] std::string survey_stage_name(std::size_t number, std::size_t shares);

/// What the survey units of a build wrote down. Safe from several threads.
class SurveyRecords {
 public:
  /// @param shares  survey units. @throws maps::InputError naming a unit that is not done.
  SurveyRecords(const Build& build, std::size_t shares);

  /// @throws maps::InputError when the record is broken.
  [[nodiscard]] SurveyedScan read(std::size_t scan) const;
  /// Besides, when the scan's file is not the one that was surveyed.
  [[nodiscard]] SurveyedScan read_checked(std::size_t scan) const;
  /// Of all records, as `BuildJournal::sum`.
  [[nodiscard]] std::string sum() const;

 private:
  [[nodiscard]] std::size_t share_of(std::size_t scan) const;

  const DriveSet& drives_;
  std::vector<ScanRange> ranges_;
  std::vector<std::unique_ptr<BuildJournal>> journals_;
};

}  // namespace stillmap::mapping
