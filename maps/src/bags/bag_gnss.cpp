#include "bags/bag_gnss.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "bags/place_on_earth.hpp"
#include "bags/ros_messages.hpp"
#include "formats/nmea.hpp"

namespace stillmap::maps {
namespace {

/// Fixes in the order of the bags, of very many every second, fourth, ...
class FixesOnPath {
 public:
  FixesOnPath(const Trajectory& path, const FrameTree& tree, const std::string& cloud_frame)
      : path_(path), tree_(tree), cloud_frame_(cloud_frame) {}

  void add(const GnssFix& fix) {
    if (!fix.place) {
      ++without_place_;
      return;
    }
    const auto T_map_lidar = path_.at(fix.stamp_ns, 0.0);
    if (!T_map_lidar || seen_++ % stride_ != 0) return;
    fixes_.push_back({*fix.place, *T_map_lidar * p_lidar_antenna(fix.frame_id)});
    if (fixes_.size() == kMost) thin();
  }

  [[nodiscard]] const std::vector<FixOnPath>& fixes() const { return fixes_; }
  [[nodiscard]] std::size_t without_place() const { return without_place_; }
  /// Frame of fixes that tf_static does not join to the clouds'.
  [[nodiscard]] const std::optional<std::string>& unknown_frame() const { return unknown_frame_; }
  /// Whether there are fixes that name no frame.
  [[nodiscard]] bool names_no_frame() const { return names_no_frame_; }

 private:
  static constexpr std::size_t kMost = 20'000;

  Eigen::Vector3d p_lidar_antenna(const std::string& frame) {
    // A receiver's log names none.
    if (frame.empty()) {
      names_no_frame_ = true;
      return Eigen::Vector3d::Zero();
    }
    if (frame != frame_) {
      frame_ = frame;
      const auto T = frame == cloud_frame_ ? std::optional(Eigen::Isometry3d::Identity())
                                           : tree_.T_between(cloud_frame_, frame);
      if (!T) unknown_frame_ = frame;
      p_lidar_antenna_ = T.value_or(Eigen::Isometry3d::Identity()).translation();
    }
    return p_lidar_antenna_;
  }
  void thin() {
    for (std::size_t i = 0; 2 * i < fixes_.size(); ++i) fixes_[i] = fixes_[2 * i];
    fixes_.resize(fixes_.size() / 2);
    stride_ *= 2;
  }

