#include "reading.hpp"

#include <mrpt/obs/CActionCollection.h>
#include <mrpt/obs/CObservationOdometry.h>
#include <mrpt/obs/CObservationRobotPose.h>
#include <mrpt/obs/CSensoryFrame.h>
#include <mrpt/serialization/CArchive.h>

#include <sys/prctl.h>
#include <sys/resource.h>

#include <algorithm>
#include <csignal>
#include <exception>
#include <new>
#include <string>
#include <string_view>
#include <vector>

#include "packed_input.hpp"
#include "sweeps.hpp"

namespace stillmap::maps::rawlog {
namespace {

constexpr rlim_t kMemoryBytes = 256U << 20U;

void limit(__rlimit_resource resource, rlim_t value) {
  const rlimit both{value, value};
  ::setrlimit(resource, &both);
}

/// Follows the two kinds of rawlogs: single observations, and actions between sensory frames.
class Reading {
 public:
  explicit Reading(RecordOutput& output) : output_(output) {}

  void take(const mrpt::serialization::CSerializable::Ptr& object) {
    if (const auto actions = std::dynamic_pointer_cast<mrpt::obs::CActionCollection>(object))
      return move(*actions);
    if (const auto frame = std::dynamic_pointer_cast<mrpt::obs::CSensoryFrame>(object)) {
      bool is_first = true;
      for (const mrpt::obs::CObservation::Ptr& each : *frame) {
        if (!each) continue;
        if (is_first) here(each->timestamp);
        is_first = false;
        observe(*each);
      }
      return;
    }
    if (const auto each = std::dynamic_pointer_cast<mrpt::obs::CObservation>(object))
      observe(*each);
  }

 private:
  void move(const mrpt::obs::CActionCollection& actions) {
    mrpt::poses::CPose3D step;
    if (!actions.getFirstMovementEstimationMean(step)) return;
    // Frames before the first action stand where it begins.
    if (!moves_)
      for (const auto& stamp : before_) output_.pose(RawlogPoseSource::kActions, stamp, pose_);
    before_.clear();
    moves_ = true;
    pose_ = pose_ + step;
  }
  void here(mrpt::Clock::time_point stamp) {
    if (moves_) return output_.pose(RawlogPoseSource::kActions, stamp, pose_);
    if (before_.empty()) before_.push_back(stamp);
  }
  void observe(mrpt::obs::CObservation& observation) {
    using namespace mrpt::obs;
    if (const auto* odometry = dynamic_cast<const CObservationOdometry*>(&observation))
      return output_.pose(RawlogPoseSource::kOdometry, observation.timestamp,
                          mrpt::poses::CPose3D(odometry->odometry));
    if (const auto* robot = dynamic_cast<const CObservationRobotPose*>(&observation))
      return output_.pose(RawlogPoseSource::kRobotPose, observation.timestamp, robot->pose.mean);
    const std::optional<Sweep> sweep = sweep_of(observation);
    if (!sweep) return;
    mrpt::poses::CPose3D T_base_lidar;
    observation.getSensorPose(T_base_lidar);
    const std::string& label = observation.sensorLabel;
    output_.scan(*sweep, label.empty() ? observation.GetRuntimeClass()->className : label,
                 observation.timestamp, T_base_lidar);
  }

  RecordOutput& output_;
  mrpt::poses::CPose3D pose_;
  bool moves_ = false;
  std::vector<mrpt::Clock::time_point> before_;
};

/// Of what MRPT throws the message, without where in its sources and by whom it was called.
std::string message_of(const std::exception& error) {
  constexpr std::string_view kMark = "Message:";
  std::string text = error.what();
  const std::size_t mark = text.find(kMark);
  if (mark != std::string::npos) text.erase(0, mark + kMark.size());
  text.erase(std::min(text.find('\n'), text.size()));
  text.erase(0, text.find_first_not_of(' '));
  return text.empty() ? "not readable" : text;
}

}  // namespace

void confine() {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
  limit(RLIMIT_DATA, kMemoryBytes);
  limit(RLIMIT_CORE, 0);
  // What it writes to is open already; a file it could only spoil.
  limit(RLIMIT_FSIZE, 0);
}

void read(const std::string& file, RecordOutput& output) {
  std::uint64_t objects = 0;
  std::string reason;
  try {
    PackedInput stream(file);
    auto archive = mrpt::serialization::archiveFrom(stream);
    Reading reading(output);
    while (!stream.at_end()) {
      reading.take(archive.ReadObject());
      ++objects;
    }
  } catch (const std::bad_alloc&) {
    reason = "an object needs more than 256 MiB";
  } catch (const std::exception& error) {
    reason = message_of(error);
  }
  if (!reason.empty()) reason = "object " + std::to_string(objects + 1) + ": " + reason;
  output.end(objects, reason);
}

}  // namespace stillmap::maps::rawlog
