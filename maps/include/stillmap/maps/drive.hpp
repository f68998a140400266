#pragma once

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/scan.hpp>
#include <stillmap/maps/scan_file.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::maps {

struct Imu;

/// Native layouts that are told apart by content.
enum class DriveLayout {
  kKittiRaw,
  kKittiOdometry,
  kKeyframes,
  kScanFolder,
  kMcap,
  kRosbag2,
  kRosbag1,
  kPcap,
  kMulran,
  kHdlGraphSlam,
  kRawlog
};
[[nodiscard]] std::string_view name_of(DriveLayout layout);

/// Geodetic place of the map frame's origin (WGS 84).
struct GeodeticOrigin {
  double latitude_deg = 0.0;
  double longitude_deg = 0.0;
  /// Above the ellipsoid [m].
  double altitude_m = 0.0;
};

/// A drive on disk: scans in order, with poses where the layout or the caller gives them.
///
/// Opening reads only names, stamps and poses; each scan is read when asked for, so memory does not
/// grow with the number of scans. `read` may be called from several threads at once.
class Drive {
 public:
  /// What one layout gives; filled by the layout's own opener in `maps/src/drives/`.
  struct Contents {
    DriveLayout layout = DriveLayout::kScanFolder;
    std::filesystem::path root;
    std::vector<std::filesystem::path> scan_files;
    /// Of *.bin, as `ScanFileHints::bin_columns`.
    std::string bin_columns = "xyzi";
    /// For scans that share a file with others, as in a bag; empty when each file is one scan.
    struct Entries {
      /// Their topic in the file.
      std::string topic;
      /// Frame of their points, and the columns of the first scan ("x f32"); empty where the file
      /// does not name them.
      std::string frame_id;
      std::vector<std::string> fields;
      /// One for each scan: what `read` takes.
      std::vector<std::size_t> numbers;
      /// Safe from several threads. Throws as `Drive::read`.
      std::function<DecodedScan(std::size_t number)> read;
      /// SHA-256 of the bytes of one scan.
      std::function<std::string(std::size_t number)> sha256;
    };
    Entries entries;
    /// One stamp a scan, increasing.
    std::vector<std::int64_t> stamps_ns;
    bool relative_clock = true;
    /// The first scans were left out because they have no pose. Files that number the scans, such
    /// as labels and boxes, then do not fit.
    bool counts_from_first_pose = false;
    /// One pose a scan (already in the lidar frame), or empty.
    std::vector<Eigen::Isometry3d> T_map_lidar;
    /// All poses at their own stamps, if these differ from the stamps of the scans. Null if there
    /// is one pose for each scan, and for recordings.
    std::shared_ptr<const Trajectory> path;
    /// Whether the poses have stamps of their own. `pose_offset_ns` was added to these.
    bool poses_have_stamps = false;
    /// For each axis: the step of which all written positions are multiples [m]; 0 if there is
    /// none.
    Eigen::Vector3d position_step_m = Eigen::Vector3d::Zero();
    std::optional<GeodeticOrigin> origin;
    /// Readings of an IMU that is fixed to the lidar (`imu.hpp`). Null without one.
    std::shared_ptr<const Imu> imu;
    /// When a spinning sensor's sweep starts and ends: {start_s < 0, end_s > 0} [s] relative to the
    /// stamp, one pair a scan; {0, 0} when the scan's points count as taken at once. The sensor
    /// turns clockwise seen from above and faces backward at both ends, so a point at azimuth a =
    /// atan2(y, x) was taken at start_s * a / pi for a > 0 (left side, first half of the sweep) and
    /// at -end_s * a / pi for a <= 0: 0 straight ahead, at the stamp. Empty when the points are
    /// already at one instant or the layout does not tell.
    std::vector<std::array<double, 2>> spin_start_end_s;
    /// The files hold registered scans: points in the frame of the poses. `read` brings each scan
    /// back to the lidar frame by the pose that it was opened with. Its points have no times.
    bool points_from_map = false;
    /// SemanticKITTI label file of each scan, or empty.
    std::vector<std::filesystem::path> label_files;
    /// Of several lidars as one: their names, the reference first. Empty for one lidar.
    std::vector<std::string> lidars;
    /// What the reader did, for people: scans that it left out and why, what it assumed.
    std::vector<std::string> notes;

    /// "000012.bin", or "drive.mcap /points 12"; with "from map" behind it if `points_from_map`.
    /// Unique within the drive.
    [[nodiscard]] std::string scan_name(std::size_t index) const;
  };

