#include "bags/bag_survey.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "bags/cloud_messages.hpp"
#include "bags/livox_cloud.hpp"
#include "bags/ouster_packets.hpp"
#include "bags/ros_messages.hpp"

namespace stillmap::maps {
namespace {

/// Encapsulation, stamp and the longest name of a frame.
constexpr std::size_t kHeaderBytes = 4 + 12 + 4 + 1025;
/// Of Livox' clouds, with alignment: timebase, number of points, lidar.
constexpr std::size_t kLivoxBytes = 7 + 8 + 4 + 1;
/// More transforms than any robot sends at once.
constexpr std::size_t kMostTfBytes = std::size_t{1} << 20U;
constexpr std::size_t kMostFramesNamed = 8;
/// 14 hours at 10 Hz; more would cost memory by their number alone.
constexpr std::size_t kMostClouds = 500'000;
/// 8 hours of an Ouster at 10 Hz, 480 MB. Later ones are left out.
constexpr std::size_t kMostPackets = 20'000'000;
/// Orientation, rate and force, with the covariances of the first two.
constexpr std::size_t kImuBytes = 8 * (4 + 9 + 3 + 9 + 3) + 8;

std::size_t head_bytes_of(const std::string& topic, const std::string& type) {
  if (is_ouster_packet(type)) return kOusterMessageHeadBytes;
  if (is_ouster_metadata(topic, type)) return kMostMetadataBytes;
  if (cloud_type(type) != nullptr) return kHeaderBytes + (is_livox_type(type) ? kLivoxBytes : 0);
  if (type == kTfMessage) return kMostTfBytes;
  if (type == kImu) return kHeaderBytes + kImuBytes;
  return is_pose_type(type) ? kHeaderBytes + 4 + 1025 : 0;
}

class Surveyor {
 public:
  Surveyor(const Bags& bags, const BagChoice& choice) : bags_(bags), choice_(choice) {}

  BagSurvey survey() {
    for (std::uint32_t i = 0; i < bags_.size(); ++i) survey_bag(i);
    survey_.settled_frames = survey_.tree.settle_unmoved();
    return std::move(survey_);
  }

 private:
  void survey_bag(std::uint32_t number) {
    const Bag& bag = *bags_[number];
    std::vector<std::size_t> wanted;
    for (const BagTopic& topic : bag.topics()) {
      TopicSurvey& known = survey_.topics[topic.name];
      if (known.type.empty()) known.type = topic.type;
      // What nobody reads here may be as it likes.
      if (known.type != topic.type &&
          (head_bytes_of(topic.name, known.type) > 0 || head_bytes_of(topic.name, topic.type) > 0))
        throw InputError(bag.file().string(),
                         "topic " + topic.name + " of " + known.type + " and " + topic.type,
                         "one type: record each type on a topic of its own");
      wanted.push_back(head_bytes_of(topic.name, topic.type));
    }
    const BagDamage damage =
        bag.visit(wanted, [&](const BagMessage& message) { take(message, number); });
    if (clouds_ > kMostClouds)
      throw InputError(bag.file().string(), fmt::format("over {} clouds", kMostClouds),
                       "fewer: split the bag, and give its parts as several drives");
    if (damage.parts == 0) return;
    if (survey_.damage.parts == 0)
      survey_.damage.first = bag.file().filename().string() + " " + damage.first;
    survey_.damage.parts += damage.parts;
  }

  void take(const BagMessage& message, std::uint32_t number) {
    const Bag& bag = *bags_[number];
    const BagTopic& topic = bag.topics()[message.topic];
    TopicSurvey& known = survey_.topics[topic.name];
    ++known.messages;
    try {
      if (head_bytes_of(topic.name, topic.type) == 0) return;
      MessageReader reader(message.head, topic.serialization, topic.name);
      if (topic.type == kTfMessage) return take_tf(reader, topic.name, bag);
      if (is_ouster_packet(topic.type)) return take_packet(reader, message, number, topic, known);
      if (is_ouster_metadata(topic.name, topic.type)) {
        known.metadata = reader.text(kMostMetadataBytes);
        return;
      }
      if (topic.type == kImu) return take_imu(reader, topic.name, message.recorded_ns);
      if (cloud_type(topic.type) == nullptr) return take_pose(reader, topic.type, known);
      const RosHeader header = read_header(reader);
      if (is_livox_type(topic.type)) known.livox_lidars.insert(read_livox_lidar(reader));
      if (++clouds_ > kMostClouds) return;
      known.clouds.push_back(
          {message.place, header.stamp_ns, message.recorded_ns, number, topic.serialization});
      const auto& frames = known.frames;
      if (frames.size() < kMostFramesNamed &&
          std::find(frames.begin(), frames.end(), header.frame_id) == frames.end())
        known.frames.push_back(header.frame_id);
    } catch (const InputError& error) {
      if (known.unreadable++ == 0) known.why_unreadable = error.what();
    }
  }

