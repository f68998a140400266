#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

namespace stillmap::maps {

/// What to take of a bag where there is more than one choice.
struct BagChoice {
  /// Topic of clouds, or several parted by commas: lidars as one, the reference first.
  std::optional<std::string> cloud;
  /// Topic of Odometry, PoseStamped or TFMessage; "none" for no poses.
  std::optional<std::string> poses;
  /// Frame that the poses are of, instead of the one that their messages name.
  std::optional<std::string> pose_frame;
  /// Topic of NavSatFix that says where the poses lie on the Earth.
  std::optional<std::string> gnss;
  /// Topic of Imu; "none" for no IMU.
  std::optional<std::string> imu;
  /// "map" or "sensor": the frame of the clouds' points, whatever their messages say.
  std::optional<std::string> points;
  /// "header", or "recorded": when the recorder got the clouds, instead of their own stamps.
  std::optional<std::string> stamps;
  /// Name of a file beside the bag: a Velodyne's calibration (`read_velodyne_calibration`).
  std::optional<std::string> calibration;

  [[nodiscard]] bool takes_recorded_stamps() const { return stamps == "recorded"; }
  friend bool operator==(const BagChoice&, const BagChoice&) = default;
};

/// `cloud=/points&poses=/odom&pose_frame=base_link&gnss=/fix&imu=/imu`, any of them, parted by `&`
/// or newlines.
/// @param source  for messages. @throws InputError for anything else.
[[nodiscard]] BagChoice parse_bag_choice(std::string_view text, const std::string& source);

/// A folder's own choice, in its file `topics.txt`, with what is asked for in words before it.
/// @throws InputError, StorageError.
[[nodiscard]] BagChoice with_choice_of_folder(BagChoice choice,
                                              const std::filesystem::path& folder);

/// A file that a choice names: beside a bag's file, or in its folder. Only there, since a choice
/// may come with an upload. @return nothing for any other name, or where there is no such file.
[[nodiscard]] std::optional<std::filesystem::path> file_beside(const std::filesystem::path& bag,
                                                               const std::string& name);

}  // namespace stillmap::maps
