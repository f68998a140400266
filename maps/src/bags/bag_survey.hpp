#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <stillmap/maps/imu.hpp>

#include "bags/bag.hpp"
#include "bags/frame_tree.hpp"

namespace stillmap::maps {

using Bags = std::vector<std::unique_ptr<Bag>>;

/// One message of a topic of clouds.
struct CloudEntry {
  MessagePlace place;
  /// Of its header.
  std::int64_t stamp_ns = 0;
  std::int64_t recorded_ns = 0;
  /// Which of the bags it lies in.
  std::uint32_t bag = 0;
  Serialization serialization = Serialization::kCdr;
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
  /// Of these, clouds whose header cannot be read.
  std::size_t unreadable = 0;
  /// Why the first of them cannot.
  std::string why_unreadable;
  std::vector<CloudEntry> clouds;
  /// That the clouds' headers name, at most 8.
  std::vector<std::string> frames;
  /// That the first of the poses names; nothing where it cannot be read.
  std::optional<PoseFrames> pose_frames;
  /// Of an IMU, in its own axes, in the order of the messages.
  std::vector<ImuReading> imu;
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

/// Goes through the bags once: headers of clouds, counts of poses, all of tf and of IMUs.
/// @throws InputError for one topic of two types, where one of them is read; StorageError.
[[nodiscard]] BagSurvey survey(const Bags& bags);

[[nodiscard]] bool is_pose_type(const std::string& type);
[[nodiscard]] bool is_static_tf(const std::string& topic);

}  // namespace stillmap::maps
