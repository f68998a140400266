#pragma once

#include <stillmap/maps/imu.hpp>

#include <memory>
#include <string>
#include <vector>

#include "bags/bag_choice.hpp"
#include "bags/bag_survey.hpp"

namespace stillmap::maps {

/// The IMU of a bag in the axes of the clouds: that on the one topic of Imu, or on the chosen one;
/// its mount is that of tf_static. Where the clouds have the recorder's times, so have the
/// readings.
/// @param survey       of the same choice; loses the readings of the topic.
/// @param cloud_frame  of the clouds.
/// @param name         of the drive, for messages.
/// @param notes        gets what was done, for people.
/// @return null without one, and for several of which none is chosen (then a note says so).
/// @throws InputError for a chosen topic that is none of Imu.
[[nodiscard]] std::shared_ptr<const Imu> find_imu(BagSurvey& survey, const BagChoice& choice,
                                                  const std::string& cloud_frame,
                                                  const std::string& name,
                                                  std::vector<std::string>& notes);

}  // namespace stillmap::maps
