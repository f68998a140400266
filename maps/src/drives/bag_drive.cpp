#include "drives/bag_drive.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/lidar_set.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/recording_choice.hpp>
#include <stillmap/maps/text.hpp>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <type_traits>
#include <utility>

#include "bags/bag_choice.hpp"
#include "bags/bag_gnss.hpp"
#include "bags/bag_imu.hpp"
#include "bags/bag_poses.hpp"
#include "bags/bag_survey.hpp"
#include "bags/cloud_messages.hpp"
#include "bags/ouster_packets.hpp"
#include "bags/ros_messages.hpp"
#include "bags/unpacked_bag.hpp"
#include "bags/velodyne_scan.hpp"
#include "drives/bag_files.hpp"
#include "drives/joined_lidars.hpp"
#include "drives/layout.hpp"
#include "drives/pose_gaps.hpp"
#include "formats/pose_table.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

/// What reads the scans when they are asked for.
struct BagScans {
  std::shared_ptr<const Bags> bags;
  std::string topic;
  /// Nothing for an Ouster's packets, of which several are a scan.
  const CloudType* type = nullptr;
  /// Of the calibration that was chosen; empty without.
  std::vector<VelodyneLaser> lasers;
  /// Why it is not used, if it is that of another lidar; else empty.
  std::string lasers_note;
  std::vector<CloudEntry> clouds;
  std::vector<MessagePlace> packets;
  std::optional<OusterSensor> ouster;

  [[nodiscard]] DecodedScan read(std::size_t number) const {
    if (ouster) {
      const CloudEntry& cloud = clouds.at(number);
      return decode_ouster_turn(
          *bags->at(cloud.bag),
          {packets_of(cloud), cloud.serialization, cloud.stamp_ns, name_of(number)}, *ouster);
    }
    return read_by(number, [this](MessageReader& reader) { return type->decode(reader, lasers); });
  }
  [[nodiscard]] bool is_velodyne() const { return type == cloud_type(kVelodyneScan); }
  [[nodiscard]] bool can_read_first() const {
    try {
      (void)read(0);
    } catch (const InputError&) {
      return false;
    }
    return true;
  }
  /// Empty where the first cloud cannot be read.
  [[nodiscard]] std::vector<std::string> fields() const {
    if (ouster)
      return {fmt::format("packets {} x {}", clouds.front().packets, ouster->packet_bytes())};
    try {
      return read_by(0, type->fields);
    } catch (const InputError&) {
      return {};
    }
  }
  [[nodiscard]] std::string sha256(std::size_t number) const {
    const CloudEntry& cloud = clouds.at(number);
    if (!ouster) return sha256_of(text_of(bytes(number)));
    std::string all;
    for (const MessagePlace& place : packets_of(cloud))
      all += text_of(bags->at(cloud.bag)->read(place));
    return sha256_of(all);
  }

 private:
  template <typename Decode>
  std::invoke_result_t<const Decode&, MessageReader&> read_by(std::size_t number,
                                                              const Decode& decode) const {
    const CloudEntry& cloud = clouds.at(number);
    const FileBytes message = bytes(number);
    MessageReader reader(message.span(), cloud.serialization, name_of(number));
    return decode(reader);
  }
  [[nodiscard]] std::string name_of(std::size_t number) const {
    return fmt::format("{} {} {}", bags->at(clouds.at(number).bag)->file().string(), topic, number);
  }
  [[nodiscard]] std::span<const MessagePlace> packets_of(const CloudEntry& cloud) const {
    return std::span(packets).subspan(cloud.first_packet, cloud.packets);
  }
  static std::string text_of(const FileBytes& bytes) {
    return {reinterpret_cast<const char*>(bytes.span().data()), bytes.span().size()};
  }
  [[nodiscard]] FileBytes bytes(std::size_t number) const {
    const CloudEntry& cloud = clouds.at(number);
    return bags->at(cloud.bag)->read(cloud.place);
  }
};

