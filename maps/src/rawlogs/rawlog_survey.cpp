#include "rawlogs/rawlog_survey.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>

#include <fmt/format.h>

#include <mutex>
#include <utility>

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

Eigen::Isometry3d pose_of(const RawlogRecord& record) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.matrix().topRows<3>() =
      Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(record.pose.data());
  return T;
}

/// Not only by what a hostile rawlog says, but by what becomes of its reader.
bool is_usable(const RawlogRecord& record) {
  if (record.text_bytes > kMostRawlogText || record.points > kMostRawlogPoints) return false;
  if (record.kind == RawlogRecordKind::kEnd) return true;
  const Eigen::Isometry3d T = pose_of(record);
  if (!T.matrix().allFinite()) return false;
  const Eigen::Matrix3d R = T.linear();
  return (R.transpose() * R - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < 1e-3;
}

/// @param take  record, text and where its points begin. @return whether the end was reached.
template <typename Take>
bool for_each_record(const UnnamedFile& file, const Take& take) {
  std::uint64_t at = 0;
  RawlogRecord record;
  while (file.read(at, &record, sizeof record) && is_usable(record)) {
    std::string text(record.text_bytes, '\0');
    const std::uint64_t points_at = at + sizeof record + record.text_bytes;
    const std::uint64_t next = points_at + std::uint64_t{record.points} * sizeof(RawlogPoint);
    if (next > file.size() || !file.read(at + sizeof record, text.data(), text.size()))
      return false;
    take(record, text, points_at);
    if (record.kind == RawlogRecordKind::kEnd) return true;
    at = next;
  }
  return false;
}

std::shared_ptr<const RawlogSurvey> survey_anew(const fs::path& file) {
  auto survey = std::make_shared<RawlogSurvey>();
  std::string broken_off = read_rawlog(file, survey->records);
  survey_records(*survey, std::move(broken_off));
  return survey;
}

}  // namespace

void survey_records(RawlogSurvey& survey, std::string broken_off) {
  const bool ended = for_each_record(
      survey.records,
      [&](const RawlogRecord& record, const std::string& text, std::uint64_t points_at) {
        if (record.kind == RawlogRecordKind::kScan) {
          survey.scans_of_label[text].push_back(
              {record.stamp_ns, pose_of(record), points_at, record.points, record.flags});
        } else if (record.kind == RawlogRecordKind::kPose && record.flags < survey.poses.size()) {
          ++survey.poses[record.flags];
        } else if (record.kind == RawlogRecordKind::kEnd) {
          broken_off = text;
          if (record.unusable > 0)
            survey.notes.push_back(fmt::format(
                "{} observations of clouds hold no points here: empty, or in files of their own",
                record.unusable));
        }
      });
  if (!ended && broken_off.empty()) broken_off = "its reader ended without a word";
  if (broken_off.empty()) return;
  std::size_t scans = 0;
  for (const auto& [label, of_label] : survey.scans_of_label) scans += of_label.size();
  survey.notes.push_back(fmt::format("the rawlog could not be read to its end: {}; {} scans could",
                                     broken_off, scans));
}

void RawlogSurvey::for_each_pose(
    RawlogPoseSource source,
    const std::function<void(std::int64_t, const Eigen::Isometry3d&)>& take) const {
  for_each_record(records, [&](const RawlogRecord& record, const std::string&, std::uint64_t) {
    if (record.kind == RawlogRecordKind::kPose &&
        record.flags == static_cast<std::uint32_t>(source) && record.stamp_ns != kNoRawlogStamp)
      take(record.stamp_ns, pose_of(record));
  });
}

std::shared_ptr<const RawlogSurvey> survey_rawlog(const fs::path& file) {
  using Key = std::tuple<std::string, std::uintmax_t, std::int64_t>;
  static std::mutex mutex;
  static std::map<Key, std::shared_ptr<const RawlogSurvey>> known;
  std::error_code error;
  const fs::path place = fs::canonical(file, error);
  const std::uintmax_t size = error ? 0 : fs::file_size(place, error);
  const auto changed = error ? fs::file_time_type{} : fs::last_write_time(place, error);
  if (error) throw StorageError(file.string(), error.message());
  const std::lock_guard lock(mutex);
  auto& survey = known[{place.string(), size, changed.time_since_epoch().count()}];
  if (!survey) survey = survey_anew(file);
  return survey;
}

}  // namespace stillmap::maps
