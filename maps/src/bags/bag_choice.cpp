#include "bags/bag_choice.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/recording_choice.hpp>

#include <algorithm>

#include <stillmap/maps/text.hpp>

namespace stillmap::maps {
namespace {

constexpr std::string_view kExpected =
    "cloud=TOPIC (or TOPIC,TOPIC for several lidars), poses=TOPIC, pose_frame=FRAME, gnss=TOPIC, "
    "imu=TOPIC, points=map, stamps=recorded or calibration=FILE";

std::optional<std::string>* find_word(BagChoice& choice, std::string_view word) {
  if (word == "cloud") return &choice.cloud;
  if (word == "poses") return &choice.poses;
  if (word == "gnss") return &choice.gnss;
  if (word == "stamps") return &choice.stamps;
  if (word == "calibration") return &choice.calibration;
  if (word == "imu") return &choice.imu;
  if (word == "points") return &choice.points;
  return word == "pose_frame" ? &choice.pose_frame : nullptr;
}

}  // namespace

BagChoice parse_bag_choice(std::string_view text, const std::string& source) {
  BagChoice choice;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find_first_of("&\r\n"), text.size());
    const std::string_view part = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    if (part.empty()) continue;
    const std::size_t sign = part.find('=');
    std::optional<std::string>* const word =
        sign == std::string_view::npos ? nullptr : find_word(choice, part.substr(0, sign));
    if (word == nullptr || word->has_value())
      throw InputError(source, "'" + std::string(part.substr(0, 100)) + "'",
                       std::string(kExpected) + ", each once");
    *word = std::string(part.substr(sign + 1));
  }
  if (choice.stamps && *choice.stamps != "header" && *choice.stamps != "recorded")
    throw InputError(source, "'stamps=" + choice.stamps->substr(0, 100) + "'",
                     "stamps=header or stamps=recorded");
  return choice;
}

BagChoice with_choice_of_folder(BagChoice choice, const std::filesystem::path& folder) {
  const std::filesystem::path file = folder / "topics.txt";
  if (!std::filesystem::exists(file)) return choice;
  const BagChoice own = parse_bag_choice(read_text(file), file.string());
  if (!choice.cloud) choice.cloud = own.cloud;
  if (!choice.poses) choice.poses = own.poses;
  if (!choice.pose_frame) choice.pose_frame = own.pose_frame;
  if (!choice.gnss) choice.gnss = own.gnss;
  if (!choice.stamps) choice.stamps = own.stamps;
  if (!choice.calibration) choice.calibration = own.calibration;
  if (!choice.imu) choice.imu = own.imu;
  if (!choice.points) choice.points = own.points;
  return choice;
}

void check_recording_choice(std::string_view words, const std::string& source) {
  static_cast<void>(parse_bag_choice(words, source));
}

std::optional<std::filesystem::path> file_beside(const std::filesystem::path& bag,
                                                 const std::string& name) {
  const std::filesystem::path file(name);
  if (name.empty() || file != file.filename() || name == "..") return std::nullopt;
  const std::filesystem::path found =
      (std::filesystem::is_directory(bag) ? bag : bag.parent_path()) / file;
  if (!std::filesystem::is_regular_file(found)) return std::nullopt;
  return found;
}

}  // namespace stillmap::maps
