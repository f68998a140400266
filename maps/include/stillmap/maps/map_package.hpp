#pragma once

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_object.hpp>
#include <stillmap/maps/map_tile.hpp>
#include <stillmap/maps/mapped_file.hpp>
#include <stillmap/maps/partial_folder.hpp>
#include <stillmap/maps/point_fates.hpp>
#include <stillmap/maps/region.hpp>
#include <stillmap/maps/tile_evidence.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::maps {

/// 1: a file for each tile, floats relative to the origin. 2: tiles in packs (maps/package.md).
inline constexpr int kPackageSchema = 2;

struct TileEntry {
  TileId id;
  std::uint64_t points = 0;
  /// Of the points, relative to the manifest's origin [m]; ask `from_origin` or
  /// `MapManifest::bounds_of`.
  std::array<double, 3> min{}, max{};

  /// Bounds of the points, relative to the manifest's origin [m].
  [[nodiscard]] Eigen::AlignedBox3d from_origin() const {
    return {Eigen::Vector3d(min[0], min[1], min[2]), Eigen::Vector3d(max[0], max[1], max[2])};
  }
};

/// What all tiles hold together.
struct MapExtent {
  std::uint64_t tiles = 0;
  std::uint64_t points = 0;
  /// Sum over the tiles of what the bounds of their points cover [m2].
  double area_m2 = 0.0;
  /// Of the points, relative to the manifest's origin [m].
  Eigen::AlignedBox3d from_origin;

  void add(const TileEntry& tile);
};

/// How a version was brought into the frame of the version before, by localizing its scans there.
struct Registration {
  std::string previous_digest;
  /// Takes points of this version to the frame of the previous one. It is the identity if the poses
  /// were moved into that frame. If they agreed with it and were kept, it is the measured motion.
  Eigen::Isometry3d T_previous_map = Eigen::Isometry3d::Identity();
  /// The motion that was applied to the build's own poses; the identity if they were kept.
  Eigen::Isometry3d T_map_poses = Eigen::Isometry3d::Identity();
  /// Root mean square of the differences between the scans that were used and this one motion, at
  /// the sensor.
  double residual_m = 0.0;
  double residual_rad = 0.0;
  /// How many scans agree, and how many were localized.
  std::uint64_t scans_used = 0;
  std::uint64_t scans_asked = 0;
};

/// What the digest covers: everything in manifest.json, thus through SHA-256 every file it lists.
struct MapManifest {
  int schema = 1;
  std::string frame_id;
  /// Where the tile grid begins, in the map frame [m].
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  std::optional<GeodeticOrigin> geodetic_origin;
  /// Absent for a version that was built on its own.
  std::optional<Registration> registration;
  double voxel_size_m = 0.0;
  bool relative_clock = true;
  std::string software_version;
  /// Every option of the build, as text.
  std::map<std::string, std::string> options;
  /// Every counter of the build (points in, dropped by reason, ground, projected, deleted, objects,
  /// ...).
  std::map<std::string, std::uint64_t> counts;
  /// Inputs with their SHA-256 (scans as one hash over all names and bytes).
  std::map<std::string, std::string> sources;
  /// Of schema 1 only; `MapPackage::tiles` has those of any package.
  std::vector<TileEntry> tiles;
  MapExtent extent;
  /// How many scans and objects are of a drive.
  struct DriveCounts {
    std::uint32_t scans = 0, objects = 0;
    bool operator==(const DriveCounts&) const = default;
  };
  /// Schema 2, whose tiles and files number scans and objects by drive. Empty: one drive.
  std::vector<DriveCounts> drives;
  struct File {
    std::uint64_t bytes = 0;
    std::string sha256;
  };
  /// By path relative to the package.
  std::map<std::string, File> files;

  /// Bounds of a tile's points in the map frame [m].
  [[nodiscard]] Eigen::AlignedBox3d bounds_of(const TileEntry& tile) const {
    return tile.from_origin().translated(origin);
  }
};

class DriveNumbers;
class MapPackage;
class PackReader;
class PackWriter;

