#include "pipeline/survey_records.hpp"

#include "pipeline/build.hpp"
#include "pipeline/build_key.hpp"
#include "pipeline/surveyed_scan_bytes.hpp"

#include <stillmap/mapping/build_units.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <optional>

namespace stillmap::mapping {

ScanRange share_of_scans(std::size_t scans, std::size_t number, std::size_t shares) {
  return {scans * (number - 1) / shares, scans * number / shares};
}

std::string survey_stage_name(std::size_t number, std::size_t shares) {
  return fmt::format("{}_{}_of_{}", kWholeSurvey, number, shares);
}

SurveyedScan surveyed_before(const BuildJournal& journal, std::size_t first, const DriveSet& drives,
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

SurveyRecords::SurveyRecords(const Build& build, std::size_t shares) : drives_(*build.drives) {
  const std::string key = survey_key(build);
  for (std::size_t number = 1; number <= shares; ++number) {
    ranges_.push_back(share_of_scans(drives_.size(), number, shares));
    journals_.push_back(std::make_unique<BuildJournal>(build.task.journal_folder,
                                                       survey_stage_name(number, shares), key,
                                                       BuildJournal::Use::kRead));
    journals_.back()->require_complete(name_of(BuildUnit{BuildUnit::Kind::kSurvey, number}));
  }
}

SurveyedScan SurveyRecords::read(std::size_t scan) const {
  const auto range = std::find_if(ranges_.begin(), ranges_.end(),
                                  [scan](const ScanRange& each) { return scan < each.end; });
  const auto share = static_cast<std::size_t>(range - ranges_.begin());
  try {
    return surveyed_before(*journals_.at(share), range->begin, drives_, scan);
  } catch (const UnusableRecord& unusable) {
    const std::string why = unusable.what();
    throw maps::InputError(
        drives_.name(scan), why.empty() ? "a broken record of its survey" : why,
        fmt::format("the scan that was surveyed: do --unit {} and all units after it again",
                    name_of(BuildUnit{BuildUnit::Kind::kSurvey, share + 1})));
  }
}

std::string SurveyRecords::sum() const {
  std::string sums;
  for (const auto& journal : journals_) sums += journal->sum();
  return maps::sha256_of(sums);
}

}  // namespace stillmap::mapping
