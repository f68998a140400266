#include "bags/bag_survey.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>

#include "bags/cloud_messages.hpp"
#include "bags/ros_messages.hpp"

namespace stillmap::maps {
namespace {

/// Encapsulation, stamp and the longest name of a frame.
constexpr std::size_t kHeaderBytes = 4 + 12 + 4 + 1025;
/// More transforms than any robot sends at once.
constexpr std::size_t kMostTfBytes = std::size_t{1} << 20U;
constexpr std::size_t kMostFramesNamed = 8;
/// 14 hours at 10 Hz; more would cost memory by their number alone.
constexpr std::size_t kMostClouds = 500'000;
/// Orientation, rate and force, with the covariances of the first two.
constexpr std::size_t kImuBytes = 8 * (4 + 9 + 3 + 9 + 3) + 8;

std::size_t head_bytes_of(const std::string& type) {
  if (cloud_type(type) != nullptr) return kHeaderBytes;
  if (type == kTfMessage) return kMostTfBytes;
  if (type == kImu) return kHeaderBytes + kImuBytes;
  return is_pose_type(type) ? kHeaderBytes + 4 + 1025 : 0;
}

class Surveyor {
 public:
  explicit Surveyor(const Bags& bags) : bags_(bags) {}

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
          (head_bytes_of(known.type) > 0 || head_bytes_of(topic.type) > 0))
        throw InputError(bag.file().string(),
                         "topic " + topic.name + " of " + known.type + " and " + topic.type,
                         "one type: record each type on a topic of its own");
      wanted.push_back(head_bytes_of(topic.type));
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
      if (head_bytes_of(topic.type) == 0) return;
      MessageReader reader(message.head, topic.serialization, topic.name);
      if (topic.type == kTfMessage) return take_tf(reader, topic.name, bag);
      if (topic.type == kImu) return take_imu(reader, known);
      if (cloud_type(topic.type) == nullptr) return take_pose(reader, topic.type, known);
      const RosHeader header = read_header(reader);
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

  static void take_pose(MessageReader& reader, const std::string& type, TopicSurvey& known) {
    if (known.messages > 1) return;
    const StampedTransform pose = read_pose_frames(reader, type);
    known.pose_frames = {pose.parent, pose.child};
  }

  void take_imu(MessageReader& reader, TopicSurvey& known) {
    if (imu_readings_ == kMostImuReadings) return;  // later ones are left out
    const FramedImuReading imu = read_imu(reader);
    if (known.imu.empty()) known.imu_frame = imu.frame_id;
    known.imu.push_back(imu.reading);
    ++imu_readings_;
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
  BagSurvey survey_;
  std::size_t clouds_ = 0;
  std::size_t imu_readings_ = 0;
};

}  // namespace

bool is_pose_type(const std::string& type) { return type == kNavOdometry || type == kPoseStamped; }
bool is_static_tf(const std::string& topic) { return topic.ends_with("tf_static"); }

BagSurvey survey(const Bags& bags) { return Surveyor(bags).survey(); }

}  // namespace stillmap::maps
