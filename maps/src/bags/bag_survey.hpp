#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <stillmap/maps/imu.hpp>

#include "bags/bag.hpp"
#include "bags/bag_choice.hpp"
#include "bags/frame_tree.hpp"
#include "bags/message_reader.hpp"

namespace stillmap::maps {

using Bags = std::vector<std::unique_ptr<Bag>>;

/// One scan of a topic of clouds: a message, or several of a packet each.
struct CloudEntry {
  MessagePlace place;
  /// Of its header, or of the first column of an Ouster's packets.
  std::int64_t stamp_ns = 0;
  std::int64_t recorded_ns = 0;
  /// Which of the bags it lies in.
  std::uint32_t bag = 0;
  Serialization serialization = Serialization::kCdr;
  /// Of a turn that is sent as messages of a packet each: from where they stand in
  /// `TopicSurvey::packets`, and how many they are. 0 for a cloud that is one message.
  std::size_t first_packet = 0;
  std::size_t packets = 0;
};

struct PoseFrames {
  std::string parent;
  /// Empty where its type has none.
  std::string child;
};

struct TopicSurvey {
  std::string type;
  /// Of all bags.
  std::size_t messages = 0;
  /// Of these, clouds whose header cannot be read, and poses, tf and readings of an IMU that cannot
  /// be read.
  std::size_t unreadable = 0;
  /// Why the first of them cannot.
  std::string why_unreadable;
  std::vector<CloudEntry> clouds;
  /// That the clouds' headers name, at most 8.
  std::vector<std::string> frames;
  /// Of an Ouster, one after the other.
  std::vector<MessagePlace> packets;
  /// The turns that the last of them belong to.
  std::optional<std::uint16_t> turn;
  std::optional<std::uint16_t> turn_before;
  /// What an Ouster's driver says of the sensor; empty for other topics.
  std::string metadata;
  /// That Livox' clouds name.
  std::set<std::uint8_t> livox_lidars;
  /// That the first of the poses names; nothing where it cannot be read.
  std::optional<PoseFrames> pose_frames;
  /// Of an IMU, in its own axes, in the order of the messages: the first 10 million of the chosen
  /// topic, or of the first one.
  std::vector<ImuReading> imu;
  /// When the recorder got them, if the choice takes its times for the clouds.
  std::vector<std::int64_t> imu_recorded_ns;
  /// Of all readings, also those that are not held.
  std::size_t imu_readings = 0;
  /// That the first of them names.
  std::string imu_frame;
};

/// What a drive's bags hold, as far as it matters here.
struct BagSurvey {
  /// All of them, by name.
  std::map<std::string, TopicSurvey> topics;
  FrameTree tree;
  /// Frames whose place in their parent tf repeats without a change; it counts as rigid.
  std::vector<std::string> settled_frames;
  BagDamage damage;
};

/// Goes through the bags once: headers of clouds, counts of poses, all of tf and of one IMU.
/// @param choice  says which IMU, and whether the recorder's times of it are needed.
/// @throws InputError for one topic of two types, where one of them is read; StorageError.
[[nodiscard]] BagSurvey survey(const Bags& bags, const BagChoice& choice);

/// Goes once more through the messages of the topics for which `wanted` holds. Messages that cannot
/// be read are left out, and damage is not told again.
/// @param head_bytes  how many of a message's first bytes are needed.
void visit_messages(const Bags& bags, std::size_t head_bytes,
                    const std::function<bool(const BagTopic&)>& wanted,
                    const std::function<void(MessageReader&, const BagTopic&)>& take);

/// "3 messages of /points cannot be read, the first: ...".
[[nodiscard]] std::string unreadable_text(const std::string& topic, const TopicSurvey& known);

[[nodiscard]] bool is_pose_type(const std::string& type);
[[nodiscard]] bool is_static_tf(const std::string& topic);

}  // namespace stillmap::maps
