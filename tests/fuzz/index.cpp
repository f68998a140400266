// A region of a map's index: patches to a whole one. The lowest bit of the first byte says that its
// checksums are left as they are, the others that a scan is aligned with a prior (1) or without one
// (2), which takes 50 to 200 ms, and any others that its points are looked up alone; then 3 bytes
// say where, one how many bytes (1 to 8), and these follow.
#include "fuzz_folder.hpp"
#include "fuzz_target.hpp"
#include "index/index_file.hpp"
#include "index/index_format.hpp"
#include "index/index_grid.hpp"
#include "index/map_level.hpp"
#include "support/synthetic_world.hpp"

#include <stillmap/localization/aligner.hpp>
#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/crc32c.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/mapped_file.hpp>

#include <cstring>
#include <memory>

namespace {

using namespace stillmap;
using Header = maps::SectionHeader;
using localization::index_format::Kind;
using maps::Section;

constexpr localization::MapIndexOptions kOptions{};

/// Ground and two walls, a few metres wide.
std::vector<maps::MapPoint> points() {
  test::Random random(1);
  std::vector<maps::MapPoint> all;
  const auto add = [&](double x, double y, double z) {
    all.push_back({static_cast<float>(x), static_cast<float>(y), static_cast<float>(z), 0.0F, 1,
                   maps::PointKind::kMeasured, 0});
  };
  for (int k = 0; k < 500; ++k) {
    add(random.uniform(0, 4), random.uniform(0, 3), 0.01 * random.normal());
    add(random.uniform(0, 4), 3.0 + 0.01 * random.normal(), random.uniform(0, 2));
    add(4.0 + 0.01 * random.normal(), random.uniform(0, 3), random.uniform(0, 2));
  }
  return all;
}

/// A map, its whole index, and a scan of it.
struct Sample {
  std::shared_ptr<const maps::MapPackage> package;
  std::filesystem::path file;
  std::string index;
  localization::IndexKey key{"", kOptions};
  maps::PointCloud scan;

