#include "bags/bag_imu.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/median.hpp>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <utility>

#include "bags/ros_messages.hpp"

namespace stillmap::maps {
namespace {

std::vector<std::string> imu_topics(const BagSurvey& survey) {
  std::vector<std::string> topics;
  for (const auto& [topic, known] : survey.topics)
    if (known.imu_readings > 0) topics.push_back(topic);
  return topics;
}

/// Why no reading of any topic of Imu, or of the asked one, can be read; empty without a reason.
std::string why_unreadable(const BagSurvey& survey, const std::optional<std::string>& asked) {
  std::string text;
  for (const auto& [topic, known] : survey.topics)
    if (known.type == kImu && known.unreadable > 0 && topic == asked.value_or(topic))
      text += (text.empty() ? "" : "; ") + unreadable_text(topic, known);
  return text;
}

/// Takes readings to the recorder's clock: that of the clouds, if their stamps are the recorder's.
/// Clocks drift apart, so readings of some seconds are shifted by their median; the recorder gets
/// each of them more or less late.
void take_recorded_stamps(std::vector<ImuReading>& readings,
                          const std::vector<std::int64_t>& recorded_ns) {
  constexpr std::size_t kPart = 1000;
  // Without a sign, where what is broken may leave 64 bits.
  const auto bits = [](std::int64_t ns) { return static_cast<std::uint64_t>(ns); };
  for (std::size_t begin = 0; begin < readings.size(); begin += kPart) {
    const std::size_t end = std::min(begin + kPart, readings.size());
    std::vector<std::int64_t> later_ns;
    for (std::size_t i = begin; i < end; ++i)
      later_ns.push_back(
          static_cast<std::int64_t>(bits(recorded_ns[i]) - bits(readings[i].stamp_ns)));
    const std::int64_t shift_ns = median(std::move(later_ns));
    for (std::size_t i = begin; i < end; ++i)
      readings[i].stamp_ns = static_cast<std::int64_t>(bits(readings[i].stamp_ns) + bits(shift_ns));
  }
  std::erase_if(readings, [](const ImuReading& reading) {
    return reading.stamp_ns > kMostImuStampNs || reading.stamp_ns < -kMostImuStampNs;
  });
}

/// What became of the readings of a topic, for people.
void note_readings(const std::string& name, const TopicSurvey& topic,
                   std::vector<std::string>& notes) {
  if (topic.unreadable > 0) notes.push_back(unreadable_text(name, topic));
  if (topic.imu_readings > topic.imu.size())
    notes.push_back(
        fmt::format("{}: the first {} of {} readings are used; to use all of them, split the bag",
                    name, topic.imu.size(), topic.imu_readings));
}

void turn_to_lidar(std::vector<ImuReading>& readings, const Eigen::Matrix3d& R_lidar_imu) {
  const Eigen::Matrix3f R = R_lidar_imu.cast<float>();
  for (ImuReading& reading : readings) {
    reading.rate_radps = R * reading.rate_radps;
    reading.force_mps2 = R * reading.force_mps2;
  }
}

}  // namespace

std::shared_ptr<const Imu> find_imu(BagSurvey& survey, const BagChoice& choice,
                                    const std::string& cloud_frame, const std::string& name,
                                    std::vector<std::string>& notes) {
  if (choice.imu == "none") return nullptr;
  const std::vector<std::string> topics = imu_topics(survey);
  const std::string listed = topics.empty() ? "none" : fmt::format("{}", fmt::join(topics, ", "));
  const std::string why = why_unreadable(survey, choice.imu);
  if (choice.imu && std::ranges::find(topics, *choice.imu) == topics.end())
    throw InputError(
        name,
        fmt::format("no readings of an IMU on '{}'{}{}", *choice.imu, why.empty() ? "" : ": ", why),
        fmt::format("a topic of {}, here {}: change or leave out imu=", kImu, listed));
  if (topics.empty()) {
    if (!why.empty()) notes.push_back(why);
    return nullptr;
  }
  if (!choice.imu && topics.size() > 1) {
    notes.push_back(fmt::format("IMUs on {}: none is used; choose one as in '{}?imu={}'", listed,
                                name, topics.front()));
    return nullptr;
  }
  Imu imu;
  imu.source = choice.imu.value_or(topics.front());
  TopicSurvey& topic = survey.topics.at(imu.source);
  note_readings(imu.source, topic, notes);
  std::vector<ImuReading> readings = std::exchange(topic.imu, {});
  if (choice.takes_recorded_stamps()) take_recorded_stamps(readings, topic.imu_recorded_ns);
  const auto T_lidar_imu = survey.tree.T_between(cloud_frame, topic.imu_frame);
  if (T_lidar_imu) {
    turn_to_lidar(readings, T_lidar_imu->linear());
  } else if (topic.imu_frame != cloud_frame) {
    notes.push_back(
        fmt::format("tf_static has no place of '{}' of {}: its axes are taken as those "
                    "of the lidar",
                    topic.imu_frame, imu.source));
  }
  imu.readings = usable_readings(std::move(readings), imu.source, notes);
  return imu.readings ? std::make_shared<const Imu>(std::move(imu)) : nullptr;
}

}  // namespace stillmap::maps
