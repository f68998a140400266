#include <stillmap/maps/lidar_set.hpp>

#include <stillmap/maps/drive_address.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/json_fields.hpp>
#include <stillmap/maps/text.hpp>

#include <utility>

#include "drives/joined_lidars.hpp"

namespace stillmap::maps {
namespace {

constexpr const char* kFormat = "stillmap-lidars";
constexpr double kMostOffsetS = 1.0;

/// A drive may come with an upload: no name leads out of its folder.
std::string name_in_folder(const JsonField& field, const std::filesystem::path& folder) {
  std::string name = field.text();
  std::string place = name;
  if (const std::string in_folder = (folder / "").string(); name.find('?') != std::string::npos)
    place = split_address(in_folder + name).place.string().substr(in_folder.size());
  if (place.empty() || place == "." || place == ".." ||
      place.find_first_of("/\\") != std::string::npos || name.find('\0') != std::string::npos)
    field.refuse("the name of a folder or bag beside this file");
  return name;
}

MountedLidar lidar_from(const JsonField& field, const std::filesystem::path& folder,
                        bool is_reference) {
  MountedLidar lidar;
  if (is_reference)
    field.exactly({"drive"});
  else
    field.only({"drive", "T_reference_lidar", "time_offset_s"});
  lidar.drive = name_in_folder(field.at("drive"), folder);
  if (is_reference) return lidar;
  lidar.T_reference_lidar = field.at("T_reference_lidar").transform();
  if (field.has("time_offset_s"))
    lidar.time_offset_s = field.at("time_offset_s").number(-kMostOffsetS, kMostOffsetS);
  return lidar;
}

}  // namespace

std::vector<MountedLidar> read_lidar_set(const std::filesystem::path& file) {
  const nlohmann::json json = parse_json(read_text(file), file.string());
  const JsonField root(json, file.string());
  root.exactly({"format", "version", "lidars"});
  if (root.at("format").text() != kFormat)
    root.at("format").refuse(std::string("\"") + kFormat + "\"");
  static_cast<void>(root.at("version").integer(1, 1));
  std::vector<MountedLidar> lidars;
  for (const JsonField& field : root.at("lidars").elements(2, kMostLidars))
    lidars.push_back(lidar_from(field, file.parent_path(), lidars.empty()));
  return lidars;
}

std::string lidar_set_text(const std::vector<MountedLidar>& lidars) {
  nlohmann::json root = {{"format", kFormat}, {"version", 1}, {"lidars", nlohmann::json::array()}};
  for (const MountedLidar& lidar : lidars) {
    nlohmann::json entry = {{"drive", lidar.drive}};
    if (!root["lidars"].empty()) {
      entry["T_reference_lidar"] = transform_json(lidar.T_reference_lidar);
      if (lidar.time_offset_s != 0.0) entry["time_offset_s"] = lidar.time_offset_s;
    }
    root["lidars"].push_back(std::move(entry));
  }
  return root.dump(2) + "\n";
}

}  // namespace stillmap::maps