  Sample() {
    const std::vector<maps::MapPoint> all = points();
    maps::MapPackageWriter writer(fuzz::folder().path() / "map");
    writer.add_tile({}, all);
    writer.publish({}, "{}");
    package = maps::MapPackage::open(fuzz::folder().path() / "map");
    static_cast<void>(localization::MapIndex::open(*package, kOptions));
    file = localization::region_file_of(package->folder(), kOptions, {});
    const maps::MappedFile mapped(file);
    const auto bytes = mapped.bytes();
    index.assign(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    const auto about =
        maps::SectionTable(bytes, bytes.size(), localization::index_format::kRegionFile, "sample")
            .header()
            .read_about<localization::index_format::About>();
    key.source.assign(about.source.begin(), about.source.end());
    for (std::size_t i = 0; i < all.size(); i += 7)
      scan.positions.emplace_back(all[i].x - 2.0F, all[i].y - 1.5F, all[i].z - 1.0F);
  }
};

void patch(std::string& index, std::string_view patches) {
  while (patches.size() >= 5) {
    const auto at = [&](std::size_t i) { return static_cast<std::uint8_t>(patches[i]); };
    const std::size_t where =
        (at(0) | std::size_t{at(1)} << 8U | std::size_t{at(2)} << 16U) % index.size();
    const std::size_t count =
        std::min({std::size_t{at(3)} % 8 + 1, patches.size() - 4, index.size() - where});
    std::memcpy(index.data() + where, patches.data() + 4, count);
    patches.remove_prefix(4 + count);
  }
}

void mend_checksums(std::string& index) {
  Header header;
  std::memcpy(&header, index.data(), sizeof(header));
  if (header.sections > (index.size() - sizeof(Header)) / sizeof(Section)) return;
  const std::span<const std::byte> bytes = fuzz::bytes_of(index);
  std::vector<Section> sections(header.sections);
  if (sections.empty()) return;
  std::memcpy(sections.data(), index.data() + sizeof(Header), sections.size() * sizeof(Section));
  for (Section& section : sections) {
    // The others are read without a look at their checksums.
    if (section.kind != static_cast<std::uint32_t>(Kind::kTiles) &&
        section.kind != static_cast<std::uint32_t>(Kind::kGridTiles))
      continue;
    if (section.offset > index.size() || section.bytes > index.size() - section.offset) continue;
    section.crc = maps::crc32c(bytes.subspan(section.offset, section.bytes));
  }
  std::memcpy(index.data() + sizeof(Header), sections.data(), sections.size() * sizeof(Section));
  header.crc = 0;
  const auto of_header = maps::crc32c(std::as_bytes(std::span(&header, 1)));
  header.crc = maps::crc32c(std::as_bytes(std::span(sections)), of_header);
  std::memcpy(index.data(), &header, sizeof(header));
}

/// Every voxel that is found lies in the file; which, is the file's word.
void look_up(const localization::RegionView& view, const maps::PointCloud& scan) {
  localization::PointColumns columns(scan.size());
  std::vector<localization::MapIndex::Level> levels;
  for (std::size_t k = 0; k < view.levels.size(); ++k) {
    const double edge_m = localization::edge_of_level(kOptions, k);
    levels.push_back(
        {static_cast<float>(edge_m),
         {{&view.levels[k], 1}, localization::tile_shift_of(edge_m), static_cast<float>(edge_m)}});
  }
  for (std::size_t i = 0; i < scan.size(); ++i) {
    const Eigen::Vector3f p = 1.5F * scan.positions[i] + Eigen::Vector3f(2.0F, 1.5F, 1.0F);
    columns.set(i, p);
    for (std::size_t k = 0; k < levels.size(); ++k) {
      const auto nearest = levels[k].nearest(p, 0.01F);
      if (nearest.voxel == nullptr) continue;
      const auto voxels = view.levels[k].voxels;
      fuzz::require(nearest.voxel >= voxels.data() && nearest.voxel < voxels.data() + voxels.size(),
                    "a voxel of the file");
    }
  }
  for (std::size_t k = 0; k < view.place_grids.size(); ++k) {
    localization::CellBits::Part middle = view.place_grids[k];
    middle.x = middle.y = 1;
    const localization::CellBits grid(localization::kPlaceGridEdgesM[k], {&middle, 1});
    static_cast<void>(grid.hits(columns, Eigen::Vector3f::Zero()));
  }
}

void align(const Sample& sample, std::string_view bytes, bool with_prior) {
  fuzz::put(sample.file, bytes);
  const auto index = localization::MapIndex::open(*sample.package, kOptions);
  localization::Prior prior;
  prior.T_map_lidar.translation() = Eigen::Vector3d(2.1, 1.4, 1.0);
  // Any answer will do, but none from outside the file.
  const auto aligner = localization::make_aligner("default", index, {prior.T_map_lidar});
  static_cast<void>(aligner->align(sample.scan, with_prior ? std::optional(prior) : std::nullopt));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const Sample sample;
  if (size == 0) return 0;
  std::string bytes = sample.index;
  patch(bytes, fuzz::text_of(data + 1, size - 1));
  if ((data[0] & 1U) == 0) mend_checksums(bytes);
  std::vector<localization::CacheLine> lines(bytes.size() / sizeof(localization::CacheLine));
  std::memcpy(lines.data(), bytes.data(), lines.size() * sizeof(localization::CacheLine));
  const auto view = fuzz::taken<maps::InputError>([&] {
    return localization::region_view(std::as_bytes(std::span(lines)), sample.key, "fuzz");
  });
  // A broken one is not opened: it would be built anew, which is slow and another path.
  if (!view) return 0;
  look_up(*view, sample.scan);
  if (data[0] >> 1U == 1) align(sample, bytes, true);
  if (data[0] >> 1U == 2) align(sample, bytes, false);
  return 0;
}
