#include "record_output.hpp"

#include <unistd.h>

#include <cerrno>
#include <system_error>

#include "times.hpp"

namespace stillmap::maps::rawlog {
namespace {

void set_pose(RawlogRecord& record, const mrpt::poses::CPose3D& pose) {
  const auto& R = pose.getRotationMatrix();
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column)
      record.pose[4 * static_cast<std::size_t>(row) + static_cast<std::size_t>(column)] =
          R(row, column);
    record.pose[4 * static_cast<std::size_t>(row) + 3] = pose.m_coords[row];
  }
}

}  // namespace

void RecordOutput::scan(const Sweep& sweep, const std::string& label, mrpt::Clock::time_point stamp,
                        const mrpt::poses::CPose3D& T_base_lidar) {
  if (sweep.points.empty() || sweep.points.size() > kMostRawlogPoints ||
      label.size() > kMostRawlogText)
    return skip();
  RawlogRecord record;
  record.kind = RawlogRecordKind::kScan;
  record.text_bytes = static_cast<std::uint32_t>(label.size());
  record.stamp_ns = stamp_ns_of(stamp);
  set_pose(record, T_base_lidar);
  record.points = static_cast<std::uint32_t>(sweep.points.size());
  record.flags =
      (sweep.has_intensities ? kRawlogIntensities : 0U) | (sweep.has_times ? kRawlogTimes : 0U);
  put(&record, sizeof record);
  put(label.data(), label.size());
  put(sweep.points.data(), sweep.points.size() * sizeof(RawlogPoint));
}

void RecordOutput::pose(RawlogPoseSource source, mrpt::Clock::time_point stamp,
                        const mrpt::poses::CPose3D& T_odom_base) {
  RawlogRecord record;
  record.kind = RawlogRecordKind::kPose;
  record.stamp_ns = stamp_ns_of(stamp);
  set_pose(record, T_odom_base);
  record.flags = static_cast<std::uint32_t>(source);
  put(&record, sizeof record);
}

void RecordOutput::end(std::uint64_t objects, const std::string& reason) {
  RawlogRecord record;
  record.kind = RawlogRecordKind::kEnd;
  const std::string text = reason.substr(0, kMostRawlogText);
  record.text_bytes = static_cast<std::uint32_t>(text.size());
  record.objects = objects;
  record.unusable = unusable_;
  put(&record, sizeof record);
  put(text.data(), text.size());
}

void RecordOutput::put(const void* bytes, std::size_t size) {
  const auto* from = static_cast<const char*>(bytes);
  while (size > 0) {
    const ssize_t count = ::write(descriptor_, from, size);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) throw std::system_error(errno, std::generic_category(), "records");
    from += count;
    size -= static_cast<std::size_t>(count);
  }
}

}  // namespace stillmap::maps::rawlog
