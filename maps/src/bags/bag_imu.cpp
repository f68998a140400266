#include "bags/bag_imu.hpp"

#include <stillmap/maps/error.hpp>

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
    if (!known.imu.empty()) topics.push_back(topic);
  return topics;
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
  if (choice.imu && std::ranges::find(topics, *choice.imu) == topics.end())
    throw InputError(name, fmt::format("no readings of an IMU on '{}'", *choice.imu),
                     fmt::format("a topic of {}, here {}: change or leave out imu=", kImu, listed));
  if (topics.empty()) return nullptr;
  if (!choice.imu && topics.size() > 1) {
    notes.push_back(fmt::format("IMUs on {}: none is used; choose one as in '{}?imu={}'", listed,
                                name, topics.front()));
    return nullptr;
  }
  Imu imu;
  imu.source = choice.imu.value_or(topics.front());
  TopicSurvey& topic = survey.topics.at(imu.source);
  std::vector<ImuReading> readings = std::exchange(topic.imu, {});
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