  const Trajectory& path_;
  const FrameTree& tree_;
  const std::string& cloud_frame_;
  std::vector<FixOnPath> fixes_;
  std::size_t seen_ = 0;
  std::size_t stride_ = 1;
  std::size_t without_place_ = 0;
  std::optional<std::string> frame_;
  Eigen::Vector3d p_lidar_antenna_ = Eigen::Vector3d::Zero();
  std::optional<std::string> unknown_frame_;
  bool names_no_frame_ = false;
};

void read_fixes(const Bags& bags, const std::string& topic, FixesOnPath& fixes) {
  constexpr std::size_t kFixBytes = 4096;
  visit_messages(
      bags, kFixBytes, [&](const BagTopic& each) { return each.name == topic; },
      [&](MessageReader& reader, const BagTopic&) { fixes.add(read_fix(reader)); });
}

Trajectory path_of(const Drive::Contents& contents) {
  std::vector<StampedPose> poses;
  for (std::size_t i = 0; i < contents.T_map_lidar.size(); ++i)
    poses.push_back({contents.stamps_ns[i], contents.T_map_lidar[i]});
  return Trajectory(std::move(poses));
}

std::string topics_of_fixes(const BagSurvey& survey) {
  std::string listed;
  for (const auto& [topic, known] : survey.topics)
    if (known.type == kNavSatFix) listed += (listed.empty() ? "" : ", ") + topic;
  return listed;
}

void read_nmea_fixes(const std::filesystem::path& file, Drive::Contents& contents,
                     FixesOnPath& fixes) {
  const NmeaTrack track = read_nmea(file, contents.stamps_ns.front(), [&](const NmeaFix& fix) {
    fixes.add({fix.stamp_ns, {}, fix.place});
  });
  const std::string name = file.filename().string();
  if (track.broken > 0)
    contents.notes.push_back(
        fmt::format("{} sentences of {} left out, which cannot be read or have "
                    "another checksum",
                    track.broken, name));
  if (track.above_sea > 0)
    contents.notes.push_back(
        fmt::format("{} fixes of {} have no geoid separation: their heights are "
                    "above the sea",
                    track.above_sea, name));
  if (!track.has_date)
    contents.notes.push_back(
        fmt::format("{} tells no date (RMC, ZDA): taken as that of the scans", name));
}

/// The chosen topic or log.
FixesOnPath chosen_fixes(Drive::Contents& contents, const Bags& bags, const BagSurvey& survey,
                         const std::string& chosen, const Trajectory& path) {
  FixesOnPath fixes(path, survey.tree, contents.entries.frame_id);
  const auto topic = survey.topics.find(chosen);
  if (topic != survey.topics.end() && topic->second.type == kNavSatFix) {
    read_fixes(bags, topic->first, fixes);
    return fixes;
  }
  if (const auto file = file_beside(contents.root, chosen)) {
    read_nmea_fixes(*file, contents, fixes);
    return fixes;
  }
  const std::string listed = topics_of_fixes(survey);
  throw InputError(
      contents.root.string(),
      fmt::format("no GNSS on {}; there is {}", chosen, listed.empty() ? "none" : listed),
      fmt::format("a topic of {}, or the name of an NMEA log beside the bag: choose one that is "
                  "there, or leave out gnss",
                  kNavSatFix));
}

}  // namespace

void place_by_gnss(Drive::Contents& contents, const Bags& bags, const BagSurvey& survey,
                   const BagChoice& choice, const std::string& name) {
  const std::string listed = topics_of_fixes(survey);
  if (!choice.gnss) {
    if (!listed.empty() && !contents.T_map_lidar.empty())
      contents.notes.push_back(fmt::format(
          "GNSS on {}: not taken; gnss=TOPIC turns the map to east and north by it", listed));
    return;
  }
  if (contents.T_map_lidar.empty())
    throw InputError(
        name, "gnss without poses",
        "poses, which it brings to their place: choose poses=TOPIC, or leave out gnss");
  const Trajectory path = path_of(contents);
  const FixesOnPath fixes = chosen_fixes(contents, bags, survey, *choice.gnss, path);
  const PlaceOnEarth place = place_on_earth(fixes.fixes(), name + " " + *choice.gnss);
  for (Eigen::Isometry3d& T : contents.T_map_lidar) T = place.T_enu_map * T;
  if (contents.path) {
    std::vector<StampedPose> poses = contents.path->poses();
    for (StampedPose& pose : poses) pose.T_map_lidar = place.T_enu_map * pose.T_map_lidar;
    contents.path = std::make_shared<const Trajectory>(std::move(poses));
  }
  contents.origin = place.origin;
  const Eigen::Matrix3d turn = place.T_enu_map.linear();
  contents.notes.push_back(fmt::format(
      "placed on the Earth by {} fixes of {}, {:.2f} m off the poses at the median: turned by "
      "{:.2f} deg to east and north",
      fixes.fixes().size(), *choice.gnss, place.residual_m,
      std::atan2(turn(1, 0), turn(0, 0)) * 180.0 / std::numbers::pi));
  if (fixes.without_place() > 0)
    contents.notes.push_back(
        fmt::format("{} messages of {} left out, which have no fix or altitude",
                    fixes.without_place(), *choice.gnss));
  if (fixes.unknown_frame())
    contents.notes.push_back(
        fmt::format("tf_static has no place of '{}' of {}: taken as that of the lidar",
                    *fixes.unknown_frame(), *choice.gnss));
  if (fixes.names_no_frame())
    contents.notes.push_back(fmt::format(
        "{} does not say where its antenna stands: taken to stand at the lidar", *choice.gnss));
}

}  // namespace stillmap::maps
