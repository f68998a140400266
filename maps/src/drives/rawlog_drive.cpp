#include "drives/rawlog_drive.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/recording_choice.hpp>

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <memory>
#include <utility>

#include <stillmap/maps/sha256.hpp>
#include "bags/bag_choice.hpp"
#include "bags/poses_near_scans.hpp"
#include "core/pose_bounds.hpp"
#include "drives/layout.hpp"
#include "drives/pose_gaps.hpp"
#include "formats/point_table.hpp"
#include "rawlogs/rawlog_survey.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

constexpr std::array<std::string_view, 3> kSources{"actions", "odometry", "robot_pose"};
constexpr double kMostOfAPoint = 1.0;

struct RawlogScans {
  std::shared_ptr<const RawlogSurvey> survey;
  const std::vector<RawlogScan>* scans = nullptr;
  std::string name;

  [[nodiscard]] std::vector<RawlogPoint> points(std::size_t number) const {
    const RawlogScan& scan = scans->at(number);
    std::vector<RawlogPoint> points(scan.points);
    if (!survey->records.read(scan.offset, points.data(), points.size() * sizeof(RawlogPoint)))
      throw StorageError(name, "the temporary file of its scans is too short");
    return points;
  }
  [[nodiscard]] DecodedScan read(std::size_t number) const {
    const std::vector<RawlogPoint> points = this->points(number);
    const std::uint32_t flags = scans->at(number).flags;
    DecodedScan decoded;
    decoded.points_in_file = points.size();
    const bool timed = (flags & kRawlogTimes) != 0 &&
                       std::all_of(points.begin(), points.end(), [](const RawlogPoint& p) {
                         return std::abs(static_cast<double>(p.time_s)) <= kMostOfAPoint;
                       });
    for (const RawlogPoint& p : points) {
      decoded.cloud.positions.emplace_back(p.x, p.y, p.z);
      if ((flags & kRawlogIntensities) != 0) decoded.cloud.intensities.push_back(p.intensity);
      if (timed) decoded.cloud.time_offsets_s.push_back(p.time_s);
    }
    decoded.dropped = drop_invalid(decoded.cloud);
    return decoded;
  }
  [[nodiscard]] std::string sha256(std::size_t number) const {
    const std::vector<RawlogPoint> points = this->points(number);
    Sha256 sum;
    sum.add(points.data(), points.size() * sizeof(RawlogPoint));
    return sum.hex();
  }
};

std::string listed(const RawlogSurvey& survey) {
  std::string text;
  for (const auto& [label, scans] : survey.scans_of_label)
    text += fmt::format("{}{} ({})", text.empty() ? "" : ", ", label, scans.size());
  return text;
}

std::vector<RecordingTopic> labels_to_choose(const RawlogSurvey& survey) {
  std::vector<RecordingTopic> topics;
  for (const auto& [label, scans] : survey.scans_of_label)
    topics.push_back({"cloud", label, "", scans.size(), ""});
  return topics;
}

const std::string& label_of(const RawlogSurvey& survey, const BagChoice& choice,
                            const std::string& name) {
  const auto& labels = survey.scans_of_label;
  if (labels.empty())
    throw InputError(
        name,
        survey.notes.empty() ? "a rawlog without clouds" : "no clouds; " + survey.notes.back(),
        "CObservationPointCloud, CObservation3DRangeScan or CObservationVelodyneScan");
  if (choice.cloud) {
    const auto found = labels.find(*choice.cloud);
    if (found == labels.end())
      throw ChoiceError({name, "clouds of " + listed(survey) + ", none of " + *choice.cloud,
                         "one of these labels"},
                        labels_to_choose(survey));
    return found->first;
  }
  if (labels.size() > 1)
    throw ChoiceError(
        {name, "clouds of " + listed(survey),
         fmt::format("one sensor's, chosen as in '{}?cloud={}'", name, labels.begin()->first)},
        labels_to_choose(survey));
  return labels.begin()->first;
}

std::optional<RawlogPoseSource> source_of(const RawlogSurvey& survey, const BagChoice& choice,
                                          const std::string& name) {
  if (choice.poses == "none") return std::nullopt;
  for (std::size_t i = kSources.size(); i-- > 0;) {
    if (choice.poses ? *choice.poses == kSources[i] : survey.poses[i] > 0)
      return static_cast<RawlogPoseSource>(i);
  }
  if (!choice.poses) return std::nullopt;
  throw InputError(name, "poses=" + *choice.poses, "poses=none, robot_pose, odometry or actions");
}