std::string listed(const BagSurvey& survey, bool clouds_only) {
  constexpr std::size_t kMost = 40;
  std::string text;
  std::size_t number = 0;
  for (const auto& [topic, known] : survey.topics) {
    if (clouds_only && known.clouds.empty()) continue;
    if (number++ == kMost) return text + " ...";
    text += text.empty() ? "" : ", ";
    text += clouds_only ? fmt::format("{} ({} clouds in '{}')", topic, known.clouds.size(),
                                      known.frames.front())
                        : fmt::format("{} of {}", topic, known.type);
  }
  return text.empty() ? "none" : text;
}

/// The one topic of clouds, or the one that was chosen.
const std::string& cloud_topic(const BagSurvey& survey, const std::optional<std::string>& chosen,
                               const std::string& name) {
  const std::string* found = nullptr;
  for (const auto& [topic, known] : survey.topics) {
    if (known.clouds.empty() || (chosen && *chosen != topic)) continue;
    if (found != nullptr)
      throw InputError(name, "clouds on " + listed(survey, true),
                       fmt::format("one topic, chosen as in '{0}?cloud={1}', or several lidars as "
                                   "one, '{0}?cloud={1},{2}'",
                                   name, *found, topic));
    found = &topic;
  }
  if (found != nullptr) return *found;
  std::string text = chosen ? "no clouds on " + *chosen : "no clouds";
  text += "; topics are " + listed(survey, false);
  for (const auto& [topic, known] : survey.topics)
    if (cloud_type(known.type) != nullptr && known.unreadable > 0)
      text += "; " + unreadable_text(topic, known);
  if (survey.damage.parts > 0) text += "; not readable " + survey.damage.first;
  throw InputError(name, text,
                   "messages of sensor_msgs/msg/PointCloud2, Livox' CustomMsg, VelodyneScan or "
                   "Ouster's PacketMsg: "
                   "choose or record a topic of them");
}

std::optional<PointsFrame> points_frame_of(const BagChoice& choice, const std::string& name) {
  if (!choice.points) return std::nullopt;
  const auto frame = parse_points_frame(*choice.points);
  if (!frame)
    throw InputError(name, "'points=" + *choice.points + "'", "points=map or points=sensor");
  return frame;
}

void set_notes(Drive::Contents& contents, const BagScans& scans, const BagSurvey& survey) {
  const TopicSurvey& topic = survey.topics.at(scans.topic);
  for (const auto& bag : *scans.bags)
    contents.notes.insert(contents.notes.end(), bag->notes().begin(), bag->notes().end());
  if (survey.damage.parts > 0)
    contents.notes.push_back(
        fmt::format("{} parts of the bag could not be read, the first {}; {} "
                    "scans could",
                    survey.damage.parts, survey.damage.first, scans.clouds.size()));
  for (const FrameTree::Step& step : survey.tree.steps_above(topic.frames.front())) {
    if (std::ranges::find(survey.settled_frames, step.child) != survey.settled_frames.end())
      contents.notes.push_back(
          fmt::format("tf repeats the place of '{}' in '{}' without a change: taken as rigid",
                      step.child, step.parent));
  }
  if (topic.unreadable > 0) contents.notes.push_back(unreadable_text(scans.topic, topic));
  if (!scans.lasers_note.empty()) contents.notes.push_back(scans.lasers_note);
}

void set_scans(Drive::Contents& contents, const std::shared_ptr<const BagScans>& scans,
               bool takes_recorded) {
  for (std::size_t i = 0; i < scans->clouds.size(); ++i) {
    const CloudEntry& cloud = scans->clouds[i];
    contents.scan_files.push_back(scans->bags->at(cloud.bag)->file());
    contents.stamps_ns.push_back(takes_recorded ? cloud.recorded_ns : cloud.stamp_ns);
    contents.entries.numbers.push_back(i);
  }
  contents.entries.topic = scans->topic;
  contents.entries.fields = scans->fields();
  contents.entries.read = [scans](std::size_t number) { return scans->read(number); };
  contents.entries.sha256 = [scans](std::size_t number) { return scans->sha256(number); };
  if (takes_recorded)
    contents.notes.emplace_back(
        "stamps are when the recorder got the clouds, some time after they were taken; if the "
        "poses "
        "then lie behind, build with --pose-time-offset auto");
  keep_one_clock(contents);
}

