#include "bags/bag.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <array>
#include <cstring>
#include <string_view>
#include <system_error>

#include "bags/mcap_bag.hpp"
#include "bags/pcap_bag.hpp"
#include "bags/ros1_bag.hpp"
#include "bags/rosbag2_database.hpp"
#include "bags/unpacked_bag.hpp"
#include "formats/file_reader.hpp"

namespace stillmap::maps {

std::optional<BagFormat> bag_format(const std::filesystem::path& file) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) return std::nullopt;
  constexpr std::string_view kSqliteMagic("SQLite format 3\0", 16);
  std::array<std::byte, 16> bytes{};
  const std::size_t size = FileReader(file).read_at(0, bytes);
  const auto starts_with = [&](const void* magic, std::size_t length) {
    return size >= length && std::memcmp(bytes.data(), magic, length) == 0;
  };
  if (starts_with(mcap::kMagic.data(), mcap::kMagic.size())) return BagFormat::kMcap;
  if (starts_with(kSqliteMagic.data(), kSqliteMagic.size())) return BagFormat::kSqlite;
  // An older version is said when it is opened.
  constexpr std::string_view kAnyRosbag = "#ROSBAG V";
  if (starts_with(kAnyRosbag.data(), kAnyRosbag.size())) return BagFormat::kRos1;
  if (pcap::is_capture(std::span(bytes).first(size))) return BagFormat::kPcap;
  return std::nullopt;
}

namespace {

std::unique_ptr<Bag> open_unpacked(const std::filesystem::path& file,
                                   const std::filesystem::path& shown_as) {
  const std::optional<BagFormat> format = bag_format(file);
  if (format == BagFormat::kMcap) return std::make_unique<mcap::McapBag>(file, shown_as);
  if (format == BagFormat::kSqlite) return std::make_unique<Rosbag2Database>(file, shown_as);
  if (format == BagFormat::kRos1) return std::make_unique<ros1::Ros1Bag>(file, shown_as);
  if (format == BagFormat::kPcap) return std::make_unique<pcap::PcapBag>(file, shown_as);
  throw InputError(
      shown_as.string(), "no bag by its first bytes",
      "MCAP, a SQLite file of rosbag2, a bag of ROS 1, pcap or pcapng: record or copy it again");
}

}  // namespace

std::unique_ptr<Bag> open_bag(const std::filesystem::path& file) {
  if (!is_packed_bag(file)) return open_unpacked(file, file);
  const UnpackedBag unpacked(file);
  std::unique_ptr<Bag> bag = open_unpacked(unpacked.file(), file);
  bag->add_note(
      fmt::format("{} is packed as a whole: unpacked to {} bytes while it is read; to save this "
                  "time, unpack it once with `zstd -d`",
                  file.filename().string(), unpacked.size()));
  return bag;
}

std::string ros2_type(const std::string& type) {
  if (type == "tf/tfMessage") return "tf2_msgs/msg/TFMessage";
  const std::size_t slash = type.find('/');
  if (slash == std::string::npos || type.find('/', slash + 1) != std::string::npos) return type;
  return type.substr(0, slash) + "/msg" + type.substr(slash);
}

}  // namespace stillmap::maps