  /// Packets of one turn follow each other; one that comes late is left out.
  void take_packet(MessageReader& reader, const BagMessage& message, std::uint32_t number,
                   const BagTopic& topic, TopicSurvey& known) {
    const auto head = read_ouster_head(reader);
    if (!head) return;
    if (head->turn == known.turn_before)
      throw InputError(
          topic.name,
          fmt::format("a packet of turn {} after turn {} had begun", head->turn, *known.turn),
          "packets in their order: record on a machine that keeps up");
    if (known.clouds.empty() || head->turn != known.turn || known.clouds.back().bag != number) {
      if (++clouds_ > kMostClouds) return;
      if (head->turn != known.turn) known.turn_before = std::exchange(known.turn, head->turn);
      known.clouds.push_back({message.place, head->stamp_ns, message.recorded_ns, number,
                              topic.serialization, known.packets.size(), 0});
      known.frames = {kOusterFrame};
    }
    if (known.packets.size() == kMostPackets)
      throw InputError(topic.name, fmt::format("over {} packets", kMostPackets),
                       "fewer: split the bag, and give its parts as several drives");
    known.packets.push_back(message.place);
    ++known.clouds.back().packets;
  }

  static void take_pose(MessageReader& reader, const std::string& type, TopicSurvey& known) {
    if (known.messages > 1) return;
    const StampedTransform pose = read_pose_frames(reader, type);
    known.pose_frames = {pose.parent, pose.child};
  }

  void take_imu(MessageReader& reader, const std::string& topic, std::int64_t recorded_ns) {
    const FramedImuReading imu = read_imu(reader);
    TopicSurvey& known = survey_.topics[topic];
    if (known.imu_readings++ == 0) known.imu_frame = imu.frame_id;
    // Without a choice one is used only where it is the only one.
    if (imu_topic_.empty()) imu_topic_ = choice_.imu.value_or(topic);
    if (topic != imu_topic_ || known.imu.size() == kMostImuReadings) return;
    known.imu.push_back(imu.reading);
    if (choice_.takes_recorded_stamps()) known.imu_recorded_ns.push_back(recorded_ns);
  }

  void take_tf(MessageReader& reader, const std::string& topic, const Bag& bag) {
    const bool rigid = is_static_tf(topic);
    read_transforms(reader, [&](const StampedTransform& transform) {
      if (!rigid) {
        survey_.tree.add_moving(transform.parent, transform.child, transform.T_parent_child,
                                bag.file().string());
      } else if (transform.T_parent_child) {
        survey_.tree.add_rigid(transform.parent, transform.child, *transform.T_parent_child,
                               bag.file().string());
      }
    });
  }

  const Bags& bags_;
  const BagChoice& choice_;
  BagSurvey survey_;
  std::size_t clouds_ = 0;
  std::string imu_topic_;
};

}  // namespace

bool is_pose_type(const std::string& type) { return type == kNavOdometry || type == kPoseStamped; }
bool is_static_tf(const std::string& topic) { return topic.ends_with("tf_static"); }

BagSurvey survey(const Bags& bags, const BagChoice& choice) {
  return Surveyor(bags, choice).survey();
}

void visit_messages(const Bags& bags, std::size_t head_bytes,
                    const std::function<bool(const BagTopic&)>& wanted,
                    const std::function<void(MessageReader&, const BagTopic&)>& take) {
  for (const std::unique_ptr<Bag>& bag : bags) {
    std::vector<std::size_t> bytes;
    for (const BagTopic& topic : bag->topics()) bytes.push_back(wanted(topic) ? head_bytes : 0);
    (void)bag->visit(bytes, [&](const BagMessage& message) {
      const BagTopic& topic = bag->topics()[message.topic];
      try {
        MessageReader reader(message.head, topic.serialization, topic.name);
        take(reader, topic);
      } catch (const InputError&) {
        // Not readable: as if it had not been sent.
      }
    });
  }
}

std::string unreadable_text(const std::string& topic, const TopicSurvey& known) {
  return fmt::format("{} messages of {} cannot be read, the first: {}", known.unreadable, topic,
                     known.why_unreadable);
}

}  // namespace stillmap::maps