/// When the scans were taken, by the clock of the poses.
std::vector<std::int64_t> taken_at(const Drive::Contents& contents, std::int64_t offset_ns) {
  std::vector<std::int64_t> stamps_ns = contents.stamps_ns;
  for (std::int64_t& stamp_ns : stamps_ns)
    stamp_ns = shifted_stamp(stamp_ns, -offset_ns, contents.root);
  return stamps_ns;
}

/// A place is as well known as its least known factor.
PoseGaps::Place worst_place(const std::vector<PoseGaps>& gaps, std::int64_t stamp_ns) {
  PoseGaps::Place worst = PoseGaps::Place::kKnown;
  for (const PoseGaps& each : gaps) worst = std::max(worst, each.of(stamp_ns));
  return worst;
}

/// From when to when the poses' clock goes, by the factor with the fewest.
std::string range_text(const BagPoses& poses) {
  const Trajectory* moving = nullptr;
  for (const BagPoses::Factor& factor : poses.factors)
    if (factor.is_moving() && !factor.moving.poses().empty() &&
        (moving == nullptr || factor.moving.size() < moving->size()))
      moving = &factor.moving;
  if (moving == nullptr) return "none";
  return fmt::format("from {} to {}", seconds_text(moving->poses().front().stamp_ns),
                     seconds_text(moving->poses().back().stamp_ns));
}

/// Recorders of scans and poses start and end apart: scans at the ends may have no pose.
void set_bag_poses(Drive::Contents& contents, const BagPoses& poses, std::int64_t offset_ns) {
  std::vector<PoseGaps> gaps;
  for (const BagPoses::Factor& factor : poses.factors) gaps.emplace_back(factor.moving);
  ScansInGaps in_gaps;
  std::vector<std::size_t> kept;
  for (std::size_t i = 0; i < contents.stamps_ns.size(); ++i) {
    const std::int64_t stamp_ns = contents.stamps_ns[i] - offset_ns;
    const auto T = poses.T_map_lidar(stamp_ns);
    if (T && in_gaps.add(worst_place(gaps, stamp_ns))) {
      kept.push_back(i);
      contents.T_map_lidar.push_back(*T);
    } else {
      contents.T_map_lidar.push_back(Eigen::Isometry3d::Identity());
    }
  }
  if (kept.empty())
    throw InputError(
        contents.root.string(),
        fmt::format("no pose of {} within 0.2 s of any scan: the poses are {}, the "
                    "scans from {} to {}",
                    poses.source, range_text(poses), seconds_text(contents.stamps_ns.front()),
                    seconds_text(contents.stamps_ns.back())),
        fmt::format("poses at the scans' stamps: if the clocks differ, add stamps=recorded behind "
                    "the drive's path, as in '{}?stamps=recorded', for the recorder's times of the "
                    "scans, or build with --pose-time-offset SECONDS; else choose another topic "
                    "with poses=TOPIC, or poses=none",
                    contents.root.string()));
  const std::size_t without = contents.stamps_ns.size() - kept.size() - in_gaps.left_out;
  if (without > 0)
    contents.notes.push_back(
        fmt::format("{} scans left out, which have no pose of {}", without, poses.source));
  keep_scans(contents, kept);
  in_gaps.note(contents, poses.source);
  contents.notes.insert(contents.notes.end(), poses.notes.begin(), poses.notes.end());
  contents.notes.push_back("poses are those of " + poses.source);
  for (const BagPoses::Factor& factor : poses.factors)
    if (factor.is_moving() && contents.position_step_m.isZero())
      set_position_step(contents, factor.moving);
}

