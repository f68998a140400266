#include "pipeline/build_key.hpp"
#include "pipeline/build.hpp"
#include "pipeline/manifest.hpp"

#include "core/byte_reader.hpp"
#include "pipeline/manifest.hpp"

#include <fmt/format.h>
#include <hwy/targets.h>
#include <link.h>

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/imu.hpp>

#include <algorithm>
#include <array>
#include <cstring>
#include <exception>
#include <filesystem>
#include <string_view>
#include <system_error>

namespace stillmap::mapping {
namespace {

/// The linker's own hash over an object, out of its notes; empty when it has none.
std::string build_id_of(const dl_phdr_info& object) {
  constexpr std::size_t kHead = sizeof(ElfW(Nhdr));
  const auto padded = [](std::size_t size) { return (size + 3) / 4 * 4; };
  for (int i = 0; i < object.dlpi_phnum; ++i) {
    const ElfW(Phdr)& segment = object.dlpi_phdr[i];
    if (segment.p_type != PT_NOTE) continue;
    // NOLINTNEXTLINE(performance-no-int-to-ptr): the loader tells addresses as numbers
    std::string_view notes(reinterpret_cast<const char*>(object.dlpi_addr + segment.p_vaddr),
                           segment.p_memsz);
    while (notes.size() >= kHead) {
      ElfW(Nhdr) note{};
      std::memcpy(&note, notes.data(), kHead);
      const std::size_t all = kHead + padded(note.n_namesz) + padded(note.n_descsz);
      if (all > notes.size()) break;
      if (note.n_type == NT_GNU_BUILD_ID &&
          notes.substr(kHead, note.n_namesz) == std::string_view("GNU\0", 4))
        return std::string(notes.substr(kHead + padded(note.n_namesz), note.n_descsz));
      notes.remove_prefix(all);
    }
  }
  return {};
}

struct LoadedObjects {
  std::string ids;
  std::exception_ptr failed;
};

int add_object(dl_phdr_info* object, std::size_t, void* to) {
  auto& loaded = *static_cast<LoadedObjects*>(to);
  const std::string_view name = object->dlpi_name;
  // Of the kernel, which no result depends on.
  if (name.starts_with("linux-vdso")) return 0;
  try {
    const std::string id = build_id_of(*object);
    loaded.ids += !id.empty() ? id : maps::sha256_of_file(name.empty() ? "/proc/self/exe" : name);
    loaded.ids += '\n';
    return 0;
  } catch (...) {
    // Must not pass through the C library.
    loaded.failed = std::current_exception();
    return 1;
  }
}

/// A scan's points are deskewed by the poses of its neighbours, so all scans of the drive count.
std::string motion_of(const maps::Drive& drive) {
  const maps::Drive::Contents& contents = drive.contents();
  std::string bytes;
  for (const std::int64_t stamp_ns : contents.stamps_ns) put_number(bytes, stamp_ns);
  for (const Eigen::Isometry3d& T : contents.T_map_lidar) {
    for (const double value : T.matrix().reshaped()) put_number(bytes, value);
  }
  for (const auto& [start_s, end_s] : contents.spin_start_end_s) {
    put_number(bytes, start_s);
    put_number(bytes, end_s);
  }
  if (contents.imu) {
    for (const maps::ImuReading& reading : *contents.imu->readings) {
      put_number(bytes, reading.stamp_ns);
      for (const float rate : reading.rate_radps) put_number(bytes, rate);
      for (const float force : reading.force_mps2) put_number(bytes, force);
    }
  }
  return maps::sha256_of(bytes);
}

std::string names_of(const maps::Drive& drive) {
  std::string names;
  for (std::size_t i = 0; i < drive.size(); ++i) names += drive.contents().scan_name(i) + '\n';
  return maps::sha256_of(names);
}

/// Sizes and times of change of the scans' files.
std::string states_of(const maps::Drive& drive) {
  std::string bytes;
  for (const std::filesystem::path& file : drive.contents().scan_files) {
    std::error_code error;
    put_number(bytes, std::filesystem::file_size(file, error));
    if (!error)
      put_number(bytes, std::filesystem::last_write_time(file, error).time_since_epoch().count());
    if (error) throw maps::StorageError(file.string(), error.message());
  }
  return maps::sha256_of(bytes);
}

std::string text_of(const maps::Drive& drive, std::size_t number) {
  return fmt::format("scans of drive {0}: {1} {2}\nposes of drive {0}: {3}\n", number + 1,
                     drive.size(), names_of(drive), motion_of(drive));
}

/// What is done with what the survey finds; `movable` counts as far as something is looked for.
bool is_of_later_stages(const std::string& option) {
  constexpr std::array<std::string_view, 8> kLater{
      "movable", "ground_height", "margin_m", "margin_up_m", "fusion", "edits", "fill", "clean"};
  return std::find(kLater.begin(), kLater.end(), option) != kLater.end();
}

std::string instruction_sets() {
  std::string names;
  for (std::int64_t left = hwy::SupportedTargets(); left != 0; left &= left - 1)
    names += fmt::format("{}{}", names.empty() ? "" : " ", hwy::TargetName(left & -left));
  return names;
}

std::string program() {
  return fmt::format("version: {}\ncode: {}\ninstruction sets: {}\n", STILLMAP_VERSION,
                     running_code(), instruction_sets());
}

}  // namespace

std::string running_code() {
  // Once: TBB loads libraries of its own when it is first used.
  static const std::string code = [] {
    LoadedObjects loaded;
    ::dl_iterate_phdr(add_object, &loaded);
    if (loaded.failed) std::rethrow_exception(loaded.failed);
    return maps::sha256_of(loaded.ids);
  }();
  return code;
}

std::string survey_key(const Build& build) {
  const DriveSet& drives = *build.drives;
  const maps::MapManifest manifest = manifest_of(build);
  std::string key = program() + fmt::format("detects: {}\n", build.task.options.detects());
  for (const auto& [name, text] : manifest.options) {
    if (!is_of_later_stages(name)) key += fmt::format("{}: {}\n", name, text);
  }
  for (const auto& [name, text] : manifest.sources) {
    if (name != "edits_sha256") key += fmt::format("{}: {}\n", name, text);
  }
  for (std::size_t i = 0; i < drives.drives().size(); ++i) key += text_of(drives.drives()[i], i);
  for (std::size_t scan = 0; scan < drives.size(); ++scan) {
    if (drives.note(scan) == ScanNote::kHidden) key += fmt::format("hidden: {}\n", scan);
  }
  for (const std::size_t scan : ScanWork::scans_to_learn_from(drives))
    key += fmt::format("{}: {}\n", drives.name(scan), drives.sha256(scan));
  return key;
}

std::string trajectory_key(const std::vector<maps::Drive>& drives, const MapBuildOptions& options,
                           const std::string& odometry) {
  std::string key = program() + fmt::format("odometry: {}\n", odometry);
  if (odometry == "given") key += fmt::format("given poses: {}\n", name_of(options.given_poses));
  for (const auto& [name, text] : texts_of(options.trajectory))
    key += fmt::format("{}: {}\n", name, text);
  if (const auto& place = options.geodetic_origin)
    key += fmt::format("geodetic origin: {} {} {}\n", place->latitude_deg, place->longitude_deg,
                       place->altitude_m);
  const maps::Selection& scans = options.selection;
  key += fmt::format("scans: {} {}\n", scans.begin, scans.end ? std::to_string(*scans.end) : "");
  for (std::size_t i = 0; i < drives.size(); ++i) {
    key += text_of(drives[i], i);
    key += fmt::format("files of drive {}: {}\n", i + 1, states_of(drives[i]));
  }
  return key;
}

std::string registered_key(const Build& build) {
  const BuildTask& task = build.task;
  std::string key = fmt::format("registered to: {}\nfollows it: {}\nheld back: {}\n",
                                maps::MapPackage::open(*task.options.register_to)->digest(),
                                task.options.follows_map, task.options.held_back_every);
  key += trajectory_key(build.shifted, task.options, task.odometry);
  for (const auto& [name, text] : texts_of(task.options)) {
    if (!is_of_later_stages(name)) key += fmt::format("{}: {}\n", name, text);
  }
  return key;
}

std::string rebuild_key(const std::vector<maps::Drive>& drives, const MapBuildOptions& options,
                        const std::string& odometry) {
  std::string key = trajectory_key(drives, options, odometry);
  for (const auto& [name, text] : texts_of(options)) key += fmt::format("{}: {}\n", name, text);
  key += fmt::format("held back: {}\n", options.held_back_every);
  for (const auto& [name, text] : sources_of(drives, options))
    key += fmt::format("{}: {}\n", name, text);
  return key;
}

std::string key_difference(std::string_view found, std::string_view expected) {
  while (true) {
    const std::string_view a = found.substr(0, found.find('\n'));
    const std::string_view b = expected.substr(0, expected.find('\n'));
    if (a != b) return fmt::format("found '{}', expected '{}'", a, b);
    if (a.size() == found.size() || b.size() == expected.size()) return "found another key";
    found.remove_prefix(a.size() + 1);
    expected.remove_prefix(b.size() + 1);
  }
}

}  // namespace stillmap::mapping