  /// Opens a drive of any layout, told apart by content: a folder, or the file of a bag.
  ///
  /// Bags (MCAP, rosbag2, ROS 1; captures of a Velodyne's packets, pcap or pcapng). The scans are
  /// the messages of the one topic of PointCloud2, of Livox' CustomMsg or of VelodyneScan, with the
  /// stamps of their headers; or the turns of an Ouster's PacketMsg, with the stamps of their first
  /// columns. Poses come from the one topic of Odometry, or of PoseStamped with at
  /// least one pose for 40 scans; tf_static moves them to the frame of the clouds. Without such a
  /// topic they come from tf: from the highest frame called map, odom, world or camera_init, else
  /// from earth. If tf only repeats the topic, the topic is used. Poses are interpolated to the
  /// scans. Scans at the ends without a pose are left out and noted.
  ///
  /// If a bag leaves more than one choice, it is made in `topics.txt` of the bag's folder, or
  /// behind the path: `run.mcap?cloud=/points&poses=/odom&pose_frame=base_link&gnss=/fix&imu=/imu`,
  /// any of them. `stamps=recorded` takes the times at which the recorder wrote the clouds, where
  /// the stamps of their headers are wrong. `poses` may be a topic of tf, or `none`. `pose_frame`
  /// is the frame of the poses, if the messages do not name it or name a wrong one. `gnss` is a
  /// topic of NavSatFix; it turns the poses to east-north-up. `imu` is a topic of Imu, or `none`.
  ///
  /// Folders of *.bin whose points are not x y z intensity: `FOLDER?columns=xyzir`, a letter for
  /// each float32 (`ScanFileHints::bin_columns`).
  ///
  /// Several lidars as one: `cloud=/front,/rear`, placed by tf_static, or a folder with
  /// `lidars.json` (`lidar_set.hpp`). The first lidar is the reference: its stamps, poses and frame
  /// are the drive's. Each sweep of another lidar joins the reference's scan that is nearest in
  /// time.
  ///
  /// Points in the frame of the poses (registered scans) are recognised if a bag's frames or a
  /// folder's VIEWPOINTs say so, and told from points of the sensor by how well scans overlap.
  /// `?points=map` or `?points=sensor` behind the path of a drive of one lidar decides instead.
  /// @param poses_file  poses `T_map_lidar` instead of the layout's own (`read_pose_file`): with
  ///                    stamps, by the numbers of scans, or one for each scan. Poses with stamps
  ///                    are interpolated to the scans' stamps; scans without a pose within 0.2 s
  ///                    are left out and noted.
  /// @param pose_offset_ns  added to the stamps of the poses [ns], in [-1e18, 1e18]. One pose for
  ///                    each scan has the stamp of its scan.
  /// @throws InputError if the layout is unknown or contradictory, there are fewer poses than scans
  /// where each has one, or no scan has a pose.
  [[nodiscard]] static Drive open(
      const std::filesystem::path& root,
      const std::optional<std::filesystem::path>& poses_file = std::nullopt,
      std::int64_t pose_offset_ns = 0);

  /// Whether a drive may be at this path, without what follows `?`: a folder, or a bag's file.
  [[nodiscard]] static bool is_at(const std::filesystem::path& root);
  /// Whether this folder itself, and not one inside it, has a known layout of a drive.
  [[nodiscard]] static bool is_in(const std::filesystem::path& folder);

  explicit Drive(Contents contents);

  [[nodiscard]] std::size_t size() const { return contents_.scan_files.size(); }
  [[nodiscard]] const Contents& contents() const { return contents_; }
  /// To be called before a file is used that names scans by their numbers.
  /// @throws InputError naming the drive and the file when `Contents::counts_from_first_pose`.
  void require_own_numbers(const std::filesystem::path& file) const;
  [[nodiscard]] bool has_poses() const { return !contents_.T_map_lidar.empty(); }
  [[nodiscard]] bool relative_clock() const { return contents_.relative_clock; }
  [[nodiscard]] std::int64_t stamp_ns(std::size_t index) const {
    return contents_.stamps_ns.at(index);
  }
  /// @throws std::out_of_range without poses.
  [[nodiscard]] const Eigen::Isometry3d& T_map_lidar(std::size_t index) const {
    return contents_.T_map_lidar.at(index);
  }

  /// The same scans with other poses.
  /// @param T_map_lidar  one a scan. @param origin  of their frame, where it is known.
  /// @throws std::invalid_argument for another number of poses or one that is not finite.
  [[nodiscard]] Drive with_poses(std::vector<Eigen::Isometry3d> T_map_lidar,
                                 const std::optional<GeodeticOrigin>& origin) const;
  /// The same drive with another IMU; null for none. With one that has a `fit`, scans that have
  /// times are read with the `PointCloud::turn` of their sweep.
  [[nodiscard]] Drive with_imu(std::shared_ptr<const Imu> imu) const;

  /// Reads one scan; NaN, infinite and zero-range points are dropped and counted.
  /// @throws InputError for a broken file (truncated, unknown fields, ...), StorageError for the
  /// disk.
  [[nodiscard]] Scan read(std::size_t index) const;

  /// SHA-256 [hex] of a scan's bytes: of its file, or of its message in a bag. @throws as `read`.
  [[nodiscard]] std::string sha256(std::size_t index) const;

  /// SemanticKITTI labels, one a point of the *file* (dropped points included); empty without a
  /// file.
  /// @throws InputError if the count differs from the scan's.
  [[nodiscard]] std::vector<std::uint32_t> read_labels(std::size_t index) const;

 private:
  Contents contents_;
};

/// The poses of a TUM file that was made of some of the drive's scans: each of its stamps is that
/// of a scan, and there are fewer of them than scans. Nothing needs to be interpolated then, and
/// scans without a line have no pose.
/// @return one entry a scan; nothing for any other file of poses, which `Drive::open` takes.
/// @throws InputError naming file, line and value.
[[nodiscard]] std::optional<std::vector<std::optional<Eigen::Isometry3d>>> poses_of_some_scans(
    const Drive& drive, const std::filesystem::path& poses_file);

/// `a:b:step` as in Python (b exclusive, any part may be left out, non-negative, step >= 1), e.g.
/// `::2`.
struct Selection {
  std::size_t begin = 0;
  std::optional<std::size_t> end;
  std::size_t step = 1;

  /// @throws std::invalid_argument naming the text.
  [[nodiscard]] static Selection parse(std::string_view text);
  /// Indices below `size`.
  [[nodiscard]] std::vector<std::size_t> indices(std::size_t size) const;
};

}  // namespace stillmap::maps