/// The topics of `cloud=/front,/rear`; none without commas.
std::vector<std::string> chosen_clouds(const BagChoice& choice, const std::string& name) {
  if (!choice.cloud || choice.cloud->find(',') == std::string::npos) return {};
  std::vector<std::string> topics;
  for (const std::string_view topic : split_cells(*choice.cloud, ',')) topics.emplace_back(topic);
  const std::set<std::string> once(topics.begin(), topics.end());
  if (topics.size() < 2 || topics.size() > kMostLidars || once.size() < topics.size() ||
      once.contains(""))
    throw InputError(name, "'cloud=" + choice.cloud->substr(0, 100) + "'",
                     fmt::format("one topic, or 2 to {} with commas between them, each once: "
                                 "correct cloud=",
                                 kMostLidars));
  return topics;
}

/// Of several lidars a calibration may be that of one. The others have the angles of their model.
void keep_fitting_lasers(BagScans& scans, const std::string& calibration) {
  if (scans.lasers.empty() || scans.can_read_first()) return;
  std::vector<VelodyneLaser> lasers = std::exchange(scans.lasers, {});
  if (scans.can_read_first())
    scans.lasers_note = fmt::format(
        "{} has {} lasers and is not used for {}: its sensor is another one, whose "
        "lasers have the angles of its manual",
        calibration, lasers.size(), scans.topic);
  else
    scans.lasers = std::move(lasers);  // what is broken is said where it is read
}

/// Takes the clouds of a topic out of the survey.
std::shared_ptr<BagScans> scans_on_topic(const std::shared_ptr<const Bags>& bags, BagSurvey& survey,
                                         const std::optional<std::string>& chosen,
                                         const std::string& name) {
  auto scans = std::make_shared<BagScans>();
  scans->bags = bags;
  scans->topic = cloud_topic(survey, chosen, name);
  TopicSurvey& clouds = survey.topics.at(scans->topic);
  scans->clouds = std::exchange(clouds.clouds, {});
  scans->type = cloud_type(clouds.type);
  scans->packets = std::exchange(clouds.packets, {});
  if (clouds.frames.size() != 1)
    throw InputError(name,
                     fmt::format("clouds on {} in '{}' and '{}'", scans->topic, clouds.frames[0],
                                 clouds.frames[1]),
                     "one frame: choose another topic with cloud=TOPIC, or record each frame on a "
                     "topic of its own");
  if (clouds.livox_lidars.size() > 1)
    throw InputError(name,
                     fmt::format("clouds of lidars {} on {}", fmt::join(clouds.livox_lidars, ", "),
                                 scans->topic),
                     "one lidar: choose another topic with cloud=TOPIC, or record each lidar on a "
                     "topic of its own (multi_topic 1 of Livox' driver)");
  return scans;
}

/// Clouds that are registered by their frames: whether their points are, told by the scans.
/// @return whether the poses can be used.
bool set_points_frame(Drive::Contents& contents, const BagPoses& poses,
                      const std::optional<PointsFrame>& chosen) {
  if (!poses.T_map_points && chosen != PointsFrame::kMap) return true;
  std::optional<PointsFrameOverlap> overlap;
  if (!chosen)
    overlap = overlap_by_points_frame(contents, contents.T_map_lidar, *poses.T_map_points);
  const std::optional<PointsFrame> found = chosen || !overlap ? chosen : overlap->frame();
  if (poses.only_if_overlapping && found != PointsFrame::kMap) return false;
  std::string shares = chosen ? "as was chosen" : "as their messages say";
  if (overlap)
    shares = fmt::format("scans overlap by {:.0f} % so, and by {:.0f} % as points of the sensor",
                         100.0 * overlap->as_map, 100.0 * overlap->as_sensor);
  if (!poses.T_map_points) {
    read_points_from_map(contents);
    contents.notes.push_back(fmt::format(
        "points of {} are taken in the frame of the poses, as was chosen", contents.entries.topic));
    return true;
  }
  const std::string clouds = fmt::format("clouds of {} name '{}', the frame that the poses are in",
                                         contents.entries.topic, contents.entries.frame_id);
  if (found == PointsFrame::kSensor) {
    contents.notes.push_back(
        fmt::format("{}, but are taken as points of the sensor ({}); points=map decides otherwise",
                    clouds, shares));
    return true;
  }
  read_points_from_map(contents, *poses.T_map_points);
  contents.notes.push_back(fmt::format(
      "{}: their points are brought back to the sensor by its poses ({}); points=sensor decides "
      "otherwise",
      clouds, shares));
  if (!poses.moving_frame.empty()) contents.entries.frame_id = poses.moving_frame;
  return true;
}

