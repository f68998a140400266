// What is chosen of a bag in words, `metadata.yaml` of rosbag2, and `lidars.json`.
#include "fuzz_folder.hpp"
#include "fuzz_target.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/lidar_set.hpp>

#include "bags/bag_choice.hpp"
#include "drives/bag_files.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace stillmap;
  const std::string_view text = fuzz::text_of(data, size);
  static_cast<void>(
      fuzz::taken<maps::InputError>([&] { return maps::parse_bag_choice(text, "fuzz"); }));
  fuzz::put("metadata.yaml", text);
  const auto files = fuzz::taken<maps::InputError, maps::StorageError>(
      [&] { return maps::bag_files(fuzz::folder().path()); });
  for (const std::filesystem::path& file : files.value_or(std::vector<std::filesystem::path>()))
    fuzz::require(file.parent_path() == fuzz::folder().path(), "files lie in the bag's folder");
  const std::filesystem::path set = fuzz::folder().path() / "lidars.json";
  fuzz::put("lidars.json", text);
  const auto lidars = fuzz::taken<maps::InputError>([&] { return maps::read_lidar_set(set); });
  for (const maps::MountedLidar& lidar : lidars.value_or(std::vector<maps::MountedLidar>())) {
    const std::string place = lidar.drive.substr(0, lidar.drive.find('?'));
    fuzz::require((set.parent_path() / place).lexically_normal().parent_path() == set.parent_path(),
                  "drives lie beside the file");
  }
  return 0;
}