/// Writes a package beside its final place and publishes it with one rename.
///
/// Nothing is visible at `target` before `publish`; the destructor removes what was not published.
class MapPackageWriter {
 public:
  /// @param survivor  see `PartialFolder`. @param schema  of the package: 1 or 2.
  /// @throws InputError if `target` exists, StorageError if its folder cannot be written.
  explicit MapPackageWriter(const std::filesystem::path& target, std::string survivor = {},
                            int schema = kPackageSchema);
  ~MapPackageWriter();

  /// Folder to put further files in (trajectory.tum, objects.json, preview.png, ...); all are
  /// hashed but the survivor.
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_.path(); }
  /// @param points   relative to the manifest's origin, at least one, all finite. Schema 2 puts
  /// them in steps (`tile_steps.hpp`), and has tiles of level 0 only.
  /// @param history  one a point, or empty when there is none.
  /// @throws std::invalid_argument if not, or when the tile was added before.
  void add_tile(TileId id, std::span<const MapPoint> points,
                std::span<const PointHistory> history = {});
  /// The same of points that count from a corner near them, so that they are exact far from the
  /// origin, too.
  /// @param evidence  of schema 2 only.
  void add_tile(TileId id, const MapTile& tile, std::span<const PointHistory> history = {},
                const TileEvidence& evidence = {});
  /// Once, before tiles, fates and objects. Scans and objects are numbered over all drives here,
  /// those of the first drive first. Without this there is one drive.
  void set_drives(std::vector<MapManifest::DriveCounts> drives);
  /// Takes over the drives of another package and its tiles but some, for a version that changes
  /// these: packs and files of the drives are the same files where the file system has hard links,
  /// else copies. Others of its files (graph, sources, picture) are not taken over. Before tiles,
  /// which may be added at any place that is not taken. `set_drives` is told those drives first.
  /// @param from  of schema 2; lives until `publish` has returned.
  /// @throws StorageError; std::invalid_argument for schema 1.
  void take_over(const MapPackage& from, std::set<TileId> except);
  /// Takes over the files of one more drive of another package, that of the number `drive` there.
  /// @param as  its number here.
  void take_drive(const MapPackage& from, std::size_t drive, std::size_t as);
  /// What became of the points of the next scan, in the order of the scans.
  /// @throws std::invalid_argument for an object of another drive.
  void add_fates(const ScanFates& fates);
  /// @param drive  0 for the first or only one.
  void write_trajectory(const Trajectory& trajectory, std::size_t drive = 0);
  /// @param objects  in the order of their drives. @throws std::invalid_argument if there are
  /// others than `set_drives` was told.
  void write_objects(const std::vector<MapObject>& objects);
  /// Where a sensor may have been, for a map without trajectories: upright poses in the map frame,
  /// written to the millimetre.
  void write_places(const std::vector<Eigen::Isometry3d>& T_map_place);
  /// Hashes all files, writes manifest.json and `build_json` (outside the digest: times, host,
  /// timings) as build.json, syncs, renames. The manifest's `tiles`, `extent` and `files` are
  /// filled here. Once only.
  /// @return the package's digest (SHA-256 of manifest.json, hex); `content_digest` is another one.
  std::string publish(MapManifest manifest, const std::string& build_json);

 private:
  PartialFolder folder_;
  std::string survivor_;
  int schema_;
  std::unique_ptr<const DriveNumbers> numbers_;
  std::vector<TileEntry> tiles_;
  /// Of schema 2.
  std::unique_ptr<PackWriter> packs_;
  /// Of the drive of the scans that come.
  std::unique_ptr<FatesWriter> fates_;
  std::uint32_t fates_drive_ = 0, fates_scans_ = 0;
  bool has_objects_ = false;
  /// Of files that were taken over.
  std::map<std::string, MapManifest::File> known_files_;
};