/// Sets them, and leaves out scans at the ends that have none.
void set_own_poses(Drive::Contents& contents, const RawlogScans& scans, RawlogPoseSource source,
                   std::int64_t offset_ns) {
  std::vector<std::int64_t> stamps_ns = contents.stamps_ns;
  for (std::int64_t& stamp_ns : stamps_ns)
    stamp_ns = shifted_stamp(stamp_ns, -offset_ns, scans.name);
  PosesNearScans near(stamps_ns);
  scans.survey->for_each_pose(
      source, [&](std::int64_t stamp_ns, const Eigen::Isometry3d& T) { near.add(stamp_ns, T); });
  const std::string_view what = kSources[static_cast<std::size_t>(source)];
  const Trajectory path = near.trajectory();
  set_position_step(contents, path);
  const PoseGaps gaps(path);
  ScansInGaps in_gaps;
  std::vector<std::size_t> kept;
  contents.T_map_lidar.resize(contents.stamps_ns.size(), Eigen::Isometry3d::Identity());
  for (std::size_t i = 0; i < contents.stamps_ns.size(); ++i) {
    const auto T_odom_base = path.at(stamps_ns[i]);
    if (!T_odom_base || !in_gaps.add(gaps.of(stamps_ns[i]))) continue;
    contents.T_map_lidar[i] = *T_odom_base * (*scans.scans)[i].T_base_lidar;
    const double farthest_m = contents.T_map_lidar[i].translation().cwiseAbs().maxCoeff();
    if (!(farthest_m <= kMaxPositionM))
      throw InputError(scans.name, fmt::format("scan {} at {:.3g} m by {}", i, farthest_m, what),
                       fmt::format("at most {:g} m on each axis", kMaxPositionM));
    kept.push_back(i);
  }
  if (kept.empty())
    throw InputError(
        scans.name, fmt::format("no pose of {} within 0.2 s of any scan", what),
        "poses at the scans' stamps: choose other poses with poses=SOURCE, or poses=none");
  const std::size_t without = contents.stamps_ns.size() - kept.size() - in_gaps.left_out;
  if (without > 0)
    contents.notes.push_back(
        fmt::format("{} scans left out, which have no pose of {}", without, what));
  keep_scans(contents, kept);
  in_gaps.note(contents, std::string(what));
  contents.notes.push_back(fmt::format("poses are those of {}", what));
}

void set_scans(Drive::Contents& contents, const std::shared_ptr<const RawlogScans>& scans,
               const std::string& label, const fs::path& file) {
  for (std::size_t i = 0; i < scans->scans->size(); ++i) {
    contents.scan_files.push_back(file);
    contents.stamps_ns.push_back((*scans->scans)[i].stamp_ns);
    contents.entries.numbers.push_back(i);
  }
  contents.entries.topic = label;
  contents.entries.read = [scans](std::size_t number) { return scans->read(number); };
  contents.entries.sha256 = [scans](std::size_t number) { return scans->sha256(number); };
  contents.relative_clock = contents.stamps_ns.front() < kFirstEpochStampNs;
}

fs::path file_in(const fs::path& folder) {
  const std::vector<fs::path> files = list_files(folder, ".rawlog");
  if (files.size() != 1)
    throw InputError(folder.string(), fmt::format("{} rawlogs", files.size()),
                     "one: give the file itself");
  return files.front();
}

bool begins_as_rawlog(const fs::path& file) {
  const std::unique_ptr<gzFile_s, int (*)(gzFile)> stream(::gzopen(file.c_str(), "rb"), ::gzclose);
  if (!stream) return false;
  // An object begins with the length of its class' name, whose highest bit is set, and the name.
  std::array<char, 128> head{};
  const int size = ::gzread(stream.get(), head.data(), head.size());
  if (size < 1 || (static_cast<unsigned char>(head[0]) & 0x80U) == 0) return false;
  const std::size_t length = static_cast<unsigned char>(head[0]) & 0x7FU;
  const std::string_view name =
      std::string_view(head.data() + 1, static_cast<std::size_t>(size) - 1).substr(0, length);
  return name.starts_with("mrpt::obs::C") || name.starts_with("CObservation") ||
         name.starts_with("CSensoryFrame") || name.starts_with("CActionCollection");
}

}  // namespace

bool is_rawlog(const fs::path& root) {
  std::error_code error;
  if (fs::is_directory(root, error)) return !list_files(root, ".rawlog").empty();
  return fs::is_regular_file(root, error) && begins_as_rawlog(root);
}

Drive::Contents open_rawlog_drive(const fs::path& root, std::string_view words,
                                  const PosesChoice& poses) {
  auto scans = std::make_shared<RawlogScans>();
  scans->name = root.string();
  BagChoice choice = parse_bag_choice(words, scans->name);
  const bool in_folder = fs::is_directory(root);
  if (in_folder) choice = with_choice_of_folder(std::move(choice), root);
  const fs::path file = in_folder ? file_in(root) : root;
  if (choice.pose_frame || choice.gnss)
    throw InputError(scans->name, choice.gnss ? "gnss" : "pose_frame",
                     "cloud=LABEL or poses=SOURCE of a rawlog");
  scans->survey = survey_rawlog(file);
  const std::string& label = label_of(*scans->survey, choice, scans->name);
  scans->scans = &scans->survey->scans_of_label.at(label);
  Drive::Contents contents;
  contents.layout = DriveLayout::kRawlog;
  contents.root = root;
  contents.notes = scans->survey->notes;
  set_scans(contents, scans, label, file);
  const bool timed = std::none_of(contents.stamps_ns.begin(), contents.stamps_ns.end(),
                                  [](std::int64_t stamp) { return stamp == kNoRawlogStamp; });
  if (!timed) assume_times(contents);
  const auto source = timed ? source_of(*scans->survey, choice, scans->name) : std::nullopt;
  if (poses.file) {
    set_poses(contents, *poses.file, poses.offset_ns);
  } else if (source) {
    set_own_poses(contents, *scans, *source, poses.offset_ns);
    contents.poses_have_stamps = true;
  }
  leave_out_unordered(contents);
  return contents;
}

}  // namespace stillmap::maps