bool has_any_pose(const Drive::Contents& contents, const BagPoses& poses, std::int64_t offset_ns) {
  return std::any_of(contents.stamps_ns.begin(), contents.stamps_ns.end(), [&](std::int64_t stamp) {
    return poses.T_map_lidar(stamp - offset_ns).has_value();
  });
}

void take_poses(Drive::Contents& contents, const BagPoses& poses, std::int64_t offset_ns,
                const std::optional<PointsFrame>& points) {
  const Drive::Contents without_poses = contents;
  if (!poses.only_if_overlapping || has_any_pose(contents, poses, offset_ns)) {
    set_bag_poses(contents, poses, offset_ns);
    contents.poses_have_stamps = true;
    if (set_points_frame(contents, poses, points)) return;
  }
  // tf moves something below the clouds, but they are not registered by it.
  contents = without_poses;
  contents.notes.push_back(fmt::format(
      "{} is not used for poses: the clouds are not registered by it; to use it, choose poses=/tf",
      poses.source));
}

DriveLayout layout_of(BagFormat format) {
  switch (format) {
    case BagFormat::kMcap:
      return DriveLayout::kMcap;
    case BagFormat::kSqlite:
      return DriveLayout::kRosbag2;
    case BagFormat::kPcap:
      return DriveLayout::kPcap;
    case BagFormat::kRos1:
      break;
  }
  return DriveLayout::kRosbag1;
}

/// What can be chosen of a bag. Clouds in two frames on one topic are no choice.
std::vector<RecordingTopic> topics_to_choose(const BagSurvey& survey) {
  // Robots have some dozens, with names of some dozen letters.
  constexpr std::size_t kMostTopics = 200;
  constexpr std::size_t kLongestName = 1000;
  std::vector<RecordingTopic> topics;
  const auto add = [&](const std::string& word, const auto& frame_if_any) {
    for (const auto& [topic, known] : survey.topics) {
      const std::optional<std::string> frame = frame_if_any(topic, known);
      if (frame && topics.size() < kMostTopics && topic.size() + frame->size() <= kLongestName)
        topics.push_back({word, topic, known.type, known.messages, *frame});
    }
  };
  using Frame = std::optional<std::string>;
  add("cloud", [](const std::string&, const TopicSurvey& known) {
    return !known.clouds.empty() && known.frames.size() == 1 ? Frame(known.frames.front())
                                                             : std::nullopt;
  });
  add("poses", [](const std::string& topic, const TopicSurvey& known) {
    const bool is_tf = known.type == kTfMessage && !is_static_tf(topic);
    if (known.messages == 0 || (!is_tf && !is_pose_type(known.type))) return Frame();
    return Frame(known.pose_frames ? known.pose_frames->child : "");
  });
  add("gnss", [](const std::string&, const TopicSurvey& known) {
    return known.type == kNavSatFix ? Frame("") : std::nullopt;
  });
  add("imu", [](const std::string&, const TopicSurvey& known) {
    return known.type == kImu ? Frame("") : std::nullopt;
  });
  return topics;
}

Drive::Contents contents_of(const fs::path& root, const std::shared_ptr<const BagScans>& scans,
                            const BagSurvey& survey, bool takes_recorded) {
  Drive::Contents contents;
  contents.root = root;
  contents.layout = layout_of(scans->bags->front()->format());
  set_notes(contents, *scans, survey);
  set_scans(contents, scans, takes_recorded);
  contents.entries.frame_id = survey.topics.at(scans->topic).frames.front();
  return contents;
}

/// Where `lidars.json` of a bag's lidars lies: beside its file or folder.
fs::path folder_of_set(const fs::path& bag) {
  const std::string last = bag.filename().string();
  const fs::path folder =
      (last.empty() || last == "." || last == "..") ? fs::weakly_canonical(bag) : bag;
  return folder.has_parent_path() ? folder.parent_path() : ".";
}

