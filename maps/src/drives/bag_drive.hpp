#pragma once

#include <stillmap/maps/drive.hpp>

#include "drives/layout.hpp"

#include <filesystem>
#include <string_view>

namespace stillmap::maps {

/// A bag's file by its first bytes, or a folder with `*.mcap`, `*.db3`, `*.bag`, `*.pcap`,
/// `*.pcapng` or rosbag2's `metadata.yaml`.
[[nodiscard]] bool is_bag(const std::filesystem::path& root);

/// An MCAP file, a SQLite file of rosbag2, a bag of ROS 1, a capture of packets, or a folder of one
/// bag, also split: its parts in the order of `metadata.yaml`, else of their names. `Drive::open`
/// says what is taken of it.
/// @param words  what is chosen of it, as behind `?` of `Drive::open`.
[[nodiscard]] Drive::Contents open_bag_drive(const std::filesystem::path& root,
                                             std::string_view words, const PosesChoice& poses);

}  // namespace stillmap::maps
