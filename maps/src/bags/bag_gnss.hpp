#pragma once

#include <stillmap/maps/drive.hpp>

#include <string>
#include <vector>

#include "bags/bag_choice.hpp"
#include "bags/bag_survey.hpp"

namespace stillmap::maps {

/// Turns and shifts the poses of a bag's drive into east-north-up at an origin that it gets, by the
/// fixes of the chosen topic, or of an NMEA log beside the bag (`place_on_earth.hpp`); antennas
/// stand where tf_static says, else at the lidar. Without a choice nothing is moved, and a note
/// tells of the topics that there are.
/// @param contents  with stamps that increase.
/// @throws InputError without poses, for a topic that is none of NavSatFix, and as place_on_earth;
/// StorageError.
void place_by_gnss(Drive::Contents& contents, const Bags& bags, const BagSurvey& survey,
                   const BagChoice& choice, const std::string& name);

}  // namespace stillmap::maps