/// An immutable map version. Of schema 2, opening reads manifest.json only. Regions are read, and
/// tiles decoded, when they are asked for, and are not kept: whatever asks for a tile may throw
/// InputError. Safe from several threads.
class MapPackage {
 public:
  /// Checks schema, presence and sizes of all files. @throws InputError naming the file.
  [[nodiscard]] static std::shared_ptr<const MapPackage> open(const std::filesystem::path& folder);
  MapPackage(const MapPackage&) = delete;
  MapPackage& operator=(const MapPackage&) = delete;

  [[nodiscard]] const MapManifest& manifest() const { return manifest_; }
  [[nodiscard]] const std::string& digest() const { return digest_; }
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }
  /// How many scans and objects each drive has; also where the manifest says nothing of drives.
  /// @throws InputError.
  [[nodiscard]] std::vector<MapManifest::DriveCounts> drive_counts() const;
  ~MapPackage();
  /// All tiles, by level, x, y. Reads all regions, and checks that the manifest's extent is theirs.
  [[nodiscard]] std::vector<TileEntry> tiles() const;
  /// Regions that have tiles of level 0, by x, then y. Of schema 2 none is read.
  [[nodiscard]] std::vector<RegionId> regions() const;
  /// Tiles of level 0 of a region, by x, then y.
  [[nodiscard]] std::vector<TileEntry> tiles(RegionId region) const;
  [[nodiscard]] bool has_tile(TileId id) const;
  [[nodiscard]] std::optional<TileEntry> entry(TileId id) const;
  /// Points of a tile; empty when there is none.
  [[nodiscard]] MapTile tile(TileId id) const;
  /// Whether `history` has something for a tile.
  [[nodiscard]] bool has_history(TileId id) const;
  /// What is known of a tile's points, in their order; empty when the package lists nothing.
  [[nodiscard]] std::vector<PointHistory> history(TileId id) const;
  /// What the drives saw of a tile's space; empty when the package does not say.
  [[nodiscard]] TileEvidence evidence(TileId id) const;
  /// The bytes that the checksum of a tile's file covers; empty when there is none. Valid as long
  /// as the package.
  [[nodiscard]] std::span<const std::byte> stored_tile(TileId id) const;
  /// That checksum of a tile that the package has, as lower-case hex, and the name of the file (and
  /// of the tile in it).
  struct StoredName {
    std::string sha256;
    std::string file;
  };
  [[nodiscard]] StoredName stored_name(TileId id) const;
  /// Poses of the scans of each drive, in the order in which scans are numbered. Empty when the
  /// package lists none. @throws InputError.
  [[nodiscard]] std::vector<Trajectory> trajectories() const;
  /// What became of the points of the scan with this ordinal; empty when the package does not say.
  /// @throws InputError for a broken file or an ordinal beyond it.
  [[nodiscard]] ScanFates fates(std::size_t scan) const;
  /// Empty when the package lists no objects.json. @throws InputError.
  [[nodiscard]] std::vector<MapObject> objects() const;
  /// As `MapPackageWriter::write_places`; empty when the package lists none. @throws InputError.
  [[nodiscard]] std::vector<Eigen::Isometry3d> places() const;
  /// Frees the memory of the tiles that were read so far. They are read again when they are asked
  /// for. Safe from several threads.
  void release_pages() const;
  /// Recomputes every SHA-256. @return the paths that do not match or cannot be read; empty when
  /// whole.
  [[nodiscard]] std::vector<std::string> verify() const;

 private:
  friend class MapPackageWriter;
  MapPackage() = default;
  std::filesystem::path folder_;
  MapManifest manifest_;
  std::string digest_;
  /// Open from the beginning, so that they stay readable when the package is removed or replaced.
  std::map<TileId, MappedFile> tiles_, histories_;
  /// Of schema 2, instead.
  std::unique_ptr<const PackReader> packs_;
  std::unique_ptr<const DriveNumbers> numbers_;
};

/// SHA-256 as lower-case hex.
[[nodiscard]] std::string sha256_of(std::string_view bytes);
/// @throws StorageError.
[[nodiscard]] std::string sha256_of_file(const std::filesystem::path& file);

}  // namespace stillmap::maps