/// Placed by tf_static. @param reference  the drive of the first lidar.
BesideLidar lidar_beside(const Drive::Contents& reference,
                         const std::shared_ptr<const BagScans>& scans, const BagSurvey& survey,
                         bool takes_recorded) {
  Drive::Contents contents = contents_of(reference.root, scans, survey, takes_recorded);
  leave_out_unordered(contents);
  // What is said of the bag as a whole was said with the reference.
  std::erase_if(contents.notes, [&](const std::string& note) {
    return std::ranges::find(reference.notes, note) != reference.notes.end();
  });
  const std::string& to = reference.entries.frame_id;
  const std::string& from = contents.entries.frame_id;
  const std::string bag = reference.root.string();
  std::optional<Eigen::Isometry3d> T_reference_lidar = Eigen::Isometry3d::Identity();
  if (to != from) T_reference_lidar = survey.tree.T_between(to, from);
  if (!T_reference_lidar)
    throw InputError(
        bag, fmt::format("no transform from '{}' to '{}' on /tf_static", from, to),
        fmt::format("one for each lidar: find it with stillmap calibrate '{0}?cloud={1}' "
                    "'{0}?cloud={2}' -o '{3}', and give '{4}' as the drive",
                    bag, reference.entries.topic, scans->topic,
                    (folder_of_set(reference.root) / kLidarSetFile).string(),
                    folder_of_set(reference.root).string()));
  if (to == from)
    contents.notes.push_back(
        "its clouds are in the reference's frame: where it stands is not "
        "known, so its rays begin at the reference");
  return {Drive(std::move(contents)), scans->topic, *T_reference_lidar, 0};
}

/// The file of the chosen calibration; nothing without.
std::optional<fs::path> calibration_file(const fs::path& root, const BagChoice& choice) {
  if (!choice.calibration) return std::nullopt;
  std::optional<fs::path> file = file_beside(root, *choice.calibration);
  if (!file)
    throw InputError(root.string(), "no calibration '" + choice.calibration->substr(0, 100) + "'",
                     "the name of a file beside the bag: copy the calibration there, and give its "
                     "name alone");
  return file;
}

/// By the chosen metadata, or what the driver sent on the topic beside the packets' own.
OusterSensor ouster_of(const std::string& topic, const BagSurvey& survey,
                       const std::optional<fs::path>& file, const std::string& name) {
  if (file) return read_ouster_metadata(read_text(*file), file->string());
  const std::string beside = topic.substr(0, topic.rfind('/') + 1) + "metadata";
  const auto sent = survey.topics.find(beside);
  if (sent == survey.topics.end() || sent->second.metadata.empty())
    throw CalibrationError(
        name, fmt::format("packets of an Ouster on {}, without metadata on {}", topic, beside),
        fmt::format("the sensor's metadata (JSON): copy its file beside the bag, and "
                    "give '{}?calibration=NAME'",
                    name));
  return read_ouster_metadata(sent->second.metadata, name + " " + beside);
}

/// Of the chosen topics, the reference first.
std::vector<std::shared_ptr<const BagScans>> chosen_scans(const std::shared_ptr<const Bags>& bags,
                                                          BagSurvey& survey,
                                                          const BagChoice& choice,
                                                          const fs::path& root) {
  const std::string name = root.string();
  const std::optional<fs::path> calibration = calibration_file(root, choice);
  std::vector<std::shared_ptr<const BagScans>> chosen;
  bool has_packets = false;
  const auto add = [&](const std::optional<std::string>& topic, bool is_one_of_several) {
    const std::shared_ptr<BagScans> scans = scans_on_topic(bags, survey, topic, name);
    if (!scans->packets.empty()) {
      scans->ouster = ouster_of(scans->topic, survey, calibration, name);
    } else if (scans->is_velodyne() && calibration) {
      scans->lasers = read_velodyne_calibration(*calibration);
      if (is_one_of_several) keep_fitting_lasers(*scans, *choice.calibration);
    }
    has_packets = has_packets || scans->ouster || scans->is_velodyne();
    chosen.push_back(scans);
  };
  const std::vector<std::string> topics = chosen_clouds(choice, name);
  for (const std::string& topic : topics) add(topic, true);
  if (topics.empty()) add(choice.cloud, false);
  if (calibration && !has_packets)
    throw InputError(name,
                     fmt::format("calibration= for clouds on {} of {}", chosen.front()->topic,
                                 survey.topics.at(chosen.front()->topic).type),
                     "a topic of VelodyneScan or PacketMsg: choose one, or leave out calibration=");
  return chosen;
}

/// @param found  of the bags; its clouds are taken out of it.
Drive::Contents open_surveyed_bag(const fs::path& root, const BagChoice& choice,
                                  const PosesChoice& choice_of_poses, BagSurvey& found,
                                  const std::shared_ptr<const Bags>& bags) {
  const std::string name = root.string();
  const std::optional<PointsFrame> points = points_frame_of(choice, name);
  const bool takes_recorded = choice.takes_recorded_stamps();
  const auto scans = chosen_scans(bags, found, choice, root);
  Drive::Contents contents = contents_of(root, scans.front(), found, takes_recorded);
  if (choice_of_poses.file) {
    set_poses(contents, *choice_of_poses.file, choice_of_poses.offset_ns);
    if (points == PointsFrame::kMap) read_points_from_map(contents);
  } else if (const auto poses = find_poses({*bags, found, choice, contents.entries.frame_id,
                                            taken_at(contents, choice_of_poses.offset_ns), name},
                                           contents.notes)) {
    take_poses(contents, *poses, choice_of_poses.offset_ns, points);
  }
  if (scans.size() > 1 && contents.points_from_map)
    throw InputError(
        name, fmt::format("registered clouds on {}, one of several topics", scans.front()->topic),
        "points of the sensors: choose one topic with cloud=TOPIC, or points=sensor");
  contents.imu = find_imu(found, choice, contents.entries.frame_id, name, contents.notes);
  leave_out_unordered(contents);
  place_by_gnss(contents, *bags, found, choice, name);
  if (scans.size() == 1) return contents;
  std::vector<BesideLidar> others;
  for (auto other = scans.begin() + 1; other != scans.end(); ++other)
    others.push_back(lidar_beside(contents, *other, found, takes_recorded));
  return joined_lidars(Drive(std::move(contents)), scans.front()->topic, std::move(others));
}

}  // namespace

bool is_bag(const fs::path& root) {
  return fs::is_directory(root) ? holds_bag_files(root)
                                : bag_format(root).has_value() || is_packed_bag(root);
}

Drive::Contents open_bag_drive(const fs::path& root, std::string_view words,
                               const PosesChoice& choice_of_poses) {
  BagChoice choice = parse_bag_choice(words, root.string());
  if (fs::is_directory(root)) choice = with_choice_of_folder(std::move(choice), root);
  if (choice_of_poses.points)
    choice.points = choice_of_poses.points == PointsFrame::kMap ? "map" : "sensor";
  const auto bags = std::make_shared<Bags>();
  for (const fs::path& file : bag_files(root)) bags->push_back(open_bag(file));
  BagSurvey found = survey(*bags, choice);
  std::vector<RecordingTopic> topics = topics_to_choose(found);
  // No IMU is in the way of a drive.
  const auto others =
      std::ranges::count_if(topics, [](const auto& each) { return each.word != "imu"; });
  // A choice may be wrong also where there is one topic of each kind.
  const bool has_choice =
      !topics.empty() && topics.front().word == "cloud" && (others > 1 || choice != BagChoice{});
  try {
    return open_surveyed_bag(root, choice, choice_of_poses, found, bags);
  } catch (const CalibrationError& error) {
    throw ChoiceError(error, std::move(topics));
  } catch (const InputError& error) {
    // Poses and GNSS can be left out.
    if (has_choice) throw ChoiceError(error, std::move(topics));
    throw;
  }
}

}  // namespace stillmap::maps
